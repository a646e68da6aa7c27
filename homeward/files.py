"""Files that are written whole or not at all."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

_MOST_BYTES = 1_000_000
"""More than any JSON that the project reads of a run or a policy: some kilobytes."""


def read_json(path: Path) -> Any:
    """What a small JSON file holds.

    Raises:
        ValueError: It is no JSON, no regular file, or too large to be one of the project's.
        OSError: It cannot be read.
    """
    if path.exists() and not path.is_file():
        raise ValueError("not a regular file")
    with path.open("rb") as file:
        content = file.read(_MOST_BYTES + 1)
    if len(content) > _MOST_BYTES:
        raise ValueError(f"larger than {_MOST_BYTES} bytes")
    try:
        return json.loads(content)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file under a temporary name beside it and rename it; its folder is made where it is missing.

    Args:
        path: Where to; an older file there is replaced.
        content: Text, written as UTF-8, or bytes.

    Raises:
        OSError: The folder cannot be written to; whatever was there before is still there.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
