"""A robot: the parameters of the model, read from a TOML file, checked, and turned into a record for compiled
kernels."""

from __future__ import annotations

import dataclasses
import difflib
import functools
import itertools
import numbers
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.files import STANDARD_INPUT, read_toml
from homeward.own_effects import REMEDY
from homeward.physics import battery, coast_down, model, thresholds
from homeward.physics.effects import EFFECTS, PARAMETER_FIELDS, Effect
from homeward.physics.intervals import Bounds
from homeward.physics.plausible import warn_of_implausible
from homeward.physics.uncertainty import Uncertainty, UncertaintyError, from_table


class RobotError(ValueError):
    """A robot file or value that cannot be used: the message names the field, the value and what is allowed."""


def _quantity(section: str, meaning: str, bounds: Bounds, default: float | None = None) -> Any:
    """Declare one number of the robot file: section, meaning and allowed values."""
    metadata = {"section": section, "meaning": meaning, "bounds": bounds}
    return field(metadata=metadata) if default is None else field(default=default, metadata=metadata)


# Chosen: far beyond any robot, and safe from overflow; `homeward.physics.plausible` has the typical ranges.
_POSITIVE = Bounds(0.0, 1e6, open_low=True)
_NOT_NEGATIVE = Bounds(0.0, 1e6)
_SPEED = Bounds(0.0, 100.0, open_low=True)
_LOSS = Bounds(0.0, 1.0, open_high=True)


@dataclass(frozen=True)
class Robot:
    """A ground robot on one battery charge: the parameters of the battery-dissemination model, all in SI units.

    It is frozen: `dataclasses.replace(robot, mass_kg=1.0)` returns a changed copy, checked as a file is checked.
    Derived quantities are properties.

    Raises:
        RobotError: A value is missing, not a number or outside what is physically allowed.

    Source: Tiwari, Xiao, Chong (IROS 2018); symbols in the comments are the paper's.
    """

    name: str
    mass_kg: float = _quantity("body", "moving mass m_R, kg", _POSITIVE)
    rolling_resistance: float = _quantity(
        "body", "rolling resistance coefficient C_rr", Bounds(0.0, 1.0, open_low=True)
    )
    drag_ns2_per_m2: float = _quantity("body", "c of the air drag c v^2, N s^2/m^2", _NOT_NEGATIVE)
    rated_energy_j: float = _quantity("battery", "rated battery energy E_O, J", Bounds(0.0, 1e12, open_low=True))
    nominal_voltage_v: float = _quantity("battery", "nominal battery voltage, V", _POSITIVE)
    motor_loss: float = _quantity("drive", "motor loss eta2, a share", _LOSS)
    friction_loss: float = _quantity("drive", "internal friction loss eta3, a share", _LOSS)
    min_speed_mps: float = _quantity("drive", "slowest driving speed, m/s", _SPEED)
    max_speed_mps: float = _quantity("drive", "fastest driving speed, m/s", _SPEED)
    sensing_idle_w: float = _quantity("ancillary", "idle power of the sensors s0, W", _NOT_NEGATIVE)
    sensing_j_per_sample: float = _quantity("ancillary", "energy per sample s1, J", _NOT_NEGATIVE)
    max_sensing_hz: float = _quantity("ancillary", "fastest sensing rate, Hz", _POSITIVE)
    communication_w: float = _quantity("ancillary", "radio, part of P_C, W", _NOT_NEGATIVE)
    controller_w: float = _quantity("ancillary", "micro-controller, part of P_C, W", _NOT_NEGATIVE)
    computer_w: float = _quantity("ancillary", "computer when sensing starts, part of P_C, W", _NOT_NEGATIVE, 0.0)
    computer_j_per_sample: float = _quantity("ancillary", "rise of the computer's power per Hz, J", _NOT_NEGATIVE, 0.0)
    ancillary_loss: float = _quantity("ancillary", "ancillary loss eta4, a share", _LOSS, 0.0)
    cycles: float = _quantity("battery", "charge cycles C, in the unit k1 is per", _NOT_NEGATIVE, 0.0)
    age: float = _quantity("battery", "age t, in the unit k2 is per", _NOT_NEGATIVE, 0.0)
    cycle_fade: float = _quantity("battery", "k1, fade per unit of cycles", _NOT_NEGATIVE, 0.0)
    age_fade: float = _quantity("battery", "k2, fade per unit of age", _NOT_NEGATIVE, 0.0)
    storage_loss: float = _quantity("battery", "battery loss eta1, a share", _LOSS, 0.0)
    track_m: float = _quantity("body", "distance between left and right wheels, m (0: unknown)", _NOT_NEGATIVE, 0.0)
    traction_n_per_a: float = _quantity("drive", "wheel thrust per ampere, N/A (0: unknown)", _NOT_NEGATIVE, 0.0)
    rest_current_a: float = _quantity("drive", "motor current at rest, A", _NOT_NEGATIVE, 0.0)
    description: str = ""
    chemistry: str = battery.FLAT
    cells_in_series: int = 0
    open_circuit_v: tuple[tuple[float, float], ...] = ()
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict, hash=False)
    uncertainty: Uncertainty | None = None

    def __post_init__(self) -> None:
        for name in ("name", "description"):
            text = getattr(self, name)
            if not isinstance(text, str) or (name == "name" and not text):
                raise RobotError(f"{name} = {text!r} is not a text; allowed: a text in quotes")
        for quantity in _QUANTITIES:
            value, bounds = getattr(self, quantity.name), quantity.metadata["bounds"]
            # Fits make thousands of robots, nearly all of whose numbers are floats that are allowed.
            if type(value) is not float or not bounds.hold(value):
                checked = _checked(f"{quantity.metadata['section']}.{quantity.name}", value, bounds)
                object.__setattr__(self, quantity.name, checked)
        if self.min_speed_mps > self.max_speed_mps:
            raise RobotError(
                f"drive.min_speed_mps = {self.min_speed_mps:g} is above drive.max_speed_mps = {self.max_speed_mps:g}; "
                "make it the smaller of the two"
            )
        health = self.usable_energy_j / self.rated_energy_j
        if health < thresholds.LEAST_HEALTH:
            raise RobotError(
                f"battery.cycles = {self.cycles:g} and battery.age = {self.age:g} leave {health:.2g} of the rated "
                f"energy; allowed: at least {thresholds.LEAST_HEALTH:g}. "
                "Their units are those of cycle_fade and age_fade"
            )
        object.__setattr__(self, "effects", _checked_effects(self.effects))
        object.__setattr__(self, "open_circuit_v", _checked_curve(self))
        if "turning" in self.active_effects and self.track_m == 0.0:
            raise RobotError(
                "body.track_m = 0 (unknown), but effects.turning needs it; allowed: the distance of the wheels, above 0"
            )

    @property
    def active_effects(self) -> tuple[str, ...]:
        """Ids of the active effects: those whose first parameter is not zero."""
        return tuple(
            effect.id for effect in EFFECTS if self.effects.get(effect.id, _OFF).get(effect.switch.name, 0.0) != 0.0
        )

    @property
    def traction_efficiency(self) -> float:
        """Gamma = (1 - eta2)(1 - eta3): share of the drive's input energy that becomes traction work."""
        return float(model.traction_efficiency(self))

    @property
    def overall_efficiency(self) -> float:
        """Omega = (1 - eta1)(1 - eta2)(1 - eta3)(1 - eta4), the paper's overall system efficiency (Table I)."""
        return (1.0 - self.storage_loss) * self.traction_efficiency * (1.0 - self.ancillary_loss)

    @functools.cached_property
    def usable_energy_j(self) -> float:
        """Energy of a full charge after the robot's own cycles and age (Eq. 6), J."""
        return float(model.usable_energy(self, self.cycles, self.age))

    @property
    def curve(self) -> battery.Curve:
        """Open-circuit curve of the pack: its own, that of its chemistry, or a constant voltage."""
        return _curve(self.chemistry, self.cells_in_series, self.open_circuit_v)

    def record(self) -> NDArray[np.void]:
        """Array of shape (1,) and dtype `ROBOT_DTYPE`, the form that compiled kernels take."""
        return self._record.copy()

    @functools.cached_property
    def _record(self) -> NDArray[np.void]:
        active, tables = 0, [(effect, self.effects.get(effect.id, _OFF)) for effect in EFFECTS]
        for bit, (effect, table) in enumerate(tables):
            active |= (table.get(effect.switch.name, 0.0) != 0.0) << bit
        own = (getattr(self, quantity.name) for quantity in _QUANTITIES)
        of_effects = (table.get(one.name, one.default) for effect, table in tables for one in effect.parameters)
        squares_v2 = _squares_v2(self.chemistry, self.cells_in_series, self.open_circuit_v)
        return np.array([(active, *own, *of_effects, squares_v2)], ROBOT_DTYPE)

    def to_toml(self, comments: Mapping[str, str] = MappingProxyType({})) -> str:
        """Text of a robot file that `load_robot` reads back as an equal robot.

        Args:
            comments: Comment for the line of a field, by field name; of a number of an effect as `effect.number`.
        """
        lines = [f"name = {_toml_string(self.name)}", f"description = {_toml_string(self.description)}"]
        for section in ("body", "battery", "drive", "ancillary"):
            lines += ["", f"[{section}]"]
            for quantity in _QUANTITIES:
                if quantity.metadata["section"] == section:
                    note = comments.get(quantity.name, quantity.metadata["meaning"])
                    printable = "".join(c if c.isprintable() else " " for c in note)  # nor a second line
                    lines.append(f"{quantity.name} = {getattr(self, quantity.name)!r}  # {printable}")
            if section == "battery":
                lines += self._curve_lines()
        for effect_id, parameters in self.effects.items():
            lines += ["", f"[effects.{effect_id}]"]
            for name, value in parameters.items():
                note = comments.get(f"{effect_id}.{name}")
                lines.append(f"{name} = {value!r}" + (f"  # {note}" if note else ""))
        if self.uncertainty is not None:
            lines += ["", self.uncertainty.to_toml().rstrip("\n")]
        return "\n".join(lines) + "\n"

    def _curve_lines(self) -> list[str]:
        """Lines of a robot file for the open-circuit curve, none for a constant voltage."""
        if self.open_circuit_v:
            points = ", ".join(f"[{share!r}, {volts!r}]" for share, volts in self.open_circuit_v)
            return [f"open_circuit_v = [{points}]  # [share of charge, V of the pack], at rest"]
        if self.chemistry == battery.FLAT:
            return []
        return [
            f"chemistry = {_toml_string(self.chemistry)}  # its open-circuit curve: homeward.physics.battery",
            f"cells_in_series = {self.cells_in_series}",
        ]


_CURVE_FIELDS = ("chemistry", "cells_in_series", "open_circuit_v")
_QUANTITIES = tuple(quantity for quantity in fields(Robot) if "section" in quantity.metadata)
_OFF: Mapping[str, float] = MappingProxyType({})
_EFFECT_BY_ID: dict[str, Effect] = {effect.id: effect for effect in EFFECTS}

ROBOT_DTYPE = np.dtype(
    [("effects", np.uint64)]
    + [(quantity.name, np.float64) for quantity in _QUANTITIES]
    + [(name, np.float64) for name in PARAMETER_FIELDS]
    + [("squares_v2", np.float32, (battery.CELLS + 1,))],
    align=True,
)
"""One robot as a record: the fields of `Robot`, the parameters of every effect, the bits of those switched on, and the
open-circuit curve."""


@functools.lru_cache(maxsize=64)
def _curve(chemistry: str, cells: int, points: tuple[tuple[float, float], ...]) -> battery.Curve:
    if chemistry == battery.FLAT:
        return battery.curve_of(points)
    return battery.curve_of([(share, cells * volts) for share, volts in battery.CHEMISTRIES[chemistry]])


@functools.lru_cache(maxsize=64)
def _squares_v2(chemistry: str, cells: int, points: tuple[tuple[float, float], ...]) -> NDArray[np.float32]:
    return battery.squares_of(_curve(chemistry, cells, points))


def preset_names() -> list[str]:
    """Names of the shipped robots."""
    return sorted(
        entry.name.removesuffix(".toml") for entry in _preset_folder().iterdir() if entry.name.endswith(".toml")
    )


def load_robot(robot: str | Path | Robot) -> Robot:
    """Load a robot by preset name or from a TOML file; a `Robot` is returned as it is.

    Args:
        robot: Preset name (see `preset_names`), path of a TOML file ("-": standard input), or a `Robot`.

    Raises:
        RobotError: Unknown name, unreadable file, or a field that is wrong, missing or unphysical.

    A value that is allowed but that no known ground robot has raises a `PlausibilityWarning`.

    >>> round(load_robot("rusti").overall_efficiency, 6)
    0.086144
    """
    if isinstance(robot, Robot):
        return robot
    if not isinstance(robot, str | Path):
        raise RobotError(f"robot = {robot!r} is not a preset name, a path or a Robot")
    source = _preset_folder() / f"{robot}.toml" if robot in preset_names() else Path(robot)
    if str(source) != STANDARD_INPUT and not os.path.isfile(source):
        near = f"{os.path.splitext(source)[0]}.toml"
        hint = f" (did you mean {near!r}?)" if os.path.isfile(near) else _did_you_mean(str(robot), preset_names())
        raise RobotError(
            f"robot {str(robot)!r} is neither a preset nor a file; presets: {', '.join(preset_names())}{hint}"
        )
    try:
        data = read_toml(source)
    except (ValueError, OSError) as error:
        raise RobotError(f"{source}: not a readable TOML file: {error}") from error
    try:
        loaded = _from_tables(data)
    except RobotError as error:
        raise RobotError(f"{source}: {error}") from None
    warn_of_implausible(loaded, str(source))
    return loaded


def _preset_folder() -> Any:
    return files("homeward") / "robots"


def _from_tables(data: dict[str, Any]) -> Robot:
    sections: dict[str, dict[str, Any]] = {}
    for quantity in _QUANTITIES:
        sections.setdefault(quantity.metadata["section"], {})[quantity.name] = quantity
    _refuse_unknown(data, ["name", "description", "effects", "uncertainty", "coast_down", *sections], "")
    if "coast_down" in data:
        data = _with_coast_down(data)
    values: dict[str, Any] = {"effects": data.get("effects", {}), "description": data.get("description", "")}
    if "uncertainty" in data:
        table = data["uncertainty"]
        if isinstance(table, Mapping) and "rest_current_a" in table:  # where older files have it
            table = dict(table)
            data = {**data, "drive": {"rest_current_a": table.pop("rest_current_a"), **data.get("drive", {})}}
        try:
            values["uncertainty"] = table if isinstance(table, Uncertainty) else from_table(table)
        except UncertaintyError as error:
            raise RobotError(f"uncertainty.{error}") from None
    if "name" not in data:
        raise RobotError('name is missing; give the robot a name, such as name = "my_robot"')
    values["name"] = data["name"]
    for section, quantities in sections.items():
        table = data.get(section, {})
        if not isinstance(table, dict):
            raise RobotError(f"{section} = {table!r} is not a table; write [{section}] with {', '.join(quantities)}")
        of_curve = _CURVE_FIELDS if section == "battery" else ()
        _refuse_unknown(table, [*quantities, *of_curve], f"{section}.")
        values |= {name: table[name] for name in of_curve if name in table}
        for name, quantity in quantities.items():
            if name in table:
                values[name] = table[name]
            elif quantity.default is dataclasses.MISSING:
                meaning, bounds = quantity.metadata["meaning"], quantity.metadata["bounds"]
                raise RobotError(f"{section}.{name} is missing ({meaning}); give a number in {bounds}")
    return Robot(**values)


def _with_coast_down(data: dict[str, Any]) -> dict[str, Any]:
    """Tables of a file with what its `[coast_down]` gives."""
    body, effects = data.get("body", {}), data.get("effects", {})
    if not isinstance(body, Mapping) or not isinstance(effects, Mapping):
        return data  # which is refused
    try:
        measured = coast_down.from_table(data["coast_down"], body.get("mass_kg"))
    except UncertaintyError as error:
        raise RobotError(str(error)) from None
    twice = [f"body.{name}" for name in measured.body if name in body]
    twice += [f"effects.{name}" for name in measured.effects if name in effects]
    twice += ["uncertainty"] if measured.uncertainty is not None and "uncertainty" in data else []
    if twice:
        raise RobotError(f"coast_down gives {', '.join(twice)} too; remove one of them")
    data = data | {"body": {**body, **measured.body}, "effects": {**effects, **measured.effects}}
    return data if measured.uncertainty is None else data | {"uncertainty": measured.uncertainty}


def _refuse_unknown(table: Mapping[str, Any], known: list[str], prefix: str, remedy: str = "") -> None:
    for name in table:
        if name not in known:
            raise RobotError(
                f"{prefix}{name} = {table[name]!r} is not a known field; known: {', '.join(known)}"
                f"{_belongs_in(str(name)) or _did_you_mean(str(name), known) or remedy}"
            )


def _belongs_in(name: str) -> str:
    sections = [quantity.metadata["section"] for quantity in _QUANTITIES if quantity.name == name]
    return f" ({name} belongs in [{sections[0]}])" if sections else ""


def _did_you_mean(name: str, known: list[str]) -> str:
    close = difflib.get_close_matches(name, known, n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def _checked(name: str, value: Any, bounds: Bounds) -> float:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise RobotError(f"{name} = {value!r} is not a number; allowed: a number in {bounds}")
    if not bounds.hold(value):
        raise RobotError(f"{name} = {value!r} is not allowed; allowed: a number in {bounds}")
    return float(value)


def _checked_curve(robot: Robot) -> tuple[tuple[float, float], ...]:
    """The points of a robot's own open-circuit curve, none if its chemistry has one."""
    known = (battery.FLAT, *battery.CHEMISTRIES)
    if robot.chemistry not in known:
        raise RobotError(f"battery.chemistry = {robot.chemistry!r} is not known; choose {', '.join(known)}")
    if robot.chemistry != battery.FLAT:
        _check_cells(robot)
        return ()
    if robot.cells_in_series:
        raise RobotError("battery.cells_in_series needs a chemistry; add one, or remove it")
    points = robot.open_circuit_v
    if not isinstance(points, list | tuple) or not all(isinstance(point, list | tuple) for point in points):
        raise RobotError(f"battery.open_circuit_v = {points!r} is no list of [share of charge, V] pairs")
    if not points:
        return ()
    checked = tuple(_checked_point(point) for point in points)
    shares, volts = zip(*checked, strict=True)
    if len(checked) not in range(2, battery.MOST_KNOTS + 1) or (shares[0], shares[-1]) != (0.0, 1.0):
        raise RobotError(
            f"battery.open_circuit_v has {len(checked)} points from share {shares[0]:g} to {shares[-1]:g}; give 2 to "
            f"{battery.MOST_KNOTS} points from 0 (empty) to 1 (full)"
        )
    rises = all(low < high for low, high in itertools.pairwise(shares))
    if not rises or any(low > high for low, high in itertools.pairwise(volts)):
        raise RobotError("battery.open_circuit_v does not rise with the share of charge; sort its points")
    return checked


def _checked_point(point: Any) -> tuple[float, float]:
    if len(point) != 2:
        raise RobotError(f"battery.open_circuit_v has the point {point!r}; give [share of charge, V of the pack]")
    share, volts = point
    return _checked("battery.open_circuit_v share", share, Bounds(0.0, 1.0)), _checked(
        "battery.open_circuit_v voltage", volts, _POSITIVE
    )


def _check_cells(robot: Robot) -> None:
    """Raise an error unless the cells of a chemistry make about the nominal voltage."""
    cells = robot.cells_in_series
    if isinstance(cells, bool) or not isinstance(cells, int) or cells < 1:
        raise RobotError(
            f"battery.cells_in_series = {cells!r} is not allowed with a chemistry; give how many cells are in series, "
            "such as 12 for a lead-acid battery of 24 V"
        )
    if robot.open_circuit_v:
        raise RobotError("battery has a chemistry and an open_circuit_v; keep one of them")
    cell = battery.CHEMISTRIES[robot.chemistry]
    empty_v, full_v = cells * cell[0][1], cells * cell[-1][1]
    if not empty_v <= robot.nominal_voltage_v <= full_v:
        raise RobotError(
            f"battery.cells_in_series = {cells} of {robot.chemistry} have {empty_v:.3g} to {full_v:.3g} V, but "
            f"battery.nominal_voltage_v = {robot.nominal_voltage_v:g}; correct one of them"
        )


def _checked_effects(effects: Any) -> Mapping[str, Mapping[str, float]]:
    if not isinstance(effects, Mapping):
        raise RobotError(f"effects = {effects!r} is not a table of effects")
    checked: dict[str, Mapping[str, float]] = {}
    for effect_id, parameters in effects.items():
        _refuse_unknown({effect_id: parameters}, list(_EFFECT_BY_ID), "effects.", f"; {REMEDY}")
        effect = _EFFECT_BY_ID[effect_id]
        names = [parameter.name for parameter in effect.parameters]
        if not isinstance(parameters, Mapping):
            raise RobotError(f"effects.{effect_id} = {parameters!r} is not a table with {', '.join(names)}")
        _refuse_unknown(parameters, names, f"effects.{effect_id}.")
        if effect.switch.name not in parameters:
            raise RobotError(
                f"effects.{effect_id}.{effect.switch.name} is missing ({effect.switch.meaning}); "
                f"give a number in {Bounds(effect.switch.low, effect.switch.high)}, 0 switches the effect off"
            )
        checked[effect_id] = {
            parameter.name: _checked(
                f"effects.{effect_id}.{parameter.name}", parameters.get(parameter.name, parameter.default),
                Bounds(parameter.low, parameter.high))
            for parameter in effect.parameters
        }  # fmt: skip
    return checked


def _toml_string(text: str) -> str:
    escaped = "".join(c if c.isprintable() and c not in '"\\' else f"\\u{ord(c):04X}" if ord(c) < 0x10000 else
                      f"\\U{ord(c):08X}" for c in text)  # fmt: skip
    return f'"{escaped}"'
