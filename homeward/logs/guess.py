"""A guess of which channel a column is: its unit, how sure it is and why, and its line of a mapping
file."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

_DEGREE = np.pi / 180.0

SURE = ("certain", "likely", "a guess")
"""Confidence of a proposal: by name and unit; by name, with fitting values; by a weak name, values
or unit alone."""

_LENGTH = {
    "m": 1.0,
    "metre": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "km": 1e3,
    "cm": 1e-2,
    "mm": 1e-3,
    "ft": 0.3048,
}
_ANGLE = {
    "rad": 1.0,
    "radians": 1.0,
    "deg": _DEGREE,
    "degree": _DEGREE,
    "degrees": _DEGREE,
    "°": _DEGREE,
}
_SPEED = {
    "m/s": 1.0, "mps": 1.0, "km/h": 1 / 3.6, "kmh": 1 / 3.6, "kph": 1 / 3.6, "mph": 0.44704, "cm/s": 1e-2, "mm/s": 1e-3,
}  # fmt: skip
_RATE = {
    "rad/s": 1.0, "radps": 1.0, "rads": 1.0, "deg/s": _DEGREE, "degps": _DEGREE, "dps": _DEGREE, "°/s": _DEGREE,
}  # fmt: skip
_CURRENT = {"a": 1.0, "ma": 1e-3, "amp": 1.0, "amps": 1.0}
UNITS: dict[str, dict[str, float]] = {
    "s": {
        "s": 1.0,
        "sec": 1.0,
        "secs": 1.0,
        "seconds": 1.0,
        "ms": 1e-3,
        "us": 1e-6,
        "ns": 1e-9,
        "min": 60.0,
    },
    "m/s": _SPEED,
    "rad/s": _RATE,
    "rad": _ANGLE | {"%": 1e-2, "percent": 1e-2},
    "m": _LENGTH,
    "W": {"w": 1.0, "watt": 1.0, "watts": 1.0, "kw": 1e3, "mw": 1e-3},
    "V": {"v": 1.0, "volt": 1.0, "volts": 1.0, "mv": 1e-3},
    "A": _CURRENT,
    "Hz": {"hz": 1.0, "khz": 1e3, "fps": 1.0},
    "1": {"%": 1e-2, "percent": 1e-2, "pct": 1e-2, "percentage": 1e-2},
    "degC": {"c": 1.0, "°c": 1.0, "degc": 1.0, "celsius": 1.0, "k": 1.0, "f": 5 / 9, "°f": 5 / 9},
    "kg": {"kg": 1.0, "g": 1e-3, "lb": 0.45359237, "lbs": 0.45359237},
}
"""Factors to SI by the unit of a channel."""
OFFSETS = {"k": -273.15, "f": -160.0 / 9.0, "°f": -160.0 / 9.0}


LEAST_SURE = len(SURE) - 1


@dataclass(frozen=True)
class Guess:
    """The channel proposed for a column, or for a sum of columns."""

    column: str
    channel: str
    factor: float
    offset: float
    sure: int  # index into SURE
    why: str
    by_values: bool = False  # whether the unit follows from the values alone
    and_column: str = ""  # that is added: a time of day to a date

    def entry(self) -> str:
        """Its line of a mapping file."""
        name = json.dumps(self.column, ensure_ascii=False)
        if self.and_column:
            value = f"{{ columns = [{name}, {json.dumps(self.and_column, ensure_ascii=False)}] }}"
        elif self.factor == 1.0 and self.offset == 0.0:
            value = name
        else:
            offset = f", offset = {self.offset:.10g}" if self.offset else ""
            value = f"{{ column = {name}, factor = {_toml_number(self.factor)}{offset} }}"
        return f"{self.channel} = {value}  # {SURE[self.sure]}: {one_line(self.why)}"


def _toml_number(value: float) -> str:
    text = f"{value:.12g}"
    is_float = "." in text or "e" in text
    return text if is_float else f"{text}.0"


def one_line(text: str) -> str:
    """A text that ends no comment of a mapping file."""
    return "".join(character if character.isprintable() else "?" for character in text)
