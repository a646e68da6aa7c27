"""`homeward watch --stdin` in an environment of its own: JSON lines in and out, a thread for each
of its streams."""

from __future__ import annotations

import collections
import contextlib
import json
import os
import signal
import subprocess
import threading
import time

MOST_WAITING = 5000
"""Lines that wait until homeward reads them, and lines of homeward that wait for the node. Chosen:
several seconds of all topics; beyond it the oldest are dropped."""
ENDS_S = 10.0
"""Time in which homeward saves its state and ends, before it is killed. Chosen."""


class Process:
    """One run of the command.

    Args:
        command: The command with its arguments.
        say: Is told each line of its standard error, in a thread of its own.

    Attributes:
        dropped: Number of lines that homeward was too slow to read.
        last_error: Last line of its standard error.

    Raises:
        OSError: It cannot be started.
    """

    def __init__(self, command, say):
        self.dropped, self.last_error, self._say = 0, "", say
        self.spoke_s = time.monotonic()  # when it last wrote a line, or was started
        self._child = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            # In a group of its own: Ctrl-C in the terminal of `ros2 launch` is for the node, which
            # ends homeward.
            start_new_session=True,
            # What `ros2` and colcon put there is for the robot's Python, not for that of homeward.
            env={
                name: value
                for name, value in os.environ.items()
                if name not in ("PYTHONPATH", "PYTHONHOME")
            },
        )
        self._out = collections.deque()
        self._in = collections.deque(maxlen=MOST_WAITING)
        self._news = threading.Condition()
        self._closed = False
        threads = (self._write, self._read, self._read_errors)
        self._threads = [threading.Thread(target=target, daemon=True) for target in threads]
        for thread in self._threads:
            thread.start()

    def send(self, line):
        """Send an object; if homeward does not keep up, the oldest one that waits is dropped."""
        with self._news:
            if len(self._out) >= MOST_WAITING:
                self._out.popleft()
                self.dropped += 1
            self._out.append(line)
            self._news.notify()

    def take(self):
        """Objects that homeward wrote since the last call."""
        lines = []
        while self._in:
            lines.append(self._in.popleft())
        return lines

    def code(self):
        """Exit code, None while it runs."""
        return self._child.poll()

    def end(self):
        """Let it save its state and end; kill it if it does not."""
        with self._news:
            self._closed = True
            self._news.notify()
        if self._child.poll() is None:
            self._child.send_signal(signal.SIGTERM)
        try:
            self._child.wait(ENDS_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        for thread in self._threads:
            thread.join(ENDS_S)
        for stream in (self._child.stdout, self._child.stderr):
            stream.close()

    def _write(self):
        with contextlib.suppress(OSError):  # it has ended, which `code` says
            while True:
                with self._news:
                    while not (self._out or self._closed):
                        self._news.wait()
                    if self._closed:
                        break
                    line = self._out.popleft()
                self._child.stdin.write(json.dumps(line).encode() + b"\n")
                self._child.stdin.flush()
        with contextlib.suppress(OSError):
            self._child.stdin.close()

    def _read(self):
        for line in self._child.stdout:
            try:
                said = json.loads(line)
            except ValueError:
                self._say(f"homeward wrote a line that is no JSON: {line[:80]!r}")
                continue
            self.spoke_s = time.monotonic()
            self._in.append(said)

    def _read_errors(self):
        for line in self._child.stderr:
            self.last_error = line.decode(errors="replace").rstrip()
            self._say(self.last_error)
