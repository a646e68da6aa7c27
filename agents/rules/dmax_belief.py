"""The mapped rule by a robot that estimates its parameters and the wind, with a reserve of k standard deviations."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations
from homeward.agents.belief import Belief
from homeward.agents.rules.pace import Pace
from homeward.agents.rules.turn_back import BelievingRule, Outlook
from homeward.envs.options import Known
from homeward.estimation.prior import PER_CAPACITY

MISSED = 0.02
"""Probability that a forecast of the wind is taken to say nothing: chosen so that one reading that no forecast explains
in fifty is enough to doubt it."""


@final
class BeliefDmaxRule(BelievingRule):
    """Turns back when going on and then home would leave less than some standard deviations of what is left.

    Args:
        known: Constants of the environment.
        pace: Speed and sensing rate.
        deviations: Standard deviations k kept back, 0 or above.
        step_mps: Speed of the next decision that there must be energy for, but on patrols; cruise if left out.

    Attributes:
        belief: What it believes.
    """

    chances = 1.0  # it knows what the next one consumes

    def __init__(self, known: Known, pace: Pace, deviations: float, step_mps: float | None = None) -> None:
        super().__init__(known, pace, deviations)
        s = known.shared[0]
        self._onwards_mps = float(s["cruise_mps"])
        if step_mps is not None and not self._patrol:
            self._onwards_mps, self._outward_m = step_mps, step_mps * float(s["decision_s"])
        self.belief = Belief(known, MISSED)

    def look(self, observations: Observations, begun: NDArray[np.bool_]) -> Outlook:
        """What it believes, see `BelievingRule.look`."""
        self.belief.learn(observations, begun)
        s = self._known.shared[0]
        home = self.belief.plans(observations)
        onwards = home.copy()
        onwards["onwards_m"], onwards["onwards_s"] = self._outward_m, self._outward_m / self._onwards_mps
        onwards["speed_mps"] = self._onwards_mps
        onwards["onwards_j"] = self._extra_share * s["usable_j"]
        onwards["onwards_j"] += self.belief.estimator.vehicle.idle_w * onwards["onwards_s"]
        now, then = (self.belief.margin(plan, 0.0).total for plan in (home, onwards))
        full_j = s["usable_j"] / self.belief.estimator.mean()[:, PER_CAPACITY]
        return Outlook(
            left=now["left_j"] / full_j,
            home=now["cost_j"] / full_j,
            onwards=(then["cost_j"] - now["cost_j"]) / full_j,
            deviation=then["margin_sd_j"] / full_j,
        )
