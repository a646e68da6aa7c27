"""Several batteries in one log: which is the whole, which are its parts; for bags, logs of
autopilots and live input.

A robot reports more than one battery by several topics, by messages of one topic with another
location or serial number, or by instances of a message of an autopilot. The rules, in this order:

1. A battery whose current is the sum of the others is the whole.
2. Names that differ by a number or a side, at one voltage, are packs in parallel: their currents
   are added.
3. Equal readings are one battery that is reported twice.
4. Otherwise nobody but the user knows.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homeward.logs import thresholds
from homeward.logs.channels import POWER, Array
from homeward.logs.columns import RecordingError

ELECTRIC = frozenset(name for names in POWER for name in names)
OF_BATTERY = frozenset({"power_w", "voltage_v", "current_a", "soc"})
"""Channels of a battery."""
ADDED = frozenset({"power_w", "current_a"})
"""Those that are added over packs in parallel; of the others the mean is taken."""

_PLACES = re.compile(r"\d+|left|right|front|rear|back|middle|center", re.IGNORECASE)


@dataclass(frozen=True)
class Battery:
    """What a battery reports: its name, and its readings of voltage, V, and of current, A, or
    power, W."""

    name: str
    voltage_v: Array
    drawn: Array

    def __str__(self) -> str:
        voltage_v = self.voltage_v[np.isfinite(self.voltage_v)]
        at_voltage = f" at {np.median(voltage_v):.3g} V" if len(voltage_v) else ""
        return f"{self.name} ({self._mean:.3g}{at_voltage})"

    @property
    def _mean(self) -> float:
        return float(np.nanmean(self.drawn))


@dataclass(frozen=True)
class Choice:
    """The batteries that are used, which are added if they are several, and why, in a line."""

    names: tuple[str, ...]
    why: str


def choose(batteries: Sequence[Battery], several: str = "") -> Choice:
    """Choose among batteries that all report a current or power.

    Args:
        batteries: At least two.
        several: What the mapping says: "sum", "first", or "" for nothing.

    Raises:
        RecordingError: It is not clear, and would change the answer.
    """
    names = tuple(battery.name for battery in batteries)
    listed = ", ".join(str(battery) for battery in batteries)
    if several == "sum":
        return Choice(names, f"batteries {listed}: added, as the mapping says")
    if several == "first":
        return Choice(names[:1], f"batteries {listed}: {names[0]} is used, as the mapping says")
    total = _sum_of_others(batteries)
    if total is not None:
        return Choice(
            (total.name,), f"batteries {listed}: {total.name} is the sum of the others, and used"
        )
    names_without_place = {_PLACES.sub("", name) for name in names}
    if len(names_without_place) == 1 and _one_voltage(batteries):
        return Choice(
            names, f"batteries {listed}: added, as packs in parallel by their names and voltage"
        )
    if all(_equal(batteries[0], battery) for battery in batteries[1:]):
        return Choice(names[:1], f"batteries {listed}: readings are equal, so {names[0]} is used")
    raise RecordingError(
        f"has several batteries, and not which is the whole: {listed}; name one in a mapping file (--columns), "
        'or say several = "sum" in it'
    )


def _sum_of_others(batteries: Sequence[Battery]) -> Battery | None:
    """The battery whose mean current is the sum of at least two others'; None if there is none."""
    if len(batteries) < 3:
        return None
    means = np.array([np.nanmean(battery.drawn) for battery in batteries])
    for battery, mean in zip(batteries, means, strict=True):
        sum_of_others = means.sum() - mean
        if abs(mean - sum_of_others) <= thresholds.SAME_BATTERY * abs(mean):
            return battery
    return None


def _one_voltage(batteries: Sequence[Battery]) -> bool:
    """Whether all report a voltage, and their medians are equal but for the drop on leads."""
    readings = [battery.voltage_v[np.isfinite(battery.voltage_v)] for battery in batteries]
    medians_v = [float(np.median(voltage_v)) for voltage_v in readings if len(voltage_v)]
    if len(medians_v) < len(batteries):
        return False
    return max(medians_v) - min(medians_v) <= thresholds.SAME_BATTERY * max(medians_v)


def _equal(battery: Battery, repeated: Battery) -> bool:
    """Whether the quantiles of both currents are equal: they need not come at the same times."""
    shares = np.linspace(0.0, 1.0, 11)
    quantiles = np.nanquantile(battery.drawn, shares)
    quantiles_repeated = np.nanquantile(repeated.drawn, shares)
    largest = np.abs(quantiles).max()
    same_current = bool(
        np.abs(quantiles - quantiles_repeated).max() <= thresholds.SAME_READING * largest
    )
    return same_current and _one_voltage([battery, repeated])
