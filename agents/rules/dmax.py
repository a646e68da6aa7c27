"""The paper's rule: turn back when d_max, at the known mean grade, is at most the way home."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, feature
from homeward.agents.rules.docking import Energies
from homeward.agents.rules.pace import Pace
from homeward.agents.rules.turn_back import TurnBackRule
from homeward.envs.options import Known


@final
class DmaxRule(TurnBackRule):
    """Turns back when the energy left, less a reserve, reaches no further than home by Eq. 8.

    Args:
        known: Constants of the environment.
        pace: Speed and sensing rate.
        reserve: Share of the usable energy kept as a reserve, within [0, 1].

    Source: Tiwari, Xiao, Chong, IROS 2018, Eq. 8, with the mean grade assumed known as there.
    """

    def __init__(self, known: Known, pace: Pace, reserve: float) -> None:
        super().__init__(known, pace)
        self._reserve = reserve

    def energies(self, observations: Observations) -> Energies:
        """Energies of the last decision, with the way home on the average grade, see
        `TurnBackRule.energies`."""
        return super().energies(observations)._replace(home=self.home_cost_on_average(observations))

    def margin_above_reserve(
        self, observations: Observations, begun: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Energy beyond the way home on the average grade and the reserve, see
        `TurnBackRule.margin_above_reserve`."""
        needed = self.home_cost_on_average(observations) + self.cost_of_going_on(observations)
        return feature(observations, "metered") - needed - self._reserve
