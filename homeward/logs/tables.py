"""Text tables of unknown format: encoding, separator and decimal sign, read piece by piece within
stated limits."""

from __future__ import annotations

import codecs
import contextlib
import csv
import gzip
import io
import itertools
import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

import pandas as pd

from homeward.files import open_regular
from homeward.installed import advice
from homeward.logs import limits, thresholds
from homeward.logs.columns import RecordingError

SUFFIXES = (".csv", ".csv.gz", ".tsv", ".txt")
"""Endings of their names."""

# bytes; chosen: a line of a recording has some hundred, and this bounds memory
_LONGEST_LINE = 2**20
_PIECE = 200_000  # rows at a time; chosen: some tens of MB
# bytes from which encoding, separator and decimal sign are inferred; chosen: hundreds of lines
_SNIFFED = 2**16
_SEPARATORS = (",", ";", "\t", "|")
_NAMES = {" ": "spaces", ";": "semicolons", "\t": "tabs", "|": "vertical bars", ",": "commas"}
_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
"""Encodings by the byte order mark at the start."""
_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*")
_DECIMAL_POINT = re.compile(r"\s*[-+]?\d*\.\d+([eE][-+]?\d+)?\s*")
_NUMBER = re.compile(r"\s*[-+]?[\d.]")  # or a date: start of a cell with a value
_ENDS = re.compile("\r\n|\n|\r")  # of lines, as in pandas
_BINARY = bytes(set(range(32)) - set(b"\t\n\r\f\x1b"))


class _Limited(io.RawIOBase):
    """A stream that raises on more bytes, or longer lines, than a recording has."""

    def __init__(self, file: BinaryIO, packed: bool) -> None:
        super().__init__()
        self._file = file
        self._bytes = 0
        self._line_bytes = 0  # of the last line, as far as it is read
        self._stream = cast(BinaryIO, gzip.GzipFile(fileobj=file, mode="rb")) if packed else file

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        data = self._stream.read(len(buffer))
        self._bytes += len(data)
        end = max(data.rfind(b"\n"), data.rfind(b"\r"))
        self._line_bytes = self._line_bytes + len(data) if end < 0 else len(data) - end - 1
        if self._bytes > limits.MOST_BYTES:
            raise RecordingError(
                f"holds more than {limits.MOST_BYTES / 1e9:.2g} GB, unpacked; cut it into several runs"
            )
        if self._line_bytes > _LONGEST_LINE:
            raise RecordingError(
                f"has a line of more than {_LONGEST_LINE} bytes; a recording has a line per sample"
            )
        buffer[: len(data)] = data
        return len(data)

    def close(self) -> None:
        self._stream.close()
        self._file.close()
        super().close()


def opened(path: Path) -> io.BufferedReader:
    """A file as a stream of bytes within the limits, unpacked where its name ends in .gz.

    Raises:
        OSError: It cannot be opened, or is a pipe or device.
    """
    return io.BufferedReader(_Limited(open_regular(path), path.suffix.lower() == ".gz"), 2**16)


@dataclass(frozen=True)
class TextTable:
    """Format of a text table.

    Attributes:
        path: The file.
        header: Names of its columns.
        separator, decimal: Between cells, and in numbers.
        encoding: As Python names it.
        notes: Differences from a plain CSV file, in a phrase each.
        skipped: Lines that are neither names nor samples, from 0: comments before the names, units
            after them.
        units: Of each column, where there is a line of them.
    """

    path: Path
    header: list[str]
    separator: str
    decimal: str
    encoding: str
    notes: tuple[str, ...]
    skipped: tuple[int, ...] = ()
    units: tuple[str, ...] = ()

    def pieces(self, columns: Sequence[str]) -> Iterator[pd.DataFrame]:
        """Some columns, piece by piece, by their names; the index counts the rows.

        Raises:
            RecordingError: The table is broken, or larger than the limits.
        """
        width = len(self.header)
        places = [self.header.index(name) for name in columns]
        is_last_cell_empty = False
        # All cells of a piece are in memory, also those of columns that are not read.
        rows = min(_PIECE, max(limits.MOST_CELLS // width, 1))
        with refusing(), opened(self.path) as file:
            source: Any = file
            encoding: str | None = self.encoding
            # pandas takes other text from a stream that is decoded already
            if self.encoding != "utf-8-sig":
                source = io.TextIOWrapper(file, self.encoding, newline="")
                encoding = None
            # The last column is read as well, so that a short last line differs from an empty last
            # cell.
            reader = pd.read_csv(
                source, encoding=encoding, sep=self.separator, decimal=self.decimal,
                skipinitialspace=True, header=0, names=range(width), usecols=[*places, width - 1], index_col=False,
                low_memory=False, chunksize=rows, skiprows=list(self.skipped),
            )  # fmt: skip
            for piece in reader:
                if len(piece) and piece.index[-1] >= limits.MOST_ROWS:
                    raise RecordingError(
                        f"has more than {limits.MOST_ROWS} rows; cut it into several runs"
                    )
                yield piece[places].set_axis(list(columns), axis="columns")
                is_last_cell_empty = len(piece) > 0 and bool(pd.isna(piece[width - 1].iloc[-1]))
        if is_last_cell_empty:
            self._refuse_cut_line()

    def _refuse_cut_line(self) -> None:
        """A last line with fewer cells than the header is one that was still being written."""
        tail = b""
        with refusing(), opened(self.path) as file:
            while piece := file.read(2**16):
                tail = (tail + piece)[-_LONGEST_LINE:]
        text = tail[len(tail) % 2 :] if self.encoding.startswith("utf-16") else tail
        lines = (
            text.decode(_tail_encoding(self.encoding, self.path), "replace")
            .rstrip("\r\n")
            .splitlines()
        )
        cells = len(lines[-1].split(self.separator)) if lines else 0
        if cells < len(self.header):
            raise RecordingError(
                f"the last line is cut off ({cells} of {len(self.header)} cells); delete it or record again"
            )


def sniff(path: Path, separator: str | None = None, decimal: str | None = None) -> TextTable:
    """Infer the format of a text table from its beginning.

    Args:
        path: The file.
        separator, decimal: Known parts of the format.

    Raises:
        RecordingError: It is not text, has no header line, or both its cells and its decimals use
            commas.
    """
    with refusing(), opened(path) as file:
        start = file.read(_SNIFFED)
    if not start.strip():
        raise RecordingError("holds no samples")
    encoding = _encoding(start)
    comments, lines = _comments(_lines(start, encoding))
    if not lines:
        raise RecordingError("holds no samples")
    if separator is None:
        separator = _separator([line.text for line in lines[:20]])
    header, *rows = (_cells_of(line.text, separator) for line in lines[:200])
    skipped = [line.number for line in comments]
    units: list[str] = []
    if len(rows) > 1 and _are_units(rows[0], rows[1]):
        units = rows.pop(0)
        skipped.append(lines[1].number)
    if decimal is None:
        decimal = "," if _has_decimal_commas(rows) else "."
    _refuse_wide(rows, header, separator)
    notes = _notes(encoding, separator, decimal, len(comments), bool(units))
    return TextTable(
        path=path,
        header=header,
        separator=separator,
        decimal=decimal,
        encoding=encoding,
        notes=notes,
        skipped=tuple(skipped),
        units=tuple(units),
    )


class _Line(NamedTuple):
    """A line of a file, and its number from 0."""

    number: int
    text: str


def _lines(start: bytes, encoding: str) -> list[_Line]:
    """The lines in the beginning of a file that are not empty; one that may go on after it is left
    out."""
    is_whole = len(start) < _SNIFFED
    try:
        text = codecs.getincrementaldecoder(encoding)().decode(start, is_whole)
    except UnicodeDecodeError as error:
        raise RecordingError(
            "is not text but binary data; a recording is CSV or Parquet"
        ) from error
    texts = _ENDS.split(text)
    if not is_whole:
        texts.pop()
    return [_Line(number, text) for number, text in enumerate(texts) if text.strip()]


def _comments(lines: Sequence[_Line]) -> tuple[list[_Line], list[_Line]]:
    """The lines that begin with # before the names, and the other lines from the names on.

    Names may stand behind a # themselves, as NumPy writes them: then samples follow at once.
    """
    comments = list(itertools.takewhile(lambda line: line.text.startswith("#"), lines))
    table = list(lines[len(comments) :])
    if comments and table and _NUMBER.match(table[0].text):
        names = comments.pop()
        table.insert(0, names._replace(text=names.text.lstrip("# ")))
    return comments, table


def _cells_of(line: str, separator: str) -> list[str]:
    """Cells of a line without the spaces around them."""
    return [cell.strip() for cell in _cells(line, separator)]


def _separator(lines: Sequence[str]) -> str:
    """Separator with most cells in the line of names; spaces if no other occurs and all lines have
    equally many."""
    names = lines[0]
    most_used = max(_SEPARATORS, key=lambda separator: len(_cells(names, separator)))
    if len(_cells(names, most_used)) != 1:
        return most_used
    widths = {sum(cell != "" for cell in _cells(line, " ")) for line in lines}
    has_columns = len(widths) == 1 and widths != {1}
    return " " if has_columns else most_used


def _are_units(row: Sequence[str], following: Sequence[str]) -> bool:
    """Whether a line below the names holds texts, and the next one numbers."""
    return any(row) and not any(map(_NUMBER.match, row)) and any(map(_NUMBER.match, following))


def _encoding(start: bytes) -> str:
    """Encoding of a text by its beginning.

    Raises:
        RecordingError: It is no text.
    """
    for mark, encoding in _MARKS.items():
        if start.startswith(mark):
            return encoding
    if start.translate(None, _BINARY) != start:
        raise RecordingError("is not text but binary data; a recording is CSV or Parquet")
    try:
        start[: start.rfind(b"\n") + 1 or None].decode("utf-8")
    except UnicodeDecodeError:
        header = start.splitlines()[0]
        if sum(byte >= 0x80 for byte in header) > thresholds.MOST_NOT_ASCII_SHARE * len(header):
            raise RecordingError(
                "is not text but binary data; a recording is CSV or Parquet"
            ) from None
        return "cp1252"
    return "utf-8-sig"


def _tail_encoding(encoding: str, path: Path) -> str:
    """The encoding of a part that does not begin with the mark."""
    if encoding != "utf-16":
        return encoding
    with opened(path) as file:
        return "utf-16-le" if file.read(2) == b"\xff\xfe" else "utf-16-be"


def _cells(line: str, separator: str) -> list[str]:
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])


def _has_decimal_commas(rows: Sequence[Sequence[str]]) -> bool:
    cells = [cell for row in rows for cell in row]
    return any(map(_DECIMAL_COMMA.fullmatch, cells)) and not any(
        map(_DECIMAL_POINT.fullmatch, cells)
    )


def _refuse_wide(rows: Sequence[Sequence[str]], header: Sequence[str], separator: str) -> None:
    """Rows with more cells than names: their numbers have decimal commas, or a name is missing."""
    for number, row in enumerate(rows, start=1):
        if any(cell.strip() for cell in row[len(header) :]):
            hint = (
                "; numbers with decimal commas need another separator, such as ;"
                if separator == ","
                else ""
            )
            raise RecordingError(
                f"row {number} has {len(row)} cells, the header {len(header)}{hint}"
            )


def _notes(
    encoding: str, separator: str, decimal: str, comments: int, units: bool
) -> tuple[str, ...]:
    notes = []
    if encoding != "utf-8-sig":
        notes.append(f"encoding {encoding}")
    if separator != ",":
        notes.append(f"cells separated by {_NAMES.get(separator, repr(separator))}")
    if decimal != ".":
        notes.append("decimal commas")
    if comments:
        counted = "1 line" if comments == 1 else f"{comments} lines"
        notes.append(f"{counted} of comment before the names left out")
    if units:
        notes.append("the line of units after the names left out")
    return tuple(notes)


@contextlib.contextmanager
def opened_parquet(path: Path) -> Iterator[Any]:
    """A Parquet file whose texts are kept once each, however often they occur, see `in_pandas`.

    Raises:
        OSError: It cannot be opened, or is a pipe or device.
        RecordingError: It is no whole Parquet file, or pyarrow is not installed.
    """
    try:
        # a robot has no Parquet files, and it is as large as all else that a robot needs
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ModuleNotFoundError:
        raise RecordingError(
            f"is a Parquet file, which needs pyarrow: {advice('diagnose', 'pyarrow')}"
        ) from None
    with open_regular(path) as stream:
        try:
            schema = pq.read_schema(stream)
            texts = [
                field.name
                for field in schema
                if pa.types.is_string(field.type) or pa.types.is_binary(field.type)
            ]
            stream.seek(0)
            with pq.ParquetFile(stream, read_dictionary=texts) as file:
                yield file
        except (RecordingError, MemoryError):
            raise
        # damaged metadata raises anything, from ArrowException to UnicodeDecodeError
        except Exception as error:
            message = (str(error).splitlines() or [""])[0][:200]
            raise RecordingError(
                f"is not a whole Parquet file ({message}); copy or record it again"
            ) from error


def in_pandas(batch: Any) -> pd.DataFrame:
    """Rows of a Parquet file; texts longer than a number or time are refused before they are copied
    for each row."""
    import pyarrow as pa  # `opened_parquet` has found it
    import pyarrow.compute as pc

    columns = {}
    for name, column in zip(batch.schema.names, batch.columns, strict=True):
        if pa.types.is_nested(column.type):
            raise RecordingError(
                f"{name} holds lists or tables; a column has a number or a time in each row"
            )
        if pa.types.is_dictionary(column.type):
            longest = pc.max(pc.binary_length(column.dictionary)).as_py() or 0
            if longest > limits.LONGEST_CELL:
                raise RecordingError(
                    f"{name} holds a text of {longest} bytes, which is no number or time"
                )
            column = column.dictionary_decode()
        columns[name] = column.to_pandas()
    return pd.DataFrame(columns)


class refusing:
    """Context that turns what the readers of text and gzip raise into a `RecordingError`."""

    def __enter__(self) -> None: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: Any
    ) -> None:
        if isinstance(error, EOFError | zlib.error | gzip.BadGzipFile):
            raise RecordingError(
                f"is not a whole gzip file ({error}); copy or record it again"
            ) from error
        if isinstance(error, UnicodeError | csv.Error):
            raise RecordingError(
                "is not text but binary data; a recording is CSV or Parquet"
            ) from error
        if isinstance(error, pd.errors.EmptyDataError):
            raise RecordingError("holds no samples") from error
        if isinstance(error, pd.errors.ParserError):
            raise RecordingError(f"is not a table: {str(error).splitlines()[0]}") from error
