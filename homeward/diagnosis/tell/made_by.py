"""What made a verdict, beside the recordings: version, seed, thresholds, and effects of one's own."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import homeward
from homeward import thresholds as shared
from homeward.diagnosis import thresholds
from homeward.diagnosis.result import MadeBy
from homeward.logs import thresholds as logs_thresholds
from homeward.own_effects import own_file
from homeward.physics import thresholds as physics_thresholds

_MODULES = {"shared": shared, "physics": physics_thresholds, "logs": logs_thresholds, "diagnosis": thresholds}


def made_by(seed: int) -> MadeBy:
    """Version, seed and all thresholds, by the package and the name of each."""
    values = {
        f"{package}.{name}": _plain(value)
        for package, module in _MODULES.items()
        for name, value in vars(module).items()
        if name.isupper() and not name.startswith("_")
    }
    own = own_file()
    own_effects = {} if own is None else {own.name: hashlib.sha256(own.read_bytes()).hexdigest()}
    return MadeBy(homeward.__version__, seed, values, own_effects)


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, tuple | list | set | frozenset):
        parts = [_plain(part) for part in value]
        return parts if isinstance(value, tuple | list) else sorted(parts)
    return value if isinstance(value, bool | int | float | str) or value is None else str(value)
