"""The companion's state in a file: the values of its parts, exactly, and a seal by which damage is
noticed.

Each part of the companion names in `SAVED` what it has learned; everything else follows from the
arguments.
"""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.companion.readings import CompanionError

SCHEMA = 5
"""Number of the format; files of another one are refused."""
DAMAGE = ArithmeticError, AttributeError, LookupError, TypeError, ValueError, zlib.error
"""Errors that reading a text raises that is no state, or that is of other code."""


def values_of(part: Any) -> dict[str, Any]:
    """Values of a part by their names, for JSON."""
    return {name: _encoded(getattr(part, name)) for name in part.SAVED}


def put_values(part: Any, values: dict[str, Any]) -> None:
    """Give a part its values; arrays have the type and the shape of the present ones.

    Raises:
        ArithmeticError, AttributeError, LookupError, TypeError, ValueError, zlib.error: They are of
            another part.
    """
    for name in part.SAVED:
        setattr(part, name, _decoded(values[name], getattr(part, name)))


def sealed(state: dict[str, Any]) -> dict[str, Any]:
    """A state with the number of its format and its seal."""
    numbered = {"schema": SCHEMA, **state}
    return {**numbered, "seal": _seal(numbered)}


def check_sealed(state: Any) -> None:
    """Check that a state is of this format and as it was written.

    Raises:
        CompanionError: It is not.
    """
    if not isinstance(state, dict) or state.get("schema") != SCHEMA:
        raise CompanionError(f"the state is of another version than {SCHEMA}, or is none")
    content = {name: value for name, value in state.items() if name != "seal"}
    try:
        as_written = _seal(content) == state.get("seal")
    except DAMAGE:
        as_written = False
    if not as_written:
        raise CompanionError("the state cannot be used: it is not as it was written")


def digest(text: str) -> str:
    """A short digest."""
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def _seal(state: dict[str, Any]) -> str:
    return digest(json.dumps(state, sort_keys=True))


def _encoded(value: Any) -> Any:
    if hasattr(value, "SAVED"):
        return values_of(value)
    if isinstance(value, np.ndarray):
        return base64.b85encode(zlib.compress(value.tobytes(), 9)).decode()
    if isinstance(value, dict):
        return dict(value)  # a state does not change with its companion
    return value


def _decoded(value: Any, present: Any) -> Any:
    if hasattr(present, "SAVED"):
        put_values(present, value)
        return present
    if isinstance(present, np.ndarray):
        return _unpacked(value, present)
    if isinstance(value, dict):
        return dict(value)
    return _with_tuples(value)


def _with_tuples(value: Any) -> Any:
    """A value with tuples where JSON has lists."""
    if isinstance(value, list):
        return tuple(map(_with_tuples, value))
    return value


def _unpacked(text: str, present: NDArray[Any]) -> NDArray[Any]:
    """An array of the type and shape of the present one."""
    # One byte more than fits shows a text that is too long, and no text can fill the memory.
    content = zlib.decompressobj().decompress(base64.b85decode(text), present.nbytes + 1)
    return np.frombuffer(content, present.dtype).reshape(present.shape).copy()
