"""Values that are allowed but that no known ground robot has: most have a wrong unit."""

from __future__ import annotations

import sys
import warnings
from typing import Any

_BOUNDS: dict[str, tuple[float, float, str]] = {
    "mass_kg": (0.05, 10_000.0, "kg"),  # a line follower; an armoured vehicle without its crew
    "rolling_resistance": (0.002, 0.6, ""),  # steel on steel; loose sand (Wong, Theory of Ground Vehicles, 2.9)
    "drag_ns2_per_m2": (0.0, 10.0, "N s^2/m^2"),  # 0.5 * 1.2 kg/m^3 * 1.2 * 14 m^2, a truck across the wind
    "rated_energy_j": (1e3, 2e9, "J"),  # a capacitor of 0.3 Wh; 550 kWh, the largest pack of an electric truck
    "nominal_voltage_v": (1.0, 1000.0, "V"),  # one cell; 800 V packs when full
    "max_speed_mps": (0.005, 45.0, "m/s"),  # a planetary rover's 0.04 with a margin; 160 km/h
    "max_sensing_hz": (0.0, 1e5, "Hz"),
    "track_m": (0.0, 5.0, "m"),
    "traction_n_per_a": (0.0, 5000.0, "N/A"),
}
"""Lowest and highest of ground robots and road vehicles, and the unit."""

_PER_KG = 250.0, 3e6
"""Rated energy over mass, J/kg: below, a charge does not lift the robot by 25 m; above, it exceeds that of a cell."""

_ANCILLARY = "sensing_idle_w", "communication_w", "controller_w", "computer_w"
_MOST_ANCILLARY_W = 20_000.0  # of all these together; chosen: 300 times the highest of the presets (60 W)


class PlausibilityWarning(UserWarning):
    """A value that is allowed but that no known ground robot has."""


def implausible(robot: Any) -> list[str]:
    """Parameters of a robot outside the range of known ground robots, each in a phrase with that range.

    >>> from homeward.physics import load_robot
    >>> implausible(load_robot("husky"))
    []
    """
    found = [
        f"{name} = {getattr(robot, name):g}, where {low:g} to {high:g}{unit and ' ' + unit} is known"
        for name, (low, high, unit) in _BOUNDS.items()
        if not low <= getattr(robot, name) <= high
    ]
    ancillary_w = sum(getattr(robot, name) for name in _ANCILLARY)
    if ancillary_w > _MOST_ANCILLARY_W:
        found.append(f"{' + '.join(_ANCILLARY)} = {ancillary_w:g} W, where at most {_MOST_ANCILLARY_W:g} W is known")
    (low, high), per_kg = _PER_KG, robot.rated_energy_j / robot.mass_kg
    if not low <= per_kg <= high:
        found.append(f"rated_energy_j / mass_kg = {per_kg:.3g} J/kg, where {low:g} to {high:g} is known")
    return found


def warn_of_implausible(robot: Any, source: str) -> None:
    """Warn of implausible values in a robot that was read from a source."""
    if found := implausible(robot):
        message = f"{source}: {'; '.join(found)}: is the unit right?"
        warnings.warn(message, PlausibilityWarning, stacklevel=_outside())


def _outside() -> int:
    """Number of frames up to the caller outside this package, whose line the warning names."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("homeward"):
        level, frame = level + 1, frame.f_back
    return level
