"""Soak test: advise a simulated robot on ROS 2 for an hour, and measure memory and update times.

`python benchmarks/on_the_robot/soak.py --minutes 60` starts a simulated robot in another process,
which publishes battery state, odometry and IMU at 20 Hz on the loopback interface alone, and
subscribes as `homeward watch --ros2` does. It prints the figures of docs/results.md: resident
memory after a tenth, half and all of the time, number of messages, and time of a step.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.tables import table
from homeward import cli, installed
from homeward.companion import Companion, CompanionError
from homeward.watch.ros2 import LOOPBACK

DOMAIN = 91
"""Of ROS 2."""
_WARMS_UP = 0.1
"""Share of the time before memory is first read: kernels and tables are loaded in it."""


@dataclass(frozen=True)
class Args:
    """Duration and rate."""

    minutes: float = 60.0
    """Duration."""
    hz: float = 20.0
    """Messages of each of the three topics a second."""


def resident_mb() -> float:
    """Resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def main(args: Args) -> None:
    """Run the test, and print.

    Raises:
        CompanionError: An argument is invalid, the extra is not installed, or no message was
            received.
    """
    if args.minutes <= 0.0 or args.hz <= 0.0:
        raise CompanionError("give --minutes and --hz above 0")
    os.environ["CYCLONEDDS_URI"] = LOOPBACK
    installed.needed("ros2", "cyclonedds", "rosbags")
    from homeward.watch.online.node import PERIOD_S, Node
    from homeward.watch.ros2.network import Network

    node = Node(Companion("husky", home="here"), Network(DOMAIN))
    robot = ["--robot", "husky", "--domain", str(DOMAIN), "--hz", str(args.hz), "--out-s", "300"]
    duration_s = 60.0 * args.minutes
    took_s: list[float] = []
    marks = {_WARMS_UP: 0.0, 0.5: 0.0, 1.0: 0.0}
    with subprocess.Popen(
        [sys.executable, "-m", "homeward.watch.ros2.simulated", *robot]
    ) as publisher:
        try:
            while not node.messages and publisher.poll() is None:
                node.step()
                time.sleep(PERIOD_S)
            began_s = time.monotonic()
            while (since_s := time.monotonic() - began_s) < duration_s:
                for share, before_mb in marks.items():
                    if not before_mb and since_s >= share * duration_s:
                        marks[share] = resident_mb()
                step_s = time.perf_counter()
                if node.step():
                    took_s.append(time.perf_counter() - step_s)
                time.sleep(max(began_s + since_s + PERIOD_S - time.monotonic(), 0.0))
        finally:
            publisher.terminate()
    marks[1.0] = resident_mb()
    if not took_s or node.advice is None:
        raise CompanionError("nothing was heard of the simulated robot")
    shown = table(f"{args.minutes:g} minutes at {args.hz:g} Hz", ("of", "a simulated Husky"), ())
    memory = ", ".join(f"{megabytes:.1f}" for megabytes in marks.values())
    sent = 3.0 * args.hz * duration_s
    median_ms, late_ms, most_ms = 1e3 * np.quantile(took_s, (0.5, 0.99, 1.0))
    shown.add_row("resident memory after a tenth, half, all", f"{memory} MB")
    shown.add_row("messages taken", f"{node.messages} of about {sent:.0f} sent")
    shown.add_row("updates", f"{len(took_s)}")
    shown.add_row(
        "time of a step, median, 99 %, most", f"{median_ms:.2f}, {late_ms:.2f}, {most_ms:.1f} ms"
    )
    console = cli.Terminal()
    console.show(shown)
    console.print(str(node.advice), soft_wrap=True)
    for text in node.warnings:
        console.print(text, soft_wrap=True)


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (CompanionError,)))
