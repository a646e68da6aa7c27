"""The companion's state in a file: the values of its parts, exactly, and a seal by which damage is
noticed.

Each part of the companion names in `SAVED` what it has learned; everything else follows from the
arguments. The values of a state must look as those of a fresh companion do: the same names, types
and shapes, and finite where those are. `MAY_BE` of a part has examples for a value that changes its type; a
list of one example stands for any number of values like it, in a list or by their names. `WITHIN`
has the limits of values that have their own.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
import zlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.companion.readings import CompanionError

SCHEMA = 5
"""Number of the format; files of another one are refused."""
DAMAGE = (
    ArithmeticError,
    AttributeError,
    LookupError,
    RecursionError,
    TypeError,
    ValueError,
    zlib.error,
)
"""Errors that reading a text raises that is no state, or that is of other code."""


_LARGEST = 1e15
"""Largest number of a state, in any unit. Chosen: above any time, way and energy of a robot, and
its cube is finite."""
_MOST_COUNT = 2**53
"""Largest count: beyond it a float of 64 bits has gaps."""


class _Looks(NamedTuple):
    """What a value looks like: examples, and limits of each finite number."""

    examples: tuple[Any, ...]
    limits: tuple[float, float]


def form_of(part: Any) -> dict[str, Any]:
    """What the values of a fresh part look like: the form of each part in it, and of each other
    value its examples and its limits."""
    may_be = getattr(part, "MAY_BE", {})
    within = getattr(part, "WITHIN", {})
    form: dict[str, Any] = {}
    for name in part.SAVED:
        value = getattr(part, name)
        if hasattr(value, "SAVED"):
            form[name] = form_of(value)
            continue
        if isinstance(value, np.ndarray):
            value = value.copy()
        elif isinstance(value, np.generic):
            value = value.item()  # as JSON has it
        examples = (value, *may_be.get(name, ()))
        form[name] = _Looks(examples, within.get(name, (-_LARGEST, _LARGEST)))
    return form


def check_form(values: Any, form: dict[str, Any]) -> None:
    """Check that values from JSON look as those of a fresh part do.

    Raises:
        ArithmeticError, AttributeError, LookupError, TypeError, ValueError, zlib.error: They do
            not.
    """
    if not isinstance(values, dict) or values.keys() != form.keys():
        raise ValueError("it has other values than a companion writes")
    for name, looks in form.items():
        value = values[name]
        if isinstance(looks, dict):
            check_form(value, looks)
        elif not any(_is_like(value, example, looks.limits) for example in looks.examples):
            raise ValueError(f"{name.lstrip('_')} is none that a companion writes")


def _is_like(value: Any, example: Any, limits: tuple[float, float]) -> bool:
    """Whether a value has the type of an example, its numbers are within limits or, as in the
    example, not finite, and no count is negative."""
    if isinstance(example, np.ndarray):
        return _is_array_like(_unpacked(value, example), example, limits)
    if isinstance(example, list):
        inner = value.values() if isinstance(value, dict) else value
        return isinstance(value, dict | list | tuple) and all(
            _is_like(item, example[0], limits) for item in inner
        )
    if isinstance(example, dict):
        return (
            isinstance(value, dict)
            and value.keys() == example.keys()
            and all(_is_like(value[name], example[name], limits) for name in example)
        )
    if isinstance(example, tuple):
        return (
            isinstance(value, list | tuple)
            and len(value) == len(example)
            and all(
                _is_like(item, its_example, limits)
                for item, its_example in zip(value, example, strict=True)
            )
        )
    if isinstance(value, bool) or isinstance(example, bool):
        return isinstance(value, bool) and isinstance(example, bool)
    if isinstance(example, float):
        return isinstance(value, float | int) and _is_number_like(value, example, limits)
    if isinstance(example, int):
        return isinstance(value, int) and 0 <= value <= _MOST_COUNT
    return isinstance(value, type(example))


def _is_number_like(value: float, example: float, limits: tuple[float, float]) -> bool:
    if math.isfinite(value):
        return limits[0] <= value <= limits[1]
    return not math.isfinite(example)


def _is_array_like(array: NDArray[Any], fresh: NDArray[Any], limits: tuple[float, float]) -> bool:
    """The same of arrays of one type and shape."""
    if fresh.dtype.names is not None:
        return all(_is_array_like(array[name], fresh[name], limits) for name in fresh.dtype.names)
    within = (array >= limits[0]) & (array <= limits[1])
    is_open = ~np.isfinite(array) & ~np.isfinite(fresh)
    return bool(np.all(within | is_open))


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
    if isinstance(present, float) and isinstance(value, int):
        return float(value)  # some writers of JSON have 1 for 1.0
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
