"""Detection of a charged or swapped battery by its state of charge."""

from __future__ import annotations

import math
from typing import ClassVar

from homeward.watch import thresholds


class Charge:
    """Distinguishes a charged or swapped battery from one that recovers while the robot rests."""

    SAVED: ClassVar = ("_from", "_charging")

    def __init__(self) -> None:
        self._from = math.inf
        self._charging = False

    def see(self, soc: float) -> bool:
        """Whether the battery was charged or swapped since the last state of charge."""
        risen = soc - self._from
        # It begins with a clear rise, and ends with a fall.
        least_rise = -thresholds.SOC_STEP if self._charging else thresholds.CHARGED
        self._charging = risen > least_rise
        charged = self._charging and risen > 0.0
        if charged or (risen < 0.0 and not self._charging):
            self._from = soc
        return charged
