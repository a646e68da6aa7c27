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
    """Parameters of a robot outside the range of known ground robots, each in a phrase with that
    range.

    >>> from homeward.physics import load_robot
    >>> implausible(load_robot("husky"))
    []
    """
    phrases = []
    for name, (low, high, unit) in thresholds.PLAUSIBLE.items():
        value = getattr(robot, name)
        if not low <= value <= high:
            usual = f"{low:g} to {high:g} {unit}".rstrip()  # some have no unit
            phrases.append(f"{name} = {value:g}, where {usual} is known")
    ancillary_w = sum(getattr(robot, name) for name in _ANCILLARY)
    if ancillary_w > thresholds.MOST_ANCILLARY_W:
        usual = f"at most {thresholds.MOST_ANCILLARY_W:g} W"
        phrases.append(f"{' + '.join(_ANCILLARY)} = {ancillary_w:g} W, where {usual} is known")
    j_per_kg = robot.rated_energy_j / robot.mass_kg
    if not thresholds.LEAST_J_PER_KG <= j_per_kg <= thresholds.MOST_J_PER_KG:
        usual = f"{thresholds.LEAST_J_PER_KG:g} to {thresholds.MOST_J_PER_KG:g}"
        phrases.append(f"rated_energy_j / mass_kg = {j_per_kg:.3g} J/kg, where {usual} is known")
    return phrases


def warn_of_implausible(robot: Any, source: str) -> None:
    """Warn of implausible values in a robot that was read from a source."""
    phrases = implausible(robot)
    if phrases:
        message = f"{source}: {'; '.join(phrases)}: is the unit right?"
        warnings.warn(message, PlausibilityWarning, stacklevel=_outside())


def _outside() -> int:
    """Number of frames up to the caller outside this package, whose line the warning names."""
    level = 1
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("homeward"):
        level += 1
        frame = frame.f_back
    return level
