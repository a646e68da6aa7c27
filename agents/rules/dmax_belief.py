"""The mapped rule with estimated parameters and wind, and a reserve of k standard deviations."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from homeward.agents import thresholds
from homeward.agents.base import Observations
from homeward.agents.belief import Belief
from homeward.agents.rules.pace import Pace
from homeward.agents.rules.turn_back import BelievingRule, Outlook
from homeward.envs.options import Known
from homeward.estimation.prior import PER_CAPACITY


@final
class BeliefDmaxRule(BelievingRule):
    """Turns back when the posterior mean of the margin, after going on and home, is below k
    standard deviations.

    Args:
        known: Constants of the environment.
        pace: Speed and sensing rate.
        deviations: Reserve in standard deviations k, 0 or above.
        step_mps: Speed (m/s) of the next decision for which there must be energy, except on
            patrols; default cruise.

    Attributes:
        belief: Posterior of robot and wind.
    """

    chances = 1.0  # the consumption of the next decision is known

    def __init__(
        self, known: Known, pace: Pace, deviations: float, step_mps: float | None = None
    ) -> None:
        super().__init__(known, pace, deviations)
        s = known.shared[0]
        self._onwards_mps = float(s["cruise_mps"])
        if step_mps is not None and not self._shuttles:
            self._onwards_mps = step_mps
            self._outward_m = step_mps * float(s["decision_s"])
        self.belief = Belief(known, thresholds.MISSED)

    def look(self, observations: Observations, begun: NDArray[np.bool_]) -> Outlook:
        """Posterior mean and standard deviation of the energies, see `BelievingRule.look`."""
        self.belief.learn(observations, begun)
        s = self._known.shared[0]
        home = self.belief.plans(observations)
        onwards = home.copy()
        onwards["onwards_m"] = self._outward_m
        onwards["onwards_s"] = self._outward_m / self._onwards_mps
        onwards["speed_mps"] = self._onwards_mps
        onwards["onwards_j"] = self._extra_share * s["usable_j"]
        onwards["onwards_j"] += self.belief.estimator.vehicle.idle_w * onwards["onwards_s"]
        now = self.belief.margin(home, 0.0).total
        then = self.belief.margin(onwards, 0.0).total
        full_j = s["usable_j"] / self.belief.estimator.mean()[:, PER_CAPACITY]
        return Outlook(
            energy_left=now["left_j"] / full_j,
            home=now["cost_j"] / full_j,
            onwards=(then["cost_j"] - now["cost_j"]) / full_j,
            deviation=then["margin_sd_j"] / full_j,
        )
