"""What made a verdict, beside the recordings: version, seed, thresholds, and effects of one's
own."""

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

_MODULES = {
    "shared": shared,
    "physics": physics_thresholds,
    "logs": logs_thresholds,
    "diagnosis": thresholds,
}


def made_by(seed: int) -> MadeBy:
    """Version, seed and all thresholds, by the package and the name of each."""
    values = {}
    for package, module in _MODULES.items():
        for name, value in vars(module).items():
            if name.isupper() and not name.startswith("_"):
                values[f"{package}.{name}"] = _plain(value)
    own_effects = {}
    file = own_file()
    if file is not None:
        own_effects[file.name] = hashlib.sha256(file.read_bytes()).hexdigest()
    return MadeBy(homeward.__version__, seed, values, own_effects)


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(part) for part in value]
    if isinstance(value, set | frozenset):
        return sorted(_plain(part) for part in value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return str(value)
