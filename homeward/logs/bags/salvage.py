"""Recovery of a bag whose end is missing: its readable records in order.

A recorder that is killed, or a file that is cut off in copying, leaves no index, and the last chunk
half written. The records before are whole; these scanners read them without an index, and unpack
the last chunk as far as it was written.

Sources: ROS bag format 2.0 (wiki.ros.org/Bags/Format/2.0), MCAP specification 1 (mcap.dev/spec).
"""

import io
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.typesys.msg import normalize_msgtype

from homeward.logs.bags.messages import SCHEMALESS
from homeward.logs.limits import Allowance, TooLarge

# of a message: id of its connection, time of receipt in ns, content
Record = Connection | tuple[int, int, bytes]

_ROS1_MAGIC = b"#ROSBAG V2.0\n"
_MCAP_MAGIC = b"\x89MCAP0\r\n"
_ROS1_MESSAGE, _ROS1_CHUNK, _ROS1_CONNECTION = 2, 5, 7  # op codes, wiki.ros.org/Bags/Format/2.0
_MCAP_SCHEMA, _MCAP_CHANNEL, _MCAP_MESSAGE, _MCAP_CHUNK = 3, 4, 5, 6  # op codes, mcap.dev/spec
_FORMATS = {"ros2msg": MessageDefinitionFormat.MSG, "ros2idl": MessageDefinitionFormat.IDL,
            "omgidl": MessageDefinitionFormat.IDL}  # fmt: skip


class DamagedBag:
    """The readable part of a damaged file; stands in for a reader of rosbags.

    A file that was compressed as a whole, or a database, has none.
    """

    def __init__(self, path: Path, allowance: Allowance) -> None:
        """Scan the file once for its topics, with the number of messages that can be read.

        Args:
            path: The file.
            allowance: What it may unpack to, in both scans.
        """
        self.path, self._allowance = path, allowance
        counts: Counter[int] = Counter()
        connections: dict[int, Connection] = {}
        for record in self._records():
            if isinstance(record, Connection):
                connections[record.id] = record
            else:
                counts[record[0]] += 1
        self.connections = [
            connection._replace(msgcount=counts[connection.id], owner=self)
            for connection in connections.values()
        ]

    def messages(
        self, connections: Collection[Connection]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages of some connections, in the order of the file."""
        wanted = {connection.id: connection for connection in connections}
        for record in self._records():
            if not isinstance(record, Connection) and record[0] in wanted:
                yield wanted[record[0]], record[1], record[2]

    def _records(self) -> Iterator[Record]:
        """Records up to the first that is no record; garbage raises anything, from KeyError to
        OverflowError."""
        magic, scan = (_MCAP_MAGIC, _mcap) if self.path.suffix == ".mcap" else (_ROS1_MAGIC, _ros1)
        try:
            with self.path.open("rb") as file:
                if file.read(len(magic)) == magic:
                    yield from scan(file, self._allowance)
        except TooLarge:
            raise
        except Exception:
            return


def _ros1(file: BinaryIO, allowance: Allowance) -> Iterator[Record]:
    while (header := _sized(file)) is not None:
        fields = _ros1_fields(header)
        operation = fields.get(b"op", b"\xff")[0]
        length = file.read(4)
        size = struct.unpack("<I", length)[0] if len(length) == 4 else 0
        if operation not in (_ROS1_MESSAGE, _ROS1_CHUNK, _ROS1_CONNECTION):
            file.seek(size, io.SEEK_CUR)
            continue
        data = file.read(size)
        if operation == _ROS1_CHUNK:
            yield from _ros1(_unpacked(fields[b"compression"].decode(), data, allowance), allowance)
            continue
        if len(data) < size:
            return
        (connection,) = struct.unpack("<I", fields[b"conn"])
        if operation == _ROS1_CONNECTION:
            fields = _ros1_fields(data)
            text = fields[b"message_definition"].decode()
            kind = normalize_msgtype(fields[b"type"].decode())
            yield _connection(
                connection, fields[b"topic"].decode(), kind, MessageDefinitionFormat.MSG, text
            )
        else:
            seconds, nanoseconds = struct.unpack("<II", fields[b"time"])
            yield connection, seconds * 10**9 + nanoseconds, data


def _ros1_fields(data: bytes) -> dict[bytes, bytes]:
    stream = io.BytesIO(data)
    fields = {}
    while (field := _sized(stream)) is not None:
        name, _, value = field.partition(b"=")
        fields[name] = value
    return fields


def _mcap(
    file: BinaryIO, allowance: Allowance, schemas: dict[int, tuple[str, str, str]] | None = None
) -> Iterator[Record]:
    schemas = {} if schemas is None else schemas
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
            compression = _text(record)
            record.seek(8, io.SEEK_CUR)
            yield from _mcap(_unpacked(compression, record.read(), allowance), allowance, schemas)
        elif len(data) < size:
            return
        elif operation[0] == _MCAP_SCHEMA:
            (number,) = struct.unpack("<H", record.read(2))
            schemas[number] = (_text(record), _text(record), _text(record))
        elif operation[0] == _MCAP_CHANNEL:
            number, schema = struct.unpack("<HH", record.read(4))
            name, encoding, text = schemas.get(schema, (SCHEMALESS, "", ""))
            yield _connection(
                number,
                _text(record),
                name,
                _FORMATS.get(encoding, MessageDefinitionFormat.NONE),
                text,
            )
        elif operation[0] == _MCAP_MESSAGE:
            number, _, received = struct.unpack("<HIQ", data[:14])
            yield number, received, data[22:]


def _sized(file: BinaryIO) -> bytes | None:
    """The next bytes with their length before them, or None where they are not all there."""
    length = file.read(4)
    if len(length) < 4:
        return None
    (size,) = struct.unpack("<I", length)
    data = file.read(size)
    return data if len(data) == size else None


def _text(record: BinaryIO) -> str:
    return (_sized(record) or b"").decode()


def _unpacked(compression: str, data: bytes, allowance: Allowance) -> BinaryIO:
    """A chunk's content, as far as the chunk goes."""
    return io.BytesIO(allowance.unpack(compression, data, whole=False))


def _connection(
    number: int, topic: str, kind: str, form: MessageDefinitionFormat, text: str
) -> Connection:
    extra = ConnectionExtRosbag2("cdr", [])
    return Connection(number, topic, kind, MessageDefinition(form, text), "", 0, extra, None)
