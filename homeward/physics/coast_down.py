"""The table `[coast_down]` of a robot file: forces measured at the wheels and a weighed mass, with
their errors.

A robot that rolls out on level ground slows down by F = a + b v + c v^2. a is its rolling
resistance, b friction that grows with speed (effect `viscous`) and c its drag. The losses of the
drive are in none of them.
"""

from __future__ import annotations

import numbers
from collections.abc import Mapping
from typing import Any, NamedTuple

from homeward.physics.effects.viscous import EFFECT as VISCOUS
from homeward.physics.intervals import Bounds
from homeward.physics.model import GRAVITY_MPS2
from homeward.physics.uncertainty import Uncertainty, UncertaintyError

_DRAG = VISCOUS.switch
_MASS_SD = "mass_sd_kg"
_SD_OF = {"a_sd_n": "a_n", "b_sd_ns_per_m": "b_ns_per_m", "c_sd_ns2_per_m2": "c_ns2_per_m2"}
_NAMES = {"a_n": "rolling", "b_ns_per_m": f"{VISCOUS.id}.{_DRAG.name}", "c_ns2_per_m2": "drag"}
"""Names in `[uncertainty]`."""
_FORCE = Bounds(0.0, 1e6)
_SD = Bounds(0.0, 1e6, open_low=True)
_BOUNDS = {"b_ns_per_m": Bounds(_DRAG.low, _DRAG.high), **dict.fromkeys((*_SD_OF, _MASS_SD), _SD)}
_KNOWN = ("source", *_SD_OF.values(), *_SD_OF, _MASS_SD)


class CoastDown(NamedTuple):
    """What the table gives.

    Attributes:
        body: Numbers of `[body]`.
        effects: Tables of `[effects]`.
        uncertainty: Errors of force and mass; None if none is stated.
    """

    body: dict[str, float]
    effects: dict[str, dict[str, float]]
    uncertainty: Uncertainty | None


def from_table(table: Any, mass_kg: Any) -> CoastDown:
    """Read the table.

    Args:
        table: The table as it stands in the file.
        mass_kg: Mass of the robot in the test, that of the file, kg.

    Raises:
        UncertaintyError: A field is unknown or a value not allowed.
    """
    values = _values(table)
    if not _is_number(mass_kg) or not mass_kg > 0.0:
        raise UncertaintyError(
            "coast_down needs body.mass_kg, the mass of the robot in the test; give it in kg"
        )
    body: dict[str, float] = {}
    if "a_n" in values:
        body["rolling_resistance"] = values["a_n"] / (mass_kg * GRAVITY_MPS2)
    if "c_ns2_per_m2" in values:
        body["drag_ns2_per_m2"] = values["c_ns2_per_m2"]
    effects: dict[str, dict[str, float]] = {}
    if "b_ns_per_m" in values:
        effects[VISCOUS.id] = {_DRAG.name: values["b_ns_per_m"]}
    shares = {_NAMES[size]: _share(values, sd, size) for sd, size in _SD_OF.items() if sd in values}
    if _MASS_SD in values:
        shares["mass"] = values[_MASS_SD] / float(mass_kg)
    uncertainty = None
    if shares:
        source = table.get("source") or "a coast-down test; no source given"
        uncertainty = Uncertainty(
            source=source, fitted=tuple(shares), covariance=_diagonal(shares), of="force"
        )
    return CoastDown(body, effects, uncertainty)


def _values(table: Any) -> dict[str, float]:
    """The numbers of the table by field, checked."""
    if not isinstance(table, Mapping):
        raise UncertaintyError(f"coast_down = {table!r} is not a table")
    for name in table:
        if name not in _KNOWN:
            raise UncertaintyError(
                f"coast_down.{name} is not a known field; known: {', '.join(_KNOWN)}"
            )
    if not isinstance(table.get("source", ""), str):
        raise UncertaintyError(f"coast_down.source = {table['source']!r} is not a text")
    return {name: _checked(name, value) for name, value in table.items() if name != "source"}


def _diagonal(shares: Mapping[str, float]) -> tuple[tuple[float, ...], ...]:
    """Covariance of independent errors of these standard deviations."""
    rows = []
    for row, share in enumerate(shares.values()):
        variances = [0.0] * len(shares)
        variances[row] = share**2
        rows.append(tuple(variances))
    return tuple(rows)


def _share(values: Mapping[str, float], sd: str, size: str) -> float:
    """A standard deviation over its value."""
    if not values.get(size, 0.0) > 0.0:
        raise UncertaintyError(f"coast_down.{sd} needs {size} above 0; give both, or neither")
    return values[sd] / values[size]


def _checked(name: str, value: Any) -> float:
    bounds = _BOUNDS.get(name, _FORCE)
    if not _is_number(value) or not bounds.hold(value):
        remedy = ""
        if name == "b_ns_per_m":
            remedy = "; fit F = a + c v^2 without b"
        raise UncertaintyError(
            f"coast_down.{name} = {value!r} is not allowed; give a number in {bounds}{remedy}"
        )
    return float(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not isinstance(value, bool)
