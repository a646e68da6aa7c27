"""The mapped rule by a robot that finds out what it is today, with a reserve of k standard deviations."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, feature
from homeward.agents.identification import Identification
from homeward.agents.rules.pace import Pace
from homeward.agents.rules.rule import BelievingRule, Outlook
from homeward.envs.options import Known


@final
class IdentifiedDmaxRule(BelievingRule):
    """Costs the way home with the numbers that `Identification` finds, the wind from the other side included.

    It cannot identify what does not show at one speed: whoever drives by it changes speed now and then
    (`Identification.probes`).

    Args:
        known: Constants of the environment.
        pace: Speed and sensing rate.
        deviations: Standard deviations k kept back, 0 or above.

    Attributes:
        identification: What it has found out.
    """

    chances = 1.0  # it knows what the next one takes

    def __init__(self, known: Known, pace: Pace, deviations: float) -> None:
        super().__init__(known, pace, deviations)
        self.identification = Identification(known)
        self._gauge_error = gauge_error(known)

    def look(self, observations: Observations, begun: NDArray[np.bool_]) -> Outlook:
        """What it believes, see `BelievingRule.look`."""
        self.identification.learn(observations, begun)
        gauge = self._gauge_error * (1.0 - feature(observations, "metered"))
        home, deviation, onwards, own_onwards = self.identification.look_home(observations, self._outward_m).T
        sensing = self.identification.unknown[:, 0]
        return Outlook(
            home=home,
            onwards=onwards + sensing * self._extra_share,
            deviation=np.hypot(deviation, gauge),
            driving=onwards / np.maximum(own_onwards, 1e-9),
            sensing=sensing,
        )


def gauge_error(known: Known) -> float:
    """Standard deviation of a reading of the state of charge, as a share of a full battery."""
    return float(known.instruments.soc_variance**0.5)
