"""Dimensionless groups of the channels, from which an empirical term is built."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import Array
from homeward.physics import Robot
from homeward.physics.model import GRAVITY_MPS2

_MILD_C = 20.0
_STANDS_MPS = 0.02


@dataclass(frozen=True)
class Factor:
    """One group with its power: its formula, the channel it comes from, and its values, shape (windows,)."""

    text: str
    family: str
    values: Array


def factors(runs: Runs, robot: Robot) -> tuple[Factor, ...]:
    """Every group that these runs have channels for; the first is 1.

    Args:
        runs: The runs.
        robot: The robot, for its track, mass, top speed and fastest sensing.
    """
    found = [Factor("", "1", np.ones(len(runs.observed)))]
    for family, of in _FAMILIES.items():
        found += [
            Factor(text, family, values)
            for text, values in of(runs, robot)
            if np.isfinite(values).all() and float(np.ptp(values)) > 1e-9
        ]
    return tuple(found)


def constants(text: str, robot: Robot, runs: Runs) -> dict[str, str]:
    """Symbols of a formula that are the same for all windows, with value and unit."""
    known = {
        "m ": f"m = {robot.mass_kg:.4g} kg",
        "v_max": f"v_max = {robot.max_speed_mps:.4g} m/s",
        " B": f"B = {robot.track_m:.4g} m",
        "f_max": f"f_max = {robot.max_sensing_hz:.4g} Hz",
        "r_max": f"r_max = {_largest(runs, 'base_distance_m'):.4g} m",
        "t_max": f"t_max = {float(_time_in_run(runs).max()):.4g} s",
        "P_drive": "P_drive = what the refit says of the drive",
        "I_drive": "I_drive = what the refit says of the drive",
    }
    return {symbol.strip(): meaning for symbol, meaning in known.items() if symbol in text}


def _powers(symbol: str, values: Array, powers: tuple[float, ...]) -> Iterator[tuple[str, Array]]:
    for power in powers:
        yield (f"({symbol})" if power == 1.0 else f"({symbol})^{power:g}"), values**power


def _speed(runs: Runs, robot: Robot) -> Iterator[tuple[str, Array]]:
    speed = np.abs(runs.context["speed_mps"])
    yield "[v > 0]", (speed > _STANDS_MPS).astype(np.float64)
    yield from _powers("v / v_max", speed / robot.max_speed_mps, (0.5, 1.0, 2.0))


def _turning(runs: Runs, robot: Robot) -> Iterator[tuple[str, Array]]:
    if "yaw_rate_radps" in runs.context:
        rate = runs.context["yaw_rate_radps"]
        length_m, unit = (robot.track_m, "B / v_max") if robot.track_m > 0.0 else (0.0, "v_max / g")
        scale = length_m / robot.max_speed_mps if length_m else robot.max_speed_mps / GRAVITY_MPS2
        yield from _powers(f"|w| {unit}", np.abs(rate) * scale, (0.5, 1.0, 2.0))
        yield f"(w+ {unit})", np.maximum(rate, 0.0) * scale
    elif "wheel_difference_mps" in runs.context:
        difference = np.abs(runs.context["wheel_difference_mps"]) / robot.max_speed_mps
        yield from _powers("|v_r - v_l| / v_max", difference, (0.5, 1.0, 2.0))


def _acceleration(runs: Runs, robot: Robot) -> Iterator[tuple[str, Array]]:
    relative = runs.context["accel_mps2"] / GRAVITY_MPS2
    yield from _powers("|a| / g", np.abs(relative), (1.0, 2.0))
    yield from _powers("a+ / g", np.maximum(relative, 0.0), (1.0, 2.0))
    yield from _powers("a- / g", np.maximum(-relative, 0.0), (1.0,))


def _grade(runs: Runs, robot: Robot) -> Iterator[tuple[str, Array]]:
    if "grade_rad" in runs.context:
        sine = np.sin(runs.context["grade_rad"])
        yield from _powers("|sin(grade)|", np.abs(sine), (1.0, 2.0))
        yield from _powers("sin(grade)+", np.maximum(sine, 0.0), (1.0, 2.0))
        yield from _powers("sin(grade)-", np.maximum(-sine, 0.0), (1.0, 2.0))


def _sensing(runs: Runs, robot: Robot) -> Iterator[tuple[str, Array]]:
    if "sensing_hz" in runs.context:
        yield from _powers("f_s / f_max", runs.context["sensing_hz"] / robot.max_sensing_hz, (0.5, 1.0, 2.0))


def _temperature(runs: Runs, robot: Robot) -> Iterator[tuple[str, Array]]:
    if "temperature_c" in runs.context:
        relative = (runs.context["temperature_c"] - _MILD_C) / _MILD_C
        yield from _powers("(T - 20 C) / 20 K", relative, (1.0, 2.0))
        yield from _powers("(T - 20 C)+ / 20 K", np.maximum(relative, 0.0), (1.0,))
        yield from _powers("(20 C - T)+ / 20 K", np.maximum(-relative, 0.0), (1.0, 2.0))


def _heading(runs: Runs, robot: Robot) -> Iterator[tuple[str, Array]]:
    """The way of heading 0 is called east, as in ENU frames."""
    if "heading_rad" not in runs.context:
        return
    for index in range(8):
        degrees = 45 * index
        along = np.cos(runs.context["heading_rad"] - np.deg2rad(degrees))
        if index < 4:
            yield f"cos(heading - {degrees} deg)", along
            yield f"[heading within 90 deg of {degrees} deg]", (along > 0.0).astype(np.float64)
        yield f"cos(heading - {degrees} deg)+", np.maximum(along, 0.0)
        yield f"[heading within 45 deg of {degrees} deg]", (along > np.sqrt(0.5)).astype(np.float64)


def _distance(runs: Runs, robot: Robot) -> Iterator[tuple[str, Array]]:
    if "base_distance_m" in runs.context:
        distance = np.abs(runs.context["base_distance_m"])
        yield from _powers("r / r_max", distance / max(_largest(runs, "base_distance_m"), 1e-9), (0.5, 1.0, 2.0))


def _payload(runs: Runs, robot: Robot) -> Iterator[tuple[str, Array]]:
    if "payload_kg" in runs.context:
        yield from _powers("payload / m", np.abs(runs.context["payload_kg"]) / robot.mass_kg, (0.5, 1.0, 2.0))


def _charge(runs: Runs, robot: Robot) -> Iterator[tuple[str, Array]]:
    if "soc" in runs.context:
        yield from _powers("1 - soc", np.clip(1.0 - runs.context["soc"], 0.0, 1.0), (0.5, 1.0, 2.0))


def _time(runs: Runs, robot: Robot) -> Iterator[tuple[str, Array]]:
    time_s = _time_in_run(runs)
    yield from _powers("t / t_max", time_s / max(float(time_s.max()), 1e-9), (0.5, 1.0, 2.0))


_FAMILIES: Mapping[str, Callable[[Runs, Robot], Iterator[tuple[str, Array]]]] = {
    "speed": _speed,
    "turning rate": _turning,
    "acceleration": _acceleration,
    "grade": _grade,
    "sensing": _sensing,
    "temperature": _temperature,
    "heading": _heading,
    "distance": _distance,
    "payload mass": _payload,
    "charge": _charge,
    "time": _time,
}


def _largest(runs: Runs, name: str) -> float:
    values = runs.context.get(name, np.zeros(1))
    return float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))


def _time_in_run(runs: Runs) -> Array:
    first = np.array([runs.time_s[runs.run == run][0] for run in range(len(runs.signals))])
    elapsed: Array = np.maximum(runs.time_s - first[runs.run], 0.0)
    return elapsed
