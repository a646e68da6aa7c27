"""What made a verdict, beside the recordings: version, seed and thresholds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import homeward
from homeward import rules as shared
from homeward.diagnosis import rules
from homeward.diagnosis.result import MadeBy
from homeward.logs import rules as logs_rules
from homeward.physics import rules as physics_rules

_RULES = {"shared": shared, "physics": physics_rules, "logs": logs_rules, "diagnosis": rules}


def made_by(seed: int) -> MadeBy:
    """Version, seed and all thresholds, by the package and the name of each."""
    thresholds = {
        f"{package}.{name}": _plain(value)
        for package, module in _RULES.items()
        for name, value in vars(module).items()
        if name.isupper() and not name.startswith("_")
    }
    return MadeBy(homeward.__version__, seed, thresholds)


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, tuple | list | set | frozenset):
        parts = [_plain(part) for part in value]
        return parts if isinstance(value, tuple | list) else sorted(parts)
    return value if isinstance(value, bool | int | float | str) or value is None else str(value)
