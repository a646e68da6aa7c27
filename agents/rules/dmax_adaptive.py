"""The mapped rule, scaled by measured over modelled consumption, with a reserve of k standard
deviations."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from homeward.agents import thresholds
from homeward.agents.base import Observations, feature
from homeward.agents.rules.pace import Pace
from homeward.agents.rules.turn_back import BelievingRule, Outlook
from homeward.envs.options import Known
from homeward.physics import ancillary_power

_PRIOR = np.diag([0.01, 0.05])
"""Precision of the prior that the ratios of driving and of sensing are 1: the modelled energy with
equal weight, as a share of the usable energy. Chosen: electronics are better known than ground."""


@final
class AdaptiveDmaxRule(BelievingRule):
    """Estimates the ratio of measured to modelled consumption on the way, and its variance.

    The energy of a decision is a ratio times its modelled driving plus another ratio times its
    modelled sensing, and an error with a variance that grows with both. Regularised least squares
    estimate both ratios, with 1 as the prior. (With one ratio for both, the sensing of the way out
    would hide the consumption of driving home.) The way home is scaled by the ratio of driving. Its
    standard deviation combines the residuals of the fit and the wind, which the way out does not
    show.

    Args:
        known: Constants of the environment.
        pace: Speed and sensing rate.
        deviations: Reserve in standard deviations k, 0 or above.
    """

    def __init__(self, known: Known, pace: Pace, deviations: float) -> None:
        super().__init__(known, pace, deviations)
        self._forget(0)

    def look(self, observations: Observations, begun: NDArray[np.bool_]) -> Outlook:
        """Mean and standard deviation of the energies, see `BelievingRule.look`."""
        self._learn(observations, begun)
        target = (self._moment + np.diag(_PRIOR))[..., None]
        ratios: NDArray[np.float64] = np.linalg.solve(self._normal + _PRIOR, target)[..., 0]
        explained = np.einsum("ni,nij,nj->n", ratios, self._normal, ratios)
        # Sum of the weighted squares of the fit's residuals, from its normal equations: y'y - 2
        # r'X'y + r'X'X r.
        residual: NDArray[np.float64] = (
            self._square - 2.0 * np.einsum("ni,ni->n", ratios, self._moment) + explained
        )
        modelled = self._last[:, 1]
        spread = np.maximum(residual, 0.0) / np.maximum(modelled, 1e-9)
        home = feature(observations, "home_cost")
        onwards = self.cost_of_going_on(observations)
        return Outlook(
            energy_left=feature(observations, "metered"),
            home=ratios[:, 0] * home,
            onwards=ratios[:, 0] * onwards,
            deviation=np.sqrt(spread + thresholds.UNSEEN_HOME**2) * (home + onwards),
        )

    def _forget(self, count: int) -> None:
        self._charged: Any = np.zeros(count)  # energy that chargers supplied so far
        # energy used and modelled so far, shares of the usable energy
        self._last = np.zeros((count, 2))
        # normal equations: weighted products of driving and sensing,
        self._normal = np.zeros((count, 2, 2))
        self._moment = np.zeros((count, 2))  # their products with the energy used,
        self._square = np.zeros(count)  # and the square of the latter

    def _learn(self, observations: Observations, begun: NDArray[np.bool_]) -> None:
        """Add the last decision to the sums; all energies are shares of the usable energy."""
        if len(begun) != len(self._square):
            self._forget(len(begun))
        for total in (self._last, self._normal, self._moment, self._square):
            total[begun] = 0.0
        charged = self.charged(observations)
        used_so_far = 1.0 - feature(observations, "metered") + charged
        totals = np.stack((used_so_far, feature(observations, "modelled")), axis=-1)
        used, modelled = (totals - self._last).T
        # Beside a charger's power, that of the robot is not metered well.
        drawn = charged == self._charged
        self._charged = charged
        self._last = totals
        sensing = np.minimum(self._sensing(observations), modelled)
        causes = np.stack((modelled - sensing, sensing), axis=-1)
        weight = np.divide(1.0, modelled, out=np.zeros_like(modelled), where=modelled > 0.0)
        weight *= drawn
        self._normal += weight[:, None, None] * causes[:, :, None] * causes[:, None, :]
        self._moment += (weight * used)[:, None] * causes
        self._square += weight * used * used

    def _sensing(self, observations: Observations) -> NDArray[np.float64]:
        """Energy of sensing in the last decision by the robot's file, share of the usable energy,
        shape (n,)."""
        robot = self._known.robot
        s = self._known.shared[0]
        rate_hz = feature(observations, "sensing") * s["max_sensing_hz"]
        power_w = ancillary_power(robot, rate_hz) - ancillary_power(robot, 0.0)
        return np.asarray(power_w * s["decision_s"] / s["usable_j"])
