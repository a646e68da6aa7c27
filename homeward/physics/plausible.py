"""Values that are allowed but that no known ground robot has: most have a wrong unit."""

from __future__ import annotations

import sys
import warnings
from typing import Any

from homeward.physics import thresholds

_ANCILLARY = "sensing_idle_w", "communication_w", "controller_w", "computer_w"


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
        for name, (low, high, unit) in thresholds.PLAUSIBLE.items()
        if not low <= getattr(robot, name) <= high
    ]
    ancillary_w = sum(getattr(robot, name) for name in _ANCILLARY)
    if ancillary_w > thresholds.MOST_ANCILLARY_W:
        most = f"where at most {thresholds.MOST_ANCILLARY_W:g} W is known"
        found.append(f"{' + '.join(_ANCILLARY)} = {ancillary_w:g} W, {most}")
    low, high, per_kg = thresholds.LEAST_J_PER_KG, thresholds.MOST_J_PER_KG, robot.rated_energy_j / robot.mass_kg
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
