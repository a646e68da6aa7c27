"""Turn back at a state of charge, by default half, as many robots do today."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, feature
from homeward.agents.rules.pace import Pace
from homeward.agents.rules.turn_back import TurnBackRule
from homeward.envs.options import Known


@final
class StateOfChargeRule(TurnBackRule):
    """Turns back when the state-of-charge reading falls below a threshold, wherever the robot is.

    Args:
        known: Constants of the environment.
        pace: Speed and sensing rate.
        threshold: State of charge, within [0, 1].
    """

    def __init__(self, known: Known, pace: Pace, threshold: float = 0.5) -> None:
        super().__init__(known, pace)
        self._threshold = threshold

    def margin_above_reserve(
        self, observations: Observations, begun: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Charge above the threshold, see `TurnBackRule.margin_above_reserve`."""
        return feature(observations, "energy") - self._threshold
