"""The cut-off voltage of the battery: energy left until it is reached."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from homeward.companion import rules

_FORGETS = 0.97
"""Weight of a window relative to the next: about thirty windows count. Chosen: the last seventh of a charge (30 of 200
windows)."""


class Cutoff:
    """Fits the voltage as a - R I - b u, with the current I and the share u of the battery used, and extends it.

    The line is straight. If the voltage falls steeply near the end, the cut-off comes earlier than estimated; if it
    falls steeply at first, later.

    Args:
        voltage_v: Cut-off voltage, V.
    """

    SAVED: ClassVar = ("_normal", "_moment", "_windows", "_first", "_now")

    def __init__(self, voltage_v: float) -> None:
        self.voltage_v = voltage_v
        self._normal, self._moment = np.zeros((3, 3)), np.zeros(3)
        self._windows, self._first, self._now = 0, math.nan, (math.nan, math.nan, math.nan)

    def see(self, voltage_v: float, current_a: float, used: float) -> None:
        """Process the means of a window and the share of the battery used."""
        if not math.isfinite(voltage_v + current_a + used):
            return
        row = np.array([1.0, -current_a, -used])
        self._normal = _FORGETS * self._normal + np.outer(row, row)
        self._moment = _FORGETS * self._moment + row * voltage_v
        self._windows += 1
        self._first = used if math.isnan(self._first) else self._first
        self._now = voltage_v, current_a, used

    def left(self) -> float:
        """Share of the battery until the cut-off at the present current; infinite where it cannot be estimated yet."""
        voltage_v, _, used = self._now
        if voltage_v <= self.voltage_v:
            return 0.0
        if self._windows < rules.CUTOFF_WINDOWS or abs(used - self._first) < rules.CUTOFF_SPAN:
            return math.inf
        fall = float(np.linalg.lstsq(self._normal, self._moment, rcond=1e-9)[0][2])
        return (voltage_v - self.voltage_v) / fall if fall > 0.0 else math.inf
