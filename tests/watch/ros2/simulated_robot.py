"""A robot on the network, in a second process."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

DOMAIN = 100 + os.getpid() % 100


LONGEST_S = 60.0


@contextmanager
def robot(*options: str) -> Iterator[subprocess.Popen[bytes]]:
    """A simulated robot in a process of its own, which ends as by a power cut."""
    command = [
        sys.executable,
        "-m",
        "homeward.watch.ros2.simulated",
        "--domain",
        str(DOMAIN),
        *options,
    ]
    with subprocess.Popen(command, cwd=Path(__file__).parents[3]) as process:
        try:
            yield process
        finally:
            process.kill()
