"""What can still be read of a bag whose end is missing: its records in order, as far as they go.

A recorder that is killed, or a file that is cut off in copying, leaves no index, and the last chunk half written. The
records before are whole; these scanners read them without an index, and unpack the last chunk as far as it came.

Sources: ROS bag format 2.0 (wiki.ros.org/Bags/Format/2.0), MCAP specification 1 (mcap.dev/spec).
"""

from __future__ import annotations

import bz2
import contextlib
import io
import struct
import sys
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from rosbags.typesys.msg import normalize_msgtype

Message = tuple[int, int, bytes]  # id of its connection, time of receipt in ns, content
Record = Connection | Message

_ROS1_MESSAGE, _ROS1_CHUNK, _ROS1_CONNECTION = 2, 5, 7
_MCAP_SCHEMA, _MCAP_CHANNEL, _MCAP_MESSAGE, _MCAP_CHUNK = 3, 4, 5, 6
_FORMATS = {"ros2msg": MessageDefinitionFormat.MSG, "ros2idl": MessageDefinitionFormat.IDL,
            "omgidl": MessageDefinitionFormat.IDL}  # fmt: skip


class Remains:
    """The readable part of a damaged file; stands in for a reader of rosbags.

    Attributes:
        connections: Topics met, with the number of messages that can be read.
    """

    def __init__(self, path: Path) -> None:
        """Scan the file once for its topics."""
        self.path = path
        self._records = _SCANNERS.get(path.suffix, _nothing)(path)
        found: dict[int, Connection] = {}
        counts: dict[int, int] = {}
        for record in _readable(self._records):
            if isinstance(record, Connection):
                found[record.id] = record
            else:
                counts[record[0]] = counts.get(record[0], 0) + 1
        self.connections = [c._replace(msgcount=counts.get(c.id, 0), owner=self) for c in found.values()]

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages of some connections, in the order of the file."""
        wanted = {connection.id: connection for connection in connections}
        for record in _readable(self._records):
            if not isinstance(record, Connection) and record[0] in wanted:
                yield wanted[record[0]], record[1], record[2]


def _readable(records: Callable[[], Iterator[Record]]) -> Iterator[Record]:
    """Records up to the first that is no record; garbage raises anything, from KeyError to OverflowError."""
    with contextlib.suppress(Exception):
        yield from records()


def _ros1(path: Path) -> Callable[[], Iterator[Record]]:
    def records() -> Iterator[Record]:
        with path.open("rb") as file:
            if file.readline() != b"#ROSBAG V2.0\n":
                return
            yield from _ros1_records(file)

    return records


def _ros1_records(file: BinaryIO) -> Iterator[Record]:
    while (header := _sized(file, "<I")) is not None:
        fields = dict(_ros1_fields(header))
        operation = fields.get(b"op", b"\xff")[0]
        size = struct.unpack("<I", length)[0] if len(length := file.read(4)) == 4 else 0
        data = file.read(size) if operation in (_ROS1_MESSAGE, _ROS1_CHUNK, _ROS1_CONNECTION) else b""
        if operation == _ROS1_CHUNK:
            yield from _ros1_records(io.BytesIO(_unpacked(fields[b"compression"].decode(), data)))
        elif operation == _ROS1_CONNECTION and len(data) == size:
            about = dict(_ros1_fields(data))
            yield _connection(struct.unpack("<I", fields[b"conn"])[0], fields[b"topic"].decode(),
                              normalize_msgtype(about[b"type"].decode()), MessageDefinitionFormat.MSG,
                              about[b"message_definition"].decode())  # fmt: skip
        elif operation == _ROS1_MESSAGE and len(data) == size:
            seconds, nanoseconds = struct.unpack("<II", fields[b"time"])
            yield struct.unpack("<I", fields[b"conn"])[0], seconds * 10**9 + nanoseconds, data
        elif not data:
            file.seek(size, io.SEEK_CUR)


def _ros1_fields(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    stream = io.BytesIO(data)
    while (field := _sized(stream, "<I")) is not None:
        name, _, value = field.partition(b"=")
        yield name, value


def _mcap(path: Path) -> Callable[[], Iterator[Record]]:
    def records() -> Iterator[Record]:
        with path.open("rb") as file:
            if file.read(8) == b"\x89MCAP0\r\n":
                yield from _mcap_records(file, {})

    return records


def _mcap_records(file: BinaryIO, schemas: dict[int, tuple[str, str, str]]) -> Iterator[Record]:
    while operation := file.read(1):
        length = file.read(8)
        if len(length) < 8:
            return
        (size,) = struct.unpack("<Q", length)
        if operation[0] not in (_MCAP_SCHEMA, _MCAP_CHANNEL, _MCAP_MESSAGE, _MCAP_CHUNK):
            file.seek(size, io.SEEK_CUR)
            continue
        data = file.read(size)
        record = io.BytesIO(data)
        if operation[0] == _MCAP_CHUNK and len(data) > 32:
            record.seek(28)
            compression = (_sized(record, "<I") or b"").decode()
            record.seek(8, io.SEEK_CUR)
            yield from _mcap_records(io.BytesIO(_unpacked(compression, record.read())), schemas)
        elif len(data) < size:
            return
        elif operation[0] == _MCAP_SCHEMA:
            (number,) = struct.unpack("<H", record.read(2))
            name, encoding, text = ((_sized(record, "<I") or b"").decode() for _ in range(3))
            schemas[number] = (name, encoding, text)
        elif operation[0] == _MCAP_CHANNEL:
            number, schema = struct.unpack("<HH", record.read(4))
            name, encoding, text = schemas.get(schema, ("", "", ""))
            topic = (_sized(record, "<I") or b"").decode()
            yield _connection(number, topic, name, _FORMATS.get(encoding, MessageDefinitionFormat.NONE), text)
        elif operation[0] == _MCAP_MESSAGE:
            number, _, received = struct.unpack("<HIQ", data[:14])
            yield number, received, data[22:]


def _nothing(path: Path) -> Callable[[], Iterator[Record]]:
    """What is left of a file that was compressed as a whole, or of a database."""
    return lambda: iter(())


_SCANNERS = {".bag": _ros1, ".active": _ros1, ".mcap": _mcap}


def _sized(file: BinaryIO, length_format: str) -> bytes | None:
    """The next bytes with their length before them, or None where they are not all there."""
    length = file.read(struct.calcsize(length_format))
    if len(length) < struct.calcsize(length_format):
        return None
    (size,) = struct.unpack(length_format, length)
    data = file.read(size)
    return data if len(data) == size else None


def _unpacked(compression: str, data: bytes) -> bytes:
    """A chunk's content, as far as the chunk goes."""
    if compression in ("", "none"):
        return data
    unpacker: Any
    if compression == "bz2":
        unpacker = bz2.BZ2Decompressor()
    elif compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

        unpacker = LZ4FrameDecompressor()
    else:
        if sys.version_info >= (3, 14):
            from compression import zstd
        else:
            from backports import zstd

        unpacker = zstd.ZstdDecompressor()
    try:
        content: bytes = unpacker.decompress(data)
    except (OSError, EOFError, RuntimeError, ValueError):
        return b""
    return content


def _connection(number: int, topic: str, kind: str, form: MessageDefinitionFormat, text: str) -> Connection:
    extra = ConnectionExtRosbag2("cdr", [])
    return Connection(number, topic, kind, MessageDefinition(form, text), "", 0, extra, None)
