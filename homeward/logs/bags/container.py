"""Opening bags: ROS 1 files, ROS 2 folders and files (sqlite3, MCAP), whole or damaged.

Whatever `rosbags` unpacks counts against the allowance of the bag (`homeward.logs.limits`), as do
the messages that it gives.
"""

import contextlib
import sqlite3
from collections.abc import Callable, Collection, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1.reader import decompressors as unpackers1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS as UNPACKERS_MCAP
from rosbags.rosbag2.storage_mcap import McapReader

from homeward.logs import limits
from homeward.logs.bags import storage_files
from homeward.logs.bags.salvage import DamagedBag
from homeward.logs.columns import RecordingError
from homeward.logs.limits import Allowance, TooLarge

_MOST_METADATA_BYTES = 4_000_000
"""Most bytes of a metadata.yaml. Chosen: it has 1 kB for each topic, and reading it takes a
second."""

_OTHER_SCHEMAS = ("jsonschema", "protobuf", "flatbuffer", "ros1msg", "self-described")
"""Encodings of schemas in MCAP files that are none of ROS 2 (mcap.dev/spec/registry)."""

_allowance: ContextVar[Allowance | None] = ContextVar(
    "allowance of the bag that is read", default=None
)


def _limited(compression: str, unpack: Any) -> Callable[..., bytes]:
    """An unpacker of `rosbags` within the allowance of the bag that is read; without one it is as
    it was."""

    def within(data: bytes, *size: int) -> bytes:
        allowance = _allowance.get()
        content: bytes = (
            unpack(data, *size) if allowance is None else allowance.unpack(compression, data)
        )
        return content

    return within


# Both readers look up by name what unpacks a chunk; their own unpackers have no limits.
for _table in (unpackers1, UNPACKERS_MCAP):
    for _compression, _unpack in list(_table.items()):
        if _compression in ("bz2", "lz4", "zstd"):
            _table[_compression] = _limited(_compression, _unpack)


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
        self.path = path
        self.ros1 = path.suffix in (".bag", ".active")
        self.notes: list[str] = []
        self._allowance = Allowance(sum(file.stat().st_size for file in storage_files(path)))
        self._packed_messages = False
        outer = _allowance.set(self._allowance)
        self.callback(_allowance.reset, outer)
        try:
            self._readers = self._opened()
            self.connections = [
                connection
                for reader in self._readers
                for connection in reader.connections
                if isinstance(connection.topic, str)  # a damaged database may give other types
            ]
            _refuse_many(len(self.connections))
            if not any(connection.msgcount for connection in self.connections):
                raise RecordingError("; ".join(["holds no message that can be read", *self.notes]))
        except BaseException:
            self.close()
            raise

    def messages(
        self, connections: Collection[Connection]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages of some topics with the time of receipt, ns; a damaged file ends at the damage,
        with a note."""
        for reader in self._readers:
            in_reader = [
                connection for connection in connections if connection in reader.connections
            ]
            if not in_reader:
                continue
            earliest_ns = 2**63  # later than any time of receipt
            latest_ns = 0
            try:
                for connection, received_ns, packed in _in_order_of_file(reader, in_reader):
                    data = (
                        self._allowance.unpack("zstd", packed) if self._packed_messages else packed
                    )
                    self._allowance.take(len(data))
                    if isinstance(received_ns, int):  # as above
                        earliest_ns = min(earliest_ns, received_ns)
                        latest_ns = max(latest_ns, received_ns)
                    yield connection, received_ns, data
            except TooLarge:
                raise
            # a damaged record raises anything, from struct.error to zlib's
            except Exception as error:
                read_s = max(latest_ns - earliest_ns, 0) * 1e-9
                self.notes.append(
                    f"{reader.path.name} is damaged ({_first_line(error)}): its first {read_s:.1f} s could be read"
                )

    def _opened(self) -> list[Any]:
        """Readers of the folder as a whole, or of each of its files."""
        if self.path.is_dir() and (self.path / "metadata.yaml").is_file():
            folder = self._folder_reader()
            if folder is not None and self._lists_all_files(folder):
                self._unpack_messages_here(folder)
                return [folder]
            if folder is not None:
                return [self._reader(file) for file in storage_files(self.path)]
        elif self.path.is_dir():
            self.notes.append(
                "has no metadata.yaml: the recorder was stopped before it ended the bag"
            )
        readers = [self._reader(file) for file in storage_files(self.path)]
        if self.notes and any(isinstance(reader, DamagedBag) for reader in readers):
            # the files give better ones
            self.notes = self.notes[-1:] if len(readers) == 1 else self.notes[1:]
        return readers

    def _folder_reader(self) -> Any | None:
        """Reader of a folder by its metadata; None, with a note, where it cannot be read as a
        whole."""
        reader: Any = Reader2(self.path)
        try:
            self._refuse_large_folder()
            reader.open()
        except RecordingError:
            raise
        except Exception as error:  # as in `_reader`
            self.notes.append(
                f"cannot be read as a whole ({_first_line(error)}), so its files are read one by one"
            )
            return None
        self.callback(reader.close)
        return reader

    def _lists_all_files(self, folder: Any) -> bool:
        """Whether the metadata of a folder lists all of its files; a note says if not."""
        listed = {Path(storage.path).name for storage in folder.storage.storages}
        stored = {file.name.removesuffix(".zstd") for file in storage_files(self.path)}
        if stored <= listed:
            return True
        self.notes.append(
            f"metadata.yaml lists {len(listed)} of {len(stored)} files: all are read, one by one"
        )
        return False

    def _unpack_messages_here(self, folder: Any) -> None:
        """Let messages that are packed one by one be unpacked by this class, which has limits, and
        files be scanned."""
        if folder.storage.metadata.compression_mode == "message":
            self._packed_messages = True
            folder.storage.metadata = folder.storage.metadata._replace(compression_mode=None)
        for storage in folder.storage.storages:
            _scan(storage)

    def _reader(self, file: Path) -> Any:
        """Reader of one file; of a damaged one what remains of it, with a note."""
        try:
            reader: Any = _Bag1(file) if self.ros1 else Reader2(file)
            if not self.ros1:
                _refuse_many_topics(file)
                reader.storage.connections = _Few()
            reader.open()
        except RecordingError:
            raise
        except Exception as error:  # a cut file raises anything, from ReaderError to TypeError
            remains = DamagedBag(file, self._allowance)
            self.notes.append(_why_remains(file, error, remains))
            return remains
        self.callback(reader.close)
        if not self.ros1:
            _scan(reader.storage)
        return reader

    def _refuse_large_folder(self) -> None:
        """Refuse what `rosbags` would read as a whole, or unpack to a folder among temporary
        files."""
        size = (self.path / "metadata.yaml").stat().st_size
        if size > _MOST_METADATA_BYTES:
            raise TooLarge(
                f"has a metadata.yaml of {size / 1e6:.3g} MB; remove it, and the files are read one by one"
            )
        for file in storage_files(self.path):
            if file.suffix == ".zstd":
                self._allowance.unpack_file(file)
            else:
                _refuse_many_topics(file)


class _Bag1(Reader1):
    """A reader of ROS 1 bags that counts topics while it reads them."""

    _topics = 0

    def read_connection(self) -> Connection:
        self._topics += 1
        _refuse_many(self._topics)
        return super().read_connection()


class _Few(list[Connection]):
    """Topics of an MCAP file, which are counted while they are read: each takes some time."""

    def append(self, connection: Connection) -> None:
        super().append(connection)
        _refuse_many(len(self))


def _refuse_many(topics: int) -> None:
    if topics > limits.MOST_TOPICS:
        raise TooLarge(
            f"has more than {limits.MOST_TOPICS} topics, which no robot has; record it again"
        )


def _refuse_many_topics(database: Path) -> None:
    """Count the topics of a database before they are read, as each takes some time."""
    if database.suffix != ".db3":
        return
    with contextlib.closing(
        sqlite3.connect(f"{database.absolute().as_uri()}?immutable=1", uri=True)
    ) as connection:
        query = "SELECT count(*) FROM (SELECT 1 FROM topics LIMIT ?)"
        (count,) = connection.execute(query, [limits.MOST_TOPICS + 1]).fetchone()
    _refuse_many(count)


def _scan(storage: Any) -> None:
    """Let an MCAP file be read in its order, a chunk at a time; by its index all that overlap would
    be unpacked."""
    if isinstance(storage, McapReader):
        storage.messages = storage.messages_scan  # type: ignore[method-assign]


def _in_order_of_file(
    reader: Any, connections: Collection[Connection]
) -> Iterator[tuple[Connection, int, bytes]]:
    """Messages of some connections, of a ROS 1 bag chunk by chunk.

    In the order of time, chunks that overlap are unpacked again for each change from one to the
    other.
    """
    if isinstance(reader, Reader1):
        entries = (entry for connection in connections for entry in reader.indexes[connection.id])
        by_place = {(entry.chunk_pos, entry.offset): entry for entry in entries}
        # The reader gives the messages of an index in its order, whatever connection they are of.
        index_of_all = next(iter(connections))
        reader.indexes[index_of_all.id] = [by_place[place] for place in sorted(by_place)]
        connections = [index_of_all]
    yield from reader.messages(connections)


def _why_remains(file: Path, error: Exception, remains: DamagedBag) -> str:
    """Why only a part of a file is read, in a line."""
    reason = _not_damaged(error)
    if reason is not None:
        return f"{file.name} {reason}, which are left out"
    count = sum(connection.msgcount for connection in remains.connections)
    what_to_do = f"{count} messages could be read"
    if file.suffix == ".db3":
        what_to_do = (
            f'rebuild it with sqlite3 {file.name} ".recover" | sqlite3 whole.db3 and read whole.db3'
        )
    return f"{file.name} is cut off or damaged ({_first_line(error)}): {what_to_do}"


def _not_damaged(error: Exception) -> str | None:
    """What a whole MCAP file has that `rosbags` does not open; the topics of ROS 2 in it are read
    without its index."""
    if isinstance(error, KeyError) and error.args and error.args[0] in _OTHER_SCHEMAS:
        return f"has topics with schemas in {error.args[0]}"
    return None


def _first_line(error: Exception) -> str:
    text = (str(error).strip().splitlines() or [""])[0].rstrip(".")
    return text[:120] or type(error).__name__
