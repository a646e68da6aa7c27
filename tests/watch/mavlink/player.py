"""Plays a telemetry log to a UDP port, as an autopilot sends it, and writes what comes back to a
file, a line each.

`python player.py LOG.tlog PORT HEARD.jsonl`
"""

import json
import socket
import sys
import time
from pathlib import Path

from pymavlink import mavutil

SPEED = 5.0  # multiple of real time


def main(log: str, port: int, heard: Path) -> None:
    """Play the log, then wait to be ended."""
    mavutil.set_dialect("ardupilotmega")
    reader = mavutil.mavlink_connection(log)
    parser = mavutil.mavlink.MAVLink(None)
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.setblocking(False)
    began_s, first_s = time.monotonic(), None
    with heard.open("w") as lines:
        while True:
            message = reader.recv_match()
            if message is not None:
                first_s = message._timestamp if first_s is None else first_s
                time.sleep(
                    max(began_s + (message._timestamp - first_s) / SPEED - time.monotonic(), 0.0)
                )
                end.sendto(message.get_msgbuf(), ("127.0.0.1", port))
            else:
                time.sleep(0.02)
            try:
                content = end.recv(2048)
            except OSError:  # nothing came, or nobody listens yet
                continue
            for said in parser.parse_buffer(content) or []:
                lines.write(json.dumps({**said.to_dict(), "system": said.get_srcSystem()}) + "\n")
            lines.flush()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
