"""A robot: the parameters of the model, read from a TOML file, checked, and turned into a record
for compiled kernels."""

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
    """A robot file or value that cannot be used: the message names the field, the value and what is
    allowed."""


def _quantity(section: str, meaning: str, bounds: Bounds, default: float | None = None) -> Any:
    """Declare one number of the robot file: section, meaning and allowed values."""
    metadata = {"section": section, "meaning": meaning, "bounds": bounds}
    if default is None:
        return field(metadata=metadata)
    return field(default=default, metadata=metadata)


# Chosen: far beyond any robot, and safe from overflow; `homeward.physics.plausible` has the typical
# ranges.
_POSITIVE = Bounds(0.0, 1e6, open_low=True)
_NOT_NEGATIVE = Bounds(0.0, 1e6)
_SPEED = Bounds(0.0, 100.0, open_low=True)
_LOSS = Bounds(0.0, 1.0, open_high=True)


@dataclass(frozen=True)
class Robot:
    """A ground robot on one battery charge: the parameters of the battery-dissemination model, all
    in SI units.

    It is frozen: `dataclasses.replace(robot, mass_kg=1.0)` returns a changed copy, checked as a
    file is checked. Derived quantities are properties.

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
    rated_energy_j: float = _quantity(
        "battery", "rated battery energy E_O, J", Bounds(0.0, 1e12, open_low=True)
    )
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
    computer_w: float = _quantity(
        "ancillary", "computer when sensing starts, part of P_C, W", _NOT_NEGATIVE, 0.0
    )
    computer_j_per_sample: float = _quantity(
        "ancillary", "rise of the computer's power per Hz, J", _NOT_NEGATIVE, 0.0
    )
    ancillary_loss: float = _quantity("ancillary", "ancillary loss eta4, a share", _LOSS, 0.0)
    cycles: float = _quantity(
        "battery", "charge cycles C, in the unit k1 is per", _NOT_NEGATIVE, 0.0
    )
    age: float = _quantity("battery", "age t, in the unit k2 is per", _NOT_NEGATIVE, 0.0)
    cycle_fade: float = _quantity("battery", "k1, fade per unit of cycles", _NOT_NEGATIVE, 0.0)
    age_fade: float = _quantity("battery", "k2, fade per unit of age", _NOT_NEGATIVE, 0.0)
    cutoff_v: float = _quantity(
        "battery",
        "voltage under load at which the battery is cut off, V (0: none)",
        _NOT_NEGATIVE,
        0.0,
    )
    storage_loss: float = _quantity("battery", "battery loss eta1, a share", _LOSS, 0.0)
    track_m: float = _quantity(
        "body", "distance between left and right wheels, m (0: unknown)", _NOT_NEGATIVE, 0.0
    )
    traction_n_per_a: float = _quantity(
        "drive", "wheel thrust per ampere, N/A (0: unknown)", _NOT_NEGATIVE, 0.0
    )
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
            value = getattr(self, quantity.name)
            bounds = quantity.metadata["bounds"]
            # Fits make thousands of robots, nearly all of whose numbers are floats that are
            # allowed.
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
        # The instance is frozen; what was checked is stored nonetheless.
        object.__setattr__(self, "effects", _checked_effects(self.effects))
        object.__setattr__(self, "open_circuit_v", _checked_curve(self))
        _check_cutoff(self)
        if "turning" in self.active_effects and self.track_m == 0.0:
            raise RobotError(
                "body.track_m = 0 (unknown), but effects.turning needs it; allowed: the distance of the wheels, above 0"
            )

    @property
    def active_effects(self) -> tuple[str, ...]:
        """Ids of the active effects: those whose first parameter is not zero."""
        return tuple(
            effect.id
            for effect in EFFECTS
            if self.effects.get(effect.id, _OFF).get(effect.switch.name, 0.0) != 0.0
        )

    @property
    def traction_efficiency(self) -> float:
        """Gamma = (1 - eta2)(1 - eta3): share of the drive's input energy that becomes traction
        work."""
        return float(model.traction_efficiency(self))

    @property
    def overall_efficiency(self) -> float:
        """Omega = (1 - eta1)(1 - eta2)(1 - eta3)(1 - eta4), the paper's overall system efficiency
        (Table I)."""
        return (1.0 - self.storage_loss) * self.traction_efficiency * (1.0 - self.ancillary_loss)

    @functools.cached_property
    def usable_energy_j(self) -> float:
        """Energy of a full charge after the robot's own cycles and age (Eq. 6), J."""
        return float(model.usable_energy(self, self.cycles, self.age))

    @property
    def curve(self) -> battery.Curve:
        """Open-circuit curve of the pack: its own, that of its chemistry, or a constant voltage."""
        return _curve(self.chemistry, self.cells_in_series, self.open_circuit_v)

    @property
    def has_cutoff(self) -> bool:
        """Whether the battery ends at a cut-off in the model: it has one, and a voltage that
        falls."""
        return self.cutoff_v > 0.0 and self.curve.mean_v > 0.0

    def without_cutoff(self) -> Robot:
        """The robot with a battery that gives all of its energy.

        By its range what a metre consumes is computed.
        """
        if not self.has_cutoff:
            return self
        return dataclasses.replace(self, cutoff_v=0.0)

    def record(self) -> NDArray[np.void]:
        """Array of shape (1,) and dtype `ROBOT_DTYPE`, the form that compiled kernels take."""
        return self._record.copy()

    @functools.cached_property
    def _record(self) -> NDArray[np.void]:
        active = 0
        of_effects = []
        for bit, effect in enumerate(EFFECTS):
            table = self.effects.get(effect.id, _OFF)
            if table.get(effect.switch.name, 0.0) != 0.0:
                active |= 1 << bit
            of_effects += [
                table.get(parameter.name, parameter.default) for parameter in effect.parameters
            ]
        if self.has_cutoff:
            active |= int(HAS_CUTOFF)
        of_robot = (getattr(self, quantity.name) for quantity in _QUANTITIES)
        squares_v2 = _squares_v2(self.chemistry, self.cells_in_series, self.open_circuit_v)
        return np.array([(active, *of_robot, *of_effects, squares_v2)], ROBOT_DTYPE)

    def to_toml(self, comments: Mapping[str, str] = MappingProxyType({})) -> str:
        """Text of a robot file that `load_robot` reads back as an equal robot.

        Args:
            comments: Comment for the line of a field, by field name; of a number of an effect as
                `effect.number`.
        """
        lines = [
            f"name = {_toml_string(self.name)}",
            f"description = {_toml_string(self.description)}",
        ]
        for section in ("body", "battery", "drive", "ancillary"):
            lines += ["", f"[{section}]"]
            for quantity in _QUANTITIES:
                if quantity.metadata["section"] == section:
                    note = comments.get(quantity.name, quantity.metadata["meaning"])
                    # nor a second line
                    printable = "".join(sign if sign.isprintable() else " " for sign in note)
                    lines.append(
                        f"{quantity.name} = {getattr(self, quantity.name)!r}  # {printable}"
                    )
            if section == "battery":
                lines += self._curve_lines()
        for effect_id, parameters in self.effects.items():
            lines += ["", f"[effects.{effect_id}]"]
            for name, value in parameters.items():
                line = f"{name} = {value!r}"
                note = comments.get(f"{effect_id}.{name}")
                if note:
                    line += f"  # {note}"
                lines.append(line)
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
"""One robot as a record: the fields of `Robot`, the parameters of every effect, the bits of those
switched on and of a cut-off, and the open-circuit curve."""

HAS_CUTOFF = np.uint64(1 << len(EFFECTS))
"""Bit of a record's `effects`, after those of the effects, of a battery that ends at a cut-off: so a
robot without any takes no time to ask for it."""


@functools.lru_cache(maxsize=64)
def _curve(chemistry: str, cells: int, points: tuple[tuple[float, float], ...]) -> battery.Curve:
    if chemistry == battery.FLAT:
        return battery.curve_of(points)
    return battery.curve_of(
        [(share, cells * volts) for share, volts in battery.CHEMISTRIES[chemistry]]
    )


@functools.lru_cache(maxsize=64)
def _squares_v2(
    chemistry: str, cells: int, points: tuple[tuple[float, float], ...]
) -> NDArray[np.float32]:
    return battery.squares_of(_curve(chemistry, cells, points))


def preset_names() -> list[str]:
    """Names of the shipped robots."""
    return sorted(
        entry.name.removesuffix(".toml")
        for entry in _preset_folder().iterdir()
        if entry.name.endswith(".toml")
    )


def load_robot(robot: str | Path | Robot) -> Robot:
    """Load a robot by preset name or from a TOML file; a `Robot` is returned as it is.

    Args:
        robot: Preset name (see `preset_names`), path of a TOML file ("-": standard input), or a
            `Robot`.

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
    source: Any = Path(robot)
    if robot in preset_names():
        source = _preset_folder() / f"{robot}.toml"
    if str(source) != STANDARD_INPUT and not os.path.isfile(source):
        hint = _did_you_mean(str(robot), preset_names())
        near = f"{os.path.splitext(source)[0]}.toml"
        if os.path.isfile(near):
            hint = f" (did you mean {near!r}?)"
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
    _refuse_unknown(
        data, ["name", "description", "effects", "uncertainty", "coast_down", *sections], ""
    )
    if "coast_down" in data:
        data = _with_coast_down(data)
    data = _with_rest_current(data)
    values: dict[str, Any] = {
        "effects": data.get("effects", {}),
        "description": data.get("description", ""),
    }
    if "uncertainty" in data:
        values["uncertainty"] = _uncertainty_of(data["uncertainty"])
    if "name" not in data:
        raise RobotError('name is missing; give the robot a name, such as name = "my_robot"')
    values["name"] = data["name"]
    for section, quantities in sections.items():
        values |= _numbers_of(section, data.get(section, {}), quantities)
    return Robot(**values)


def _with_rest_current(data: dict[str, Any]) -> dict[str, Any]:
    """Tables of a file with the motors' current at rest in `[drive]`; older files have it in
    `[uncertainty]`."""
    table = data.get("uncertainty")
    if not isinstance(table, Mapping) or "rest_current_a" not in table:
        return data
    uncertainty = dict(table)
    rest_current_a = uncertainty.pop("rest_current_a")
    drive = data.get("drive", {})
    if isinstance(drive, Mapping):  # otherwise it is refused
        drive = {"rest_current_a": rest_current_a, **drive}
    return {**data, "uncertainty": uncertainty, "drive": drive}


def _uncertainty_of(table: Any) -> Uncertainty:
    if isinstance(table, Uncertainty):  # that of a coast-down test
        return table
    try:
        return from_table(table)
    except UncertaintyError as error:
        raise RobotError(f"uncertainty.{error}") from None


def _numbers_of(section: str, table: Any, quantities: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a section by field; none is missing or unknown."""
    if not isinstance(table, dict):
        raise RobotError(
            f"{section} = {table!r} is not a table; write [{section}] with {', '.join(quantities)}"
        )
    of_curve = _CURVE_FIELDS if section == "battery" else ()
    _refuse_unknown(table, [*quantities, *of_curve], f"{section}.")
    values = {name: table[name] for name in of_curve if name in table}
    for name, quantity in quantities.items():
        if name in table:
            values[name] = table[name]
        elif quantity.default is dataclasses.MISSING:
            meaning = quantity.metadata["meaning"]
            raise RobotError(
                f"{section}.{name} is missing ({meaning}); give a number in {quantity.metadata['bounds']}"
            )
    return values


def _with_coast_down(data: dict[str, Any]) -> dict[str, Any]:
    """Tables of a file with what its `[coast_down]` gives."""
    body = data.get("body", {})
    effects = data.get("effects", {})
    if not isinstance(body, Mapping) or not isinstance(effects, Mapping):
        return data  # which is refused
    try:
        measured = coast_down.from_table(data["coast_down"], body.get("mass_kg"))
    except UncertaintyError as error:
        raise RobotError(str(error)) from None
    twice = [f"body.{name}" for name in measured.body if name in body]
    twice += [f"effects.{name}" for name in measured.effects if name in effects]
    if measured.uncertainty is not None and "uncertainty" in data:
        twice.append("uncertainty")
    if twice:
        raise RobotError(f"coast_down gives {', '.join(twice)} too; remove one of them")
    tables = {**data, "body": {**body, **measured.body}, "effects": {**effects, **measured.effects}}
    if measured.uncertainty is not None:
        tables["uncertainty"] = measured.uncertainty
    return tables


def _refuse_unknown(
    table: Mapping[str, Any], allowed: list[str], prefix: str, remedy: str = ""
) -> None:
    for name in table:
        if name not in allowed:
            hint = _belongs_in(str(name)) or _did_you_mean(str(name), allowed) or remedy
            raise RobotError(
                f"{prefix}{name} = {table[name]!r} is not a known field; known: {', '.join(allowed)}{hint}"
            )


def _belongs_in(name: str) -> str:
    """A hint where a field stands in the wrong section, empty otherwise."""
    for quantity in _QUANTITIES:
        if quantity.name == name:
            return f" ({name} belongs in [{quantity.metadata['section']}])"
    return ""


def _did_you_mean(name: str, allowed: list[str]) -> str:
    """A hint where a name is close to one that is allowed, empty otherwise."""
    close = difflib.get_close_matches(name, allowed, n=1)
    if not close:
        return ""
    return f" (did you mean {close[0]!r}?)"


def _checked(name: str, value: Any, bounds: Bounds) -> float:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise RobotError(f"{name} = {value!r} is not a number; allowed: a number in {bounds}")
    if not bounds.hold(value):
        raise RobotError(f"{name} = {value!r} is not allowed; allowed: a number in {bounds}")
    return float(value)


def _checked_curve(robot: Robot) -> tuple[tuple[float, float], ...]:
    """The points of a robot's own open-circuit curve, none if its chemistry has one."""
    allowed = (battery.FLAT, *battery.CHEMISTRIES)
    if robot.chemistry not in allowed:
        raise RobotError(
            f"battery.chemistry = {robot.chemistry!r} is not known; choose {', '.join(allowed)}"
        )
    if robot.chemistry != battery.FLAT:
        _check_cells(robot)
        return ()  # the curve is that of the chemistry
    if robot.cells_in_series:
        raise RobotError("battery.cells_in_series needs a chemistry; add one, or remove it")
    return _checked_points(robot.open_circuit_v)


def _checked_points(points: Any) -> tuple[tuple[float, float], ...]:
    """Points (share of charge, V of the pack) of an open-circuit curve, none for a constant
    voltage."""
    if not isinstance(points, list | tuple) or not all(
        isinstance(point, list | tuple) for point in points
    ):
        raise RobotError(
            f"battery.open_circuit_v = {points!r} is no list of [share of charge, V] pairs"
        )
    if not points:
        return ()
    checked = tuple(_checked_point(point) for point in points)
    shares, volts = zip(*checked, strict=True)
    has_ends = shares[0] == 0.0 and shares[-1] == 1.0
    if not has_ends or not 2 <= len(checked) <= battery.MOST_KNOTS:
        raise RobotError(
            f"battery.open_circuit_v has {len(checked)} points from share {shares[0]:g} to {shares[-1]:g}; give 2 to "
            f"{battery.MOST_KNOTS} points from 0 (empty) to 1 (full)"
        )
    share_rises = all(low < high for low, high in itertools.pairwise(shares))
    voltage_falls = any(low > high for low, high in itertools.pairwise(volts))
    if voltage_falls or not share_rises:
        raise RobotError(
            "battery.open_circuit_v does not rise with the share of charge; sort its points"
        )
    return checked


def _checked_point(point: Any) -> tuple[float, float]:
    if len(point) != 2:
        raise RobotError(
            f"battery.open_circuit_v has the point {point!r}; give [share of charge, V of the pack]"
        )
    share = _checked("battery.open_circuit_v share", point[0], Bounds(0.0, 1.0))
    volts = _checked("battery.open_circuit_v voltage", point[1], _POSITIVE)
    return share, volts


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
    curve = battery.CHEMISTRIES[robot.chemistry]
    _, empty_cell_v = curve[0]
    _, full_cell_v = curve[-1]
    empty_v = cells * empty_cell_v
    full_v = cells * full_cell_v
    if not empty_v <= robot.nominal_voltage_v <= full_v:
        raise RobotError(
            f"battery.cells_in_series = {cells} of {robot.chemistry} have {empty_v:.3g} to {full_v:.3g} V, but "
            f"battery.nominal_voltage_v = {robot.nominal_voltage_v:g}; correct one of them"
        )


def _check_cutoff(robot: Robot) -> None:
    """Raise an error if a cut-off is not below the voltage of the full battery."""
    if robot.cutoff_v == 0.0:
        return
    full_v = robot.nominal_voltage_v
    curve = robot.curve
    if curve.mean_v > 0.0:
        full_v = curve.mean_v * float(curve.relative_v[curve.knots - 1])
    if robot.cutoff_v >= full_v:
        raise RobotError(
            f"battery.cutoff_v = {robot.cutoff_v:g} is not below the {full_v:.4g} V of the full battery; "
            "give the voltage of the whole pack at which it is cut off, or 0 for none"
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
            raise RobotError(
                f"effects.{effect_id} = {parameters!r} is not a table with {', '.join(names)}"
            )
        _refuse_unknown(parameters, names, f"effects.{effect_id}.")
        if effect.switch.name not in parameters:
            raise RobotError(
                f"effects.{effect_id}.{effect.switch.name} is missing ({effect.switch.meaning}); "
                f"give a number in {Bounds(effect.switch.low, effect.switch.high)}, 0 switches the effect off"
            )
        values = {}
        for parameter in effect.parameters:
            value = parameters.get(parameter.name, parameter.default)
            bounds = Bounds(parameter.low, parameter.high)
            values[parameter.name] = _checked(
                f"effects.{effect_id}.{parameter.name}", value, bounds
            )
        checked[effect_id] = values
    return checked


def _toml_string(text: str) -> str:
    escaped = "".join(map(_escaped, text))
    return f'"{escaped}"'


def _escaped(sign: str) -> str:
    """A sign of a text in TOML: quotes, backslashes and what cannot be printed by their code
    points."""
    if sign.isprintable() and sign not in '"\\':
        return sign
    if ord(sign) < 0x10000:
        return f"\\u{ord(sign):04X}"
    return f"\\U{ord(sign):08X}"
