"""Whether the state-of-charge reading is believed: three explanations of it, weighed by how well they predict it.

* It follows the charge, within the errors of the prior.
* It did, until it jumped, was reset or stayed: since then it says nothing.
* It has a course of its own, as a percentage has that is a map of the voltage: it never said anything.

The first predicts a reading from the energy drawn and the estimated capacity, the others from the reading before. Power
integrates by itself, so that each explanation has an estimate of the energy left, with the readings or without them.
"""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.companion import rules
from homeward.estimation import Prior
from homeward.estimation.prior import PER_CAPACITY, SOC_ERROR, USED

FOLLOWS, JUMPED, OWN = range(3)
"""The explanations."""
EXPLANATIONS = 3

_TRANSITIONS = np.array(
    [
        [1.0 - rules.GAUGE_CHANGES, rules.GAUGE_CHANGES, 0.0],
        [rules.GAUGE_CHANGES, 1.0 - rules.GAUGE_CHANGES, 0.0],
        [rules.GAUGE_CHANGES, 0.0, 1.0 - rules.GAUGE_CHANGES],
    ]
)
"""Probability of an explanation in a window (column), given that of the window before (row)."""


class Predicted(NamedTuple):
    """Reading of a gauge that follows the charge, as predicted.

    Attributes:
        soc: State of charge, as a share of the energy.
        variance: Variance of the reading about it.
        per_capacity: Share of the charge per energy used, over that of a full battery by the robot's file.
        prior: Prior of the estimator, with the errors of the gauge.
        fallen: How much of the state of charge has been used since.
    """

    soc: float
    variance: float
    per_capacity: float
    prior: Prior
    fallen: float = 0.0

    def after(self, used: float, variance: float) -> Predicted:
        """The prediction after an energy was used, of a given variance, both over that of a full battery."""
        fallen, prior = self.per_capacity * used, self.prior
        kept = math.exp(-abs(used) / prior.soc_error_lasts)
        wandered = prior.soc_error**2 * (1.0 - kept * kept)
        variance = self.variance + self.per_capacity**2 * max(variance, 0.0) + wandered
        return self._replace(soc=self.soc - fallen, variance=variance, fallen=fallen)


class GaugeTrust:
    """Weights of the explanations.

    Attributes:
        weights: Probability of each explanation, shape (EXPLANATIONS,).
    """

    SAVED: ClassVar = ("weights", "_last", "_fallen", "_wanders")

    def __init__(self) -> None:
        self.weights = np.array([1.0 - rules.OWN_COURSE, 0.0, rules.OWN_COURSE])
        self._last, self._fallen = math.nan, 0.0
        self._wanders = rules.GAUGE_WANDERS**2  # variance of the change from reading to reading, beyond the fall

    def see(self, reading: float, predicted: Predicted) -> None:
        """Weigh the explanations by the reading of a window.

        Args:
            reading: State of charge, as a share of the energy; NaN: none.
            predicted: What it is if it follows the charge.
        """
        self._fallen += predicted.fallen
        if not math.isfinite(reading):
            return
        surprise = reading - (self._last - self._fallen)
        if math.isfinite(self._last):
            # A reading that only rounds is as near to the one before as to the prediction: that is no evidence.
            wanders = max(self._wanders, predicted.variance)
            follows, other = _likelihood(reading - predicted.soc, predicted.variance), _likelihood(surprise, wanders)
            weights = (self.weights @ _TRANSITIONS) * np.array([follows, other, other])
            self.weights = weights / weights.sum()
            self._wanders += rules.GAUGE_LEARNS * (surprise**2 - self._wanders)
        self._last, self._fallen = reading, 0.0

    @property
    def believed(self) -> int:
        """The most probable explanation."""
        return int(np.argmax(self.weights))

    @property
    def surely_follows(self) -> bool:
        """Whether the reading is believed: a jump, if there is one, is yet to come."""
        return bool(self.weights[FOLLOWS] > rules.GAUGE_SURE)

    @property
    def surely_not(self) -> bool:
        """Whether the reading is not believed: if it is right again, that begins now."""
        return bool(self.weights[FOLLOWS] < 1.0 - rules.GAUGE_SURE)


def _likelihood(error: float, variance: float) -> float:
    """Density of a reading, of which a few are outliers, anywhere between empty and full."""
    normal = math.exp(-0.5 * error * error / variance) / math.sqrt(2.0 * math.pi * variance)
    return (1.0 - rules.GAUGE_OUTLIERS) * normal + rules.GAUGE_OUTLIERS


def prediction(hypotheses: NDArray[np.void], robot: np.void, prior: Prior) -> Predicted:
    """The next reading by an estimate, before energy is used.

    Args:
        hypotheses: `HYPOTHESIS_DTYPE`, shape (hypotheses,).
        robot: `ROBOT_DTYPE`.
        prior: Prior of the estimator.
    """
    weight, mean = np.exp(hypotheses["log_weight"]), hypotheses["mean"]
    spent, per_capacity = mean[:, USED] - robot["lag"], mean[:, PER_CAPACITY]
    soc_by_hypothesis = robot["soc_start"] - per_capacity * spent + mean[:, SOC_ERROR]
    gradient = np.zeros_like(mean)
    gradient[:, USED], gradient[:, PER_CAPACITY], gradient[:, SOC_ERROR] = -per_capacity, -spent, 1.0
    variances = np.einsum("ka,kab,kb->k", gradient, hypotheses["covariance"], gradient)
    soc = float(weight @ soc_by_hypothesis)
    variance = float(weight @ (variances + (soc_by_hypothesis - soc) ** 2))
    return Predicted(soc, variance + prior.soc_sd**2, float(weight @ per_capacity), prior)
