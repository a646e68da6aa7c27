"""Files that are read within limits, and written completely or not at all."""

from __future__ import annotations

import contextlib
import csv
import errno
import io
import json
import os
import re
import secrets
import stat
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

STANDARD_INPUT = "-"
"""Name of standard input."""

_MOST_BYTES = 1_000_000
"""Limit for the project's settings files, TOML or JSON, which have some kilobytes. Chosen."""
_DEEPEST = 20
"""Limit of their nesting. Chosen: they have three levels."""


def open_regular(path: str | Path) -> BinaryIO:
    """Open a regular file for reading; a pipe or device is refused without waiting for it or
    reading from it.

    Raises:
        OSError: It cannot be opened, or is something else.
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    mode = os.fstat(handle).st_mode
    if stat.S_ISREG(mode):
        try:
            if hasattr(os, "pread"):
                os.pread(handle, 1, 0)  # files of /proc may fail, or wait for what comes
        except OSError as error:
            os.close(handle)
            raise OSError(error.errno, error.strerror, str(path)) from None
        return os.fdopen(handle, "rb")
    os.close(handle)
    kind = "a folder" if stat.S_ISDIR(mode) else "a pipe or device"
    raise OSError(errno.EINVAL, f"is {kind}, not a file", str(path))


def read_bytes(path: str | Path, most_bytes: int = _MOST_BYTES) -> bytes:
    """Content of a regular file or, if the path is "-", of standard input.

    Args:
        path: The file.
        most_bytes: Larger files are refused before they fill the memory.

    Raises:
        ValueError: It is larger.
        OSError: It cannot be read.
    """
    if str(path) == STANDARD_INPUT:
        content = sys.stdin.buffer.read(most_bytes + 1)
    else:
        with open_regular(path) as file:
            content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise ValueError(f"larger than {most_bytes} bytes")
    return content


def read_text(path: str | Path, most_bytes: int = _MOST_BYTES) -> str:
    """Like `read_bytes`, decoded as UTF-8, with or without a byte order mark; a ValueError for
    other encodings."""
    return read_bytes(path, most_bytes).decode("utf-8-sig")


def read_json(path: str | Path) -> Any:
    """Content of a small JSON file.

    Raises:
        ValueError: It is not JSON, larger than the project's files, or nested too deeply.
        OSError: It cannot be read, or is not a regular file.
    """
    content = read_bytes(path)
    try:
        data = json.loads(content)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    refuse_deep(data)
    return data


def read_toml(path: str | Path) -> dict[str, Any]:
    """Content of a small TOML file.

    Raises:
        ValueError: It is not TOML, larger than the project's files, or nested too deeply.
        OSError: It cannot be read, or is not a regular file.
    """
    text = read_text(path)
    # A key of many dots costs the parser quadratic time and memory; a table of numbers does not.
    for line in text.splitlines():
        has_key = "=" in line or line.lstrip()[:1] == "["
        if has_key and line.count(".") > _MOST_DOTS and not _NUMBERS.fullmatch(line):
            raise ValueError("a line has too many dots")
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    refuse_deep(data)
    return data


_MOST_DOTS = 1000
"""Limit in a line of a settings file. Chosen: a parser takes no notable time for a key of so
many."""
_NUMBERS = re.compile(r"\s*\w+\s*=[-+\de.,\s\[\]]*(#.*)?", re.ASCII)
"""A line with nothing but numbers, such as a covariance."""


def refuse_deep(data: Any) -> None:
    """Raise ValueError if lists and tables are nested deeper than in settings files; they could not
    be shown."""
    level = [data]
    depth = 0
    while level:
        if depth > _DEEPEST:
            raise ValueError("nested too deeply")
        next_level: list[Any] = []
        for value in level:
            if isinstance(value, Mapping):
                next_level.extend(value.values())
            elif isinstance(value, list):
                next_level.extend(value)
        level = next_level
        depth += 1


def write_whole(path: str | Path, content: str | bytes) -> None:
    """Write a file under a temporary name beside it and rename it; missing folders are created.

    Args:
        path: Path of the file; an older one is replaced.
        content: Text, written as UTF-8, or bytes.

    Raises:
        OSError: The folder cannot be written to; an older file remains.
    """
    path = Path(path)
    if isinstance(content, str):  # names of files that are no UTF-8 cannot be written as such
        content = content.encode("utf-8", "replace")
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        # As any file of the user, so that the umask says who may read it.
        handle = os.open(
            temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666
        )
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        temporary.replace(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError):  # name the file, and not the temporary one
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise


def csv_text(rows: Iterable[Sequence[Any]]) -> str:
    """Rows of a table as text; a name that a spreadsheet would run as a formula begins with an
    apostrophe.

    Source: OWASP, CSV Injection.

    >>> csv_text([("name", "score"), ("=1+1", -2.5)])
    "name,score\\n'=1+1,-2.5\\n"
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows(map(no_formula, row) for row in rows)
    return text.getvalue()


def no_formula(cell: Any) -> Any:
    """A cell of a table as it is, or after an apostrophe, see `csv_text`."""
    if not isinstance(cell, str) or not cell.startswith(("=", "+", "-", "@", "\t", "\r")):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def write_files(folder: str | Path, files: Mapping[str, str | bytes]) -> list[Path]:
    """Write files of a folder by name, each whole or not at all.

    Raises:
        OSError: The folder cannot be written to.
    """
    folder = Path(folder)
    check_writable(folder)
    for name, content in files.items():
        write_whole(folder / name, content)
    return [folder / name for name in files]


def check_writable(folder: str | Path) -> None:
    """Make the output folder and check that a file can be written there, before any work is done.

    Raises:
        OSError: It cannot.
    """
    Path(folder).mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass
