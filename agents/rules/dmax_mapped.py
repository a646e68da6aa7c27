"""Turn back when the energy left is no more than that of the way home, with the grades measured on
the way out."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, feature
from homeward.agents.rules.pace import Pace
from homeward.agents.rules.turn_back import TurnBackRule
from homeward.envs.options import Known


@final
class MappedDmaxRule(TurnBackRule):
    """The paper's rule, with every grade of the way home known from the way out.

    Args:
        known: Constants of the environment.
        pace: Speed and sensing rate.
        reserve: Share of the usable energy kept as a reserve, within [0, 1].
    """

    def __init__(self, known: Known, pace: Pace, reserve: float) -> None:
        super().__init__(known, pace)
        self._reserve = reserve

    def margin_above_reserve(
        self, observations: Observations, begun: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Energy beyond the way home over mapped ground and the reserve, see
        `TurnBackRule.margin_above_reserve`."""
        return feature(observations, "margin") - self.cost_of_going_on(observations) - self._reserve
