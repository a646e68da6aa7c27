"""Opening bags: ROS 1 files, ROS 2 folders and files (sqlite3, MCAP), whole or damaged."""

import contextlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from homeward.logs.bags import storage_files
from homeward.logs.bags.salvage import DamagedBag
from homeward.logs.columns import RecordingError


class Bag(contextlib.ExitStack):
    """A bag, open for reading within a `with` block.

    `connections` are its topics, of which one may have several; `notes` list what was left out.
    """

    def __init__(self, path: Path) -> None:
        """Open a bag.

        Raises:
            RecordingError: Nothing in it can be read.
        """
        super().__init__()
        self.path, self.ros1 = path, path.suffix in (".bag", ".active")
        self.notes: list[str] = []
        try:
            self._readers = self._opened()
            self.connections = [
                connection
                for reader in self._readers
                for connection in reader.connections
                if isinstance(connection.topic, str)  # a damaged database may give other types
            ]
            if not any(connection.msgcount for connection in self.connections):
                raise RecordingError("; ".join(["holds no message that can be read", *self.notes]))
        except BaseException:
            self.close()
            raise

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages of some topics with the time of receipt, ns; a damaged file ends at the damage, with a note."""
        for reader in self._readers:
            here = [connection for connection in connections if connection in reader.connections]
            if not here:
                continue
            first_ns, last_ns = 2**63, 0
            try:
                for connection, received_ns, data in reader.messages(here):
                    if isinstance(received_ns, int):  # as above
                        first_ns, last_ns = min(first_ns, received_ns), max(last_ns, received_ns)
                    yield connection, received_ns, data
            except Exception as error:  # a damaged record raises anything, from struct.error to zlib's
                read_s = max(last_ns - first_ns, 0) * 1e-9
                self.notes.append(
                    f"{reader.path.name} is damaged ({_first_line(error)}): its first {read_s:.1f} s could be read"
                )

    def _opened(self) -> list[Any]:
        if self.path.is_dir() and (self.path / "metadata.yaml").is_file():
            reader = Reader2(self.path)
            try:
                reader.open()
            except Exception as error:  # as below
                self.notes.append(f"cannot be read as a whole ({_first_line(error)}), so its files are read one by one")
            else:
                self.callback(reader.close)
                return [reader]
        elif self.path.is_dir():
            self.notes.append("has no metadata.yaml: the recorder was stopped before it ended the bag")
        readers = [self._reader(file) for file in storage_files(self.path)]
        if self.notes and any(isinstance(reader, DamagedBag) for reader in readers):
            self.notes = self.notes[-1:] if len(readers) == 1 else self.notes[1:]  # the files give better ones
        return readers

    def _reader(self, file: Path) -> Any:
        try:
            reader: Any = Reader1(file) if self.ros1 else Reader2(file)
            reader.open()
        except Exception as error:  # a cut file raises anything, from ReaderError to TypeError
            remains = DamagedBag(file)
            left = f"{sum(connection.msgcount for connection in remains.connections)} messages could be read"
            if file.suffix == ".db3":
                left = f'rebuild it with sqlite3 {file.name} ".recover" | sqlite3 whole.db3 and read whole.db3'
            self.notes.append(f"{file.name} is cut off or damaged ({_first_line(error)}): {left}")
            return remains
        self.callback(reader.close)
        return reader


def _first_line(error: Exception) -> str:
    text = (str(error).strip().splitlines() or [""])[0].rstrip(".")
    return text[:120] or type(error).__name__
