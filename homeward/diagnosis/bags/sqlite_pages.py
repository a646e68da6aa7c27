"""Messages of a cut sqlite3 file, from the pages that are left.

A query reaches a row by way of the pages above it, which in a cut file are often among those that are missing. The rows
themselves lie in leaf pages, in the order of writing; those are read one after the other, without the tree.

Source: sqlite.org/fileformat2.html.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path

_HEADER = b"SQLite format 3\x00"
_LEAF = 0x0D
_INTEGERS = (0, 1, 2, 3, 4, 6, 8)  # bytes of the serial types 0 to 6


def message_rows(path: Path) -> Iterator[tuple[int, int, bytes]]:
    """Rows (topic_id, timestamp, data) of the table `messages` of a ROS 2 bag, as far as their pages are there."""
    with path.open("rb") as file:
        if file.read(16) != _HEADER:
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            (size,) = struct.unpack(">H", content[16:18])
            size = 65536 if size == 1 else size
            if size < 512:
                return
            pages = _Pages(content, size, size - content[20])
            for start in range(size, len(content) - size + 1, size):
                if content[start] == _LEAF:
                    yield from pages.rows(start)


class _Pages:
    def __init__(self, content: mmap.mmap, size: int, usable: int) -> None:
        self.content, self.size, self.usable = content, size, usable

    def rows(self, start: int) -> Iterator[tuple[int, int, bytes]]:
        (count,) = struct.unpack(">H", self.content[start + 3 : start + 5])
        for index in range(min(count, self.size // 2)):
            (offset,) = struct.unpack(">H", self.content[start + 8 + 2 * index : start + 10 + 2 * index])
            try:
                row = self._row(start + offset, start + self.size)
            except (IndexError, struct.error):
                continue  # not a page of a table after all
            if row is not None:
                yield row

    def _row(self, at: int, end: int) -> tuple[int, int, bytes] | None:
        length, at = self._varint(at)
        _, at = self._varint(at)
        header_size, after = self._varint(at)
        kinds: list[int] = []
        while after < min(at + header_size, end) and len(kinds) < 5:
            kind, after = self._varint(after)
            kinds.append(kind)
        # id (kept as the row's number, so NULL), topic_id, timestamp, data
        if len(kinds) != 4 or kinds[0] or kinds[1] > 9 or kinds[2] != 6 or kinds[3] < 12 or kinds[3] % 2:
            return None
        record = self._payload(at, length, end)
        if record is None:
            return None
        place = header_size
        if kinds[1] > 6:
            topic = kinds[1] - 8  # the constants 0 and 1 have types of their own
        else:
            topic = int.from_bytes(record[place : place + _INTEGERS[kinds[1]]], "big")
            place += _INTEGERS[kinds[1]]
        (timestamp,) = struct.unpack_from(">q", record, place)
        data = record[place + 8 :]
        return (topic, timestamp, data) if len(data) == (kinds[3] - 12) // 2 else None

    def _payload(self, at: int, length: int, end: int) -> bytes | None:
        """A row's bytes, with those on overflow pages; None where one of these is missing."""
        most = self.usable - 35
        if length <= most:
            return self.content[at : at + length] if at + length <= end else None
        least = (self.usable - 12) * 32 // 255 - 23
        local = least + (length - least) % (self.usable - 4)
        local = local if local <= most else least
        parts = [self.content[at : at + local]]
        (page,) = struct.unpack(">I", self.content[at + local : at + local + 4])
        left = length - local
        while left > 0 and page:
            start = (page - 1) * self.size
            part = self.content[start + 4 : start + 4 + min(left, self.usable - 4)]
            if len(part) < min(left, self.usable - 4):
                return None
            parts.append(part)
            left -= len(part)
            (page,) = struct.unpack(">I", self.content[start : start + 4])
        return b"".join(parts) if left == 0 else None

    def _varint(self, at: int) -> tuple[int, int]:
        value = 0
        for index in range(8):
            byte = self.content[at + index]
            value = value << 7 | byte & 0x7F
            if byte < 0x80:
                return value, at + index + 1
        return value << 8 | self.content[at + 8], at + 9
