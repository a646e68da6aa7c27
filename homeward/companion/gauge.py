"""Whether the state-of-charge reading is believed: three explanations of it, weighed by how well
they predict it.

* It follows the charge, within the errors of the prior.
* It did, until it jumped, was reset or stayed: since then it says nothing.
* It has a course of its own, as a percentage has that is a map of the voltage: it never said
  anything.

The first predicts a reading from the charge of each possible battery, the others from the reading
before. The probability of an explanation and a battery together follows by the forward algorithm of
hidden Markov models (Rabiner, Proceedings of the IEEE 77, 1989): a battery that was likely before
the gauge jumped remains so after it.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from homeward.companion import thresholds
from homeward.estimation import Prior

Floats = NDArray[np.float64]

FOLLOWS, JUMPED, OWN = range(3)
"""The explanations."""

_TRANSITIONS = np.array(
    [
        [1.0 - thresholds.GAUGE_CHANGES, thresholds.GAUGE_CHANGES, 0.0],
        [thresholds.GAUGE_CHANGES, 1.0 - thresholds.GAUGE_CHANGES, 0.0],
        [thresholds.GAUGE_CHANGES, 0.0, 1.0 - thresholds.GAUGE_CHANGES],
    ]
)
"""Probability of an explanation in a window (column), given that of the window before (row)."""


class GaugeTrust:
    """Probabilities of explanations and possible batteries.

    A gauge that follows the charge has two errors of its own, estimated for each battery by a
    Kalman filter: an offset that wanders, and a gain. A gauge that rounds says most when its
    reading changes: then the charge is between the two. While it does not change it says only that
    the charge is within the coarsest step that gauges have.

    Args:
        weights: Probabilities of the batteries, shape (n,).
        prior: The errors of a gauge that follows the charge.
        start: State of charge of each battery at the start, shape (n,).
        gain: Fall of the reading over that of the charge, by battery, shape (n,).
        gain_sd: Standard deviation of that.
        rate_per_h: Mean rate of the discharge, by which a gauge that lags is off.

    Attributes:
        joint: Probabilities of explanations and batteries, shape (3, n).
        start: State of charge of each battery at the start, shape (n,).
    """

    SAVED: ClassVar = (
        "joint", "start", "_offset", "_gain", "_covariance", "_last", "_drawn", "_fallen", "_wanders",
    )  # fmt: skip

    def __init__(
        self,
        weights: Floats,
        prior: Prior,
        start: Floats,
        gain: Floats,
        gain_sd: Floats,
        rate_per_h: float,
    ) -> None:
        self._prior = prior
        self._noise_variance = prior.soc_sd**2
        of_lag = rate_per_h * max(prior.soc_lag_s, thresholds.GAUGE_LAG_S) / 3600.0
        self._offset_variance = max(prior.soc_error, thresholds.COUNTER_SD) ** 2 + of_lag**2
        self.joint = np.outer([1.0 - thresholds.OWN_COURSE, 0.0, thresholds.OWN_COURSE], weights)
        self.start = start
        self._offset = np.zeros_like(weights)
        self._gain = gain.copy()
        gain_variance = gain_sd**2 + thresholds.COUNTER_GAIN_SD**2
        # Of offset and gain: variance of the first, covariance, variance of the second.
        self._covariance = np.stack(
            [np.full_like(weights, self._offset_variance), 0.0 * weights, gain_variance]
        )
        self._drawn = np.zeros_like(weights)
        self._last = math.nan
        self._fallen = 0.0
        # variance of the change from reading to reading, beyond the fall
        self._wanders = thresholds.GAUGE_WANDERS**2

    def recharge(self, joint: Floats, start: Floats, gain: Floats, gain_variance: Floats) -> None:
        """Go on after a charge: explanations and gain stay known, the offset is another one.

        Args:
            joint: Probabilities of explanations and batteries, shape (3, n).
            start: State of charge of each battery after it, shape (n,).
            gain: Fall of the reading over that of the charge, by battery, shape (n,).
            gain_variance: Variance of that, shape (n,).
        """
        self.joint = joint
        self.start = start
        self._gain = gain
        zeros = np.zeros_like(start)
        self._offset = zeros
        self._drawn = zeros
        self._covariance = np.stack(
            [np.full_like(start, self._offset_variance), zeros, gain_variance]
        )
        self._last = math.nan
        self._fallen = 0.0

    @property
    def gain(self) -> tuple[Floats, Floats]:
        """Fall of the reading over that of the charge, by battery, and its variance, each of shape
        (n,)."""
        return self._gain, np.asarray(self._covariance[2])

    @property
    def has_begun(self) -> bool:
        """Whether there was a reading."""
        return math.isfinite(self._last)

    @property
    def weights(self) -> Floats:
        """Probability of each battery, shape (n,)."""
        return np.asarray(self.joint.sum(axis=0))

    @property
    def probabilities(self) -> Floats:
        """Probability of each explanation, shape (3,)."""
        return np.asarray(self.joint.sum(axis=1))

    @property
    def believed(self) -> int:
        """The most probable explanation."""
        return int(np.argmax(self.probabilities))

    def see(self, reading: float, drawn: Floats, variance: Floats, likelihood: Floats) -> None:
        """Weigh explanations and batteries by a window.

        Args:
            reading: State of charge as shown; NaN: none.
            drawn: Charge drawn since the start, by battery, shape (n,).
            variance: Variance of that, shape (n,).
            likelihood: Likelihood of all other readings of the window, by battery, shape (n,).
        """
        drawn_before = self._drawn
        self._drawn = drawn
        self._wander(drawn - drawn_before)
        by_explanation = np.ones_like(self.joint)
        if math.isfinite(reading):
            if not self.has_begun:
                by_explanation[FOLLOWS] = self._follow(reading, drawn, variance)
                # One with a course of its own still shows a full battery as rather full.
                by_explanation[JUMPED:] = _likelihood(
                    reading - self.start + drawn, np.array(thresholds.OWN_START_SD**2)
                )
            elif reading == self._last:
                error = np.abs(reading - self._expected(drawn))
                near = ndtr((thresholds.COARSEST - error) / thresholds.COARSEST_SD)
                by_explanation[FOLLOWS] = np.maximum(near, thresholds.GAUGE_OUTLIERS)
            else:
                by_explanation = self._weigh_change(reading, 0.5 * (drawn_before + drawn), variance)
            self._last = reading
        # A gauge that jumps may show anything, so that its reading then is no evidence.
        jumps = thresholds.GAUGE_CHANGES * self.joint[FOLLOWS]
        joint = (_TRANSITIONS.T @ self.joint) * by_explanation
        joint[JUMPED] += jumps * (1.0 - by_explanation[JUMPED])
        joint *= likelihood
        total = joint.sum()
        if total > 0.0:
            self.joint = joint / total

    def _expected(self, drawn: Floats) -> Floats:
        """Reading of a gauge that follows, by battery."""
        return self.start - self._gain * drawn + self._offset

    def _wander(self, drawn: Floats) -> None:
        """The offset becomes another one, as a lag or a curve that is not the battery's does."""
        self._fallen += float(self.weights @ (self._gain * drawn))
        stays = math.exp(-abs(float(self.weights @ drawn)) / self._prior.soc_error_lasts)
        self._offset *= stays
        of_offset, of_both, of_gain = self._covariance
        renewed = self._offset_variance * (1.0 - stays * stays)
        self._covariance = np.stack([stays * stays * of_offset + renewed, stays * of_both, of_gain])

    def _weigh_change(self, reading: float, drawn: Floats, variance: Floats) -> Floats:
        """Likelihood of a reading that changed, by explanation and battery; the errors of the gauge
        are updated."""
        change = reading - self._last
        weights = self.weights
        expected = self._expected(drawn)
        between = (expected - weights @ expected) ** 2
        mixture_variance = float(weights @ (self._total_variance(drawn, variance) + between))
        innovation = change + self._fallen
        # A reading that only rounds is as near to the one before as to the expected one: that is no
        # evidence.
        change_variance = max(self._wanders, mixture_variance)
        by_explanation = np.empty_like(self.joint)
        by_explanation[JUMPED:] = _likelihood(np.array(innovation), np.array(change_variance))
        # One that rounds passed an edge: it changes by no more than was drawn since the last one,
        # and never against it.
        step = 0.0
        if change * self._fallen < 0.0:
            step = min(abs(change), abs(self._fallen))
        shown = reading - 0.5 * math.copysign(step, change)
        by_explanation[FOLLOWS] = self._follow(shown, drawn, variance + step * step / 12.0)
        self._wanders += thresholds.GAUGE_LEARNS * (innovation**2 - self._wanders)
        self._fallen = 0.0
        return by_explanation

    def _total_variance(self, drawn: Floats, variance: Floats) -> Floats:
        """Variance of a reading that follows, by battery."""
        of_offset, of_both, of_gain = self._covariance
        gauge_variance = of_offset - 2.0 * drawn * of_both + drawn * drawn * of_gain
        return np.asarray(gauge_variance + self._noise_variance + variance)

    def _follow(self, reading: float, drawn: Floats, variance: Floats) -> Floats:
        """Likelihood of a reading that follows, by battery; the errors of the gauge are updated."""
        innovation = reading - self._expected(drawn)
        innovation_variance = self._total_variance(drawn, variance)
        likelihood = _likelihood(innovation, innovation_variance)
        # As far as it is this explanation that holds, the errors explain the innovation.
        holds = self.joint[FOLLOWS] / np.maximum(self.joint.sum(axis=0), 1e-300)
        limit = thresholds.GAUGE_DOUBT * np.sqrt(innovation_variance)
        innovation = holds * np.clip(innovation, -limit, limit)
        of_offset, of_both, of_gain = self._covariance
        # Covariance of the reading with offset and gain.
        with_offset = of_offset - drawn * of_both
        with_gain = of_both - drawn * of_gain
        self._offset = self._offset + with_offset / innovation_variance * innovation
        self._gain = self._gain + with_gain / innovation_variance * innovation
        per_variance = holds / innovation_variance
        self._covariance = np.stack(
            [
                of_offset - per_variance * with_offset * with_offset,
                of_both - per_variance * with_offset * with_gain,
                of_gain - per_variance * with_gain * with_gain,
            ]
        )
        return likelihood


def _likelihood(error: Floats, variance: Floats) -> Floats:
    """Density of a reading, of which a few are outliers, anywhere between empty and full."""
    normal = np.exp(-0.5 * error * error / variance) / np.sqrt(2.0 * math.pi * variance)
    return np.asarray((1.0 - thresholds.GAUGE_OUTLIERS) * normal + thresholds.GAUGE_OUTLIERS)
