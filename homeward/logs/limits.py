"""Limits on what is read from a file, used while it is read: a small file may unpack to more than
any memory holds."""

from __future__ import annotations

import bz2
import sys
from pathlib import Path
from typing import Any

from homeward.logs.columns import RecordingError

MOST_ROWS = 10_000_000
"""Most rows of a recording: 27 hours at 100 Hz. Chosen: bounds memory to some GB."""
MOST_BYTES = 2**30
"""Most bytes of a table, unpacked: that many rows of 100 characters."""
MOST_CELLS = 10_000_000
"""Most cells of a table in memory at a time. Chosen: some hundred MB; a recording has some tens of
columns."""
LONGEST_CELL = 1000
"""Most characters of a number or time. Chosen: they have some tens, and this bounds memory."""

MOST_UNPACKED_TIMES = 100
"""Times its own size to which a bag may unpack. Chosen: recordings unpack to 2 to 20 times their
size."""
LEAST_UNPACKED_BYTES = 2**26
"""Bytes to which any bag may unpack. Chosen: a chunk of a bag has about a MB, or one large
image."""
MOST_CHUNK_BYTES = 2**28
"""Most bytes of a chunk of a bag, unpacked. Chosen: the largest image or point cloud has some tens
of MB."""
MOST_TOPICS = 5000
"""Most topics of a bag. Chosen: robots have some hundred, cars that drive themselves a thousand."""
MOST_ELEMENTS = 10_000
"""Most numbers of a message that its definition counts. Chosen: an odometry has 88, the largest
standard ones hundreds."""
MOST_SEQUENCE = 1_000_000
"""Most parts of a list in a message. Chosen: status messages have some tens."""

_PIECE = 2**24  # bytes unpacked at a time; chosen: less than any memory


def zstd_module() -> Any:
    """The module, which the extra logs brings before Python 3.14."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd


def _unpacker(compression: str) -> Any:
    if compression == "bz2":
        return bz2.BZ2Decompressor()
    if compression == "zstd":
        return zstd_module().ZstdDecompressor()
    from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]  # of the extra logs

    return LZ4FrameDecompressor()


class TooLarge(RecordingError):
    """A recording beyond these limits."""


class Allowance:
    """The bytes to which a bag may still unpack.

    Args:
        packed_bytes: Size of its files.
    """

    def __init__(self, packed_bytes: int) -> None:
        self._most = max(LEAST_UNPACKED_BYTES, MOST_UNPACKED_TIMES * packed_bytes)
        self._left_bytes = self._most
        self._packed = packed_bytes

    def take(self, count: int) -> None:
        """Count unpacked bytes, or bytes of messages.

        Raises:
            TooLarge: They are more than are left.
        """
        self._left_bytes -= count
        if self._left_bytes < 0:
            raise TooLarge(
                f"has {self._packed / 1e6:.3g} MB and unpacks to more than {self._most / 1e6:.3g} MB, "
                "which no recording does; record or copy it again"
            )

    def unpack(self, compression: str, data: bytes, *, whole: bool = True) -> bytes:
        """Content of a chunk.

        Args:
            compression: "bz2", "lz4" or "zstd"; "" or "none" for none.
            data: The packed bytes.
            whole: Whether a chunk that is cut off or damaged is refused; otherwise what was
                unpacked before is given.

        Raises:
            TooLarge: It unpacks to more than the allowance or than a chunk has.
            Exception: It is cut off or damaged; what the unpackers raise.
        """
        if compression in ("", "none"):
            self.take(len(data))
            return data
        content = bytearray()
        try:
            while data:
                data = self._unpack_frame(_unpacker(compression), data, content)
        except TooLarge:
            raise
        except Exception:  # a damaged chunk raises anything, from OSError to zstd's own errors
            if whole:
                raise
        return bytes(content)

    def unpack_file(self, path: Path) -> None:
        """Count what a .zstd file unpacks to, without keeping it.

        Raises:
            TooLarge: It is more than the allowance.
            Exception: It is damaged; what the unpacker raises.
        """
        with zstd_module().open(path, "rb") as file:
            while piece := file.read(_PIECE):
                self.take(len(piece))

    def _unpack_frame(self, unpacker: Any, data: bytes, content: bytearray) -> bytes:
        """Append what a frame unpacks to; what follows the frame is returned."""
        piece = unpacker.decompress(data, _PIECE)
        while True:
            self.take(len(piece))
            content += piece
            if len(content) > MOST_CHUNK_BYTES:
                raise TooLarge(
                    f"has a chunk of more than {MOST_CHUNK_BYTES / 1e6:.3g} MB; record or copy it again"
                )
            if unpacker.eof:
                return bytes(unpacker.unused_data or b"")
            if not piece and unpacker.needs_input:
                raise EOFError("a chunk is cut off")
            piece = unpacker.decompress(b"", _PIECE)
