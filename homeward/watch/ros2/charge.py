"""Detection of a charged or swapped battery by its state of charge."""

from __future__ import annotations

import math

_CHARGED = 0.1
"""Rise of the state of charge for a charge: monitors that measure voltage rise by some per cent when the robot
stops. Chosen: above those."""
_STEP = 0.015
"""Fall after which a charge is over: more than a step of most monitors, which show whole per cents (Smart Battery Data
Specification 1.1)."""


class Charge:
    """Distinguishes a charged or swapped battery from one that recovers while the robot rests."""

    def __init__(self) -> None:
        self._from, self._charging = math.inf, False

    def see(self, soc: float) -> bool:
        """Whether the battery was charged or swapped since the last state of charge."""
        risen = soc - self._from
        self._charging = risen > -_STEP if self._charging else risen > _CHARGED
        charged = self._charging and risen > 0.0
        if charged or (risen < 0.0 and not self._charging):
            self._from = soc
        return charged
