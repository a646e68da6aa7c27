"""Logs of messages as recordings: bags of ROS 1 and ROS 2, read by `rosbags` without ROS, and logs
of autopilots.

A bag is opened (`container`, damaged ones by `salvage`), its messages decoded (`messages`), the
topics that a mapping names (`topics`) turned into channels (`samples`, `grade`) on one clock
(`clock`). `flight` opens the logs of PX4 and ArduPilot, whose messages are topics too. `assemble`
puts them together.
"""

import hashlib
from pathlib import Path

SUFFIXES = (".bag", ".active", ".mcap", ".db3")
"""Endings of files that hold messages; a recorder that was killed leaves `NAME.bag.active`."""
FLIGHT_SUFFIXES = (".ulg", ".bin")
"""Endings of the logs of autopilots, in lower case: ULog of PX4, DataFlash of ArduPilot."""


def is_bag(path: Path) -> bool:
    """Whether a path is a log of messages: a file by its ending, a folder by its files."""
    return (
        path.suffix in SUFFIXES
        or is_flight_log(path)
        or (path.is_dir() and bool(storage_files(path)))
    )


def is_flight_log(path: Path) -> bool:
    """Whether a path is a log of an autopilot, by its ending."""
    return path.suffix.lower() in FLIGHT_SUFFIXES


def storage_files(path: Path) -> list[Path]:
    """The files of a bag that hold messages, in order."""
    if not path.is_dir():
        return [path]
    return sorted(
        file
        for file in path.iterdir()
        if file.name.removesuffix(".zstd").endswith((".mcap", ".db3"))
    )


def sha256(path: Path) -> str:
    """Digest of a file or, for a folder, of all that hold messages, one after the other."""
    digest = hashlib.sha256()
    for file in storage_files(path):
        with file.open("rb") as stream:
            hashlib.file_digest(stream, lambda: digest)
    return digest.hexdigest()
