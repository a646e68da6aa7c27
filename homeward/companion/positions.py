"""Positions filtered by dead reckoning, so that their noise does not become a longer trail.

What corrects the place corrects the trail behind it too, as far as both share their error
(`Correction`).

Two numbers are learned from the differences between the change of the positions and that by speed
and heading. Their variance is twice that of a position, as noise of one reading is in two
differences. Their mean is the error of dead reckoning, as noise cancels in it.
"""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.companion import thresholds

Pair = NDArray[np.float64]
_AXES = 2
_LEAST_VARIANCE_M2 = 1e-12  # above 0, because it divides: a micrometre squared
_FEWEST = 2  # differences that have a mean and a deviation


class Correction(NamedTuple):
    """What a position changes, for a fixed-point smoother of earlier places (Anderson & Moore,
    1979, chapter 7).

    Attributes:
        moved: By how much the place was corrected, east and north, m.
        shared: Part of that by which the place at the position before was off, too, 0 to 1.
    """

    moved: Pair
    shared: float


class PositionFilter:
    """A Kalman filter of the position, with one variance for both axes.

    Attributes:
        place: East and north, m.
    """

    SAVED: ClassVar = (
        "place", "_variance", "_last", "_reckoned", "_drift", "_knows", "_mean", "_square", "_count",
    )  # fmt: skip

    def __init__(self, place: Pair) -> None:
        self.place = place
        self._variance = math.inf
        self._last = np.full(_AXES, math.nan)
        self._reckoned = np.zeros(_AXES)
        self._drift = 0.0
        self._knows = True
        self._mean = np.zeros(_AXES)
        self._square = 0.0
        self._count = 0

    def reckon(self, moved: Pair, error: float = thresholds.DEAD_RECKONING_ERROR) -> None:
        """Dead reckoning: the robot moved by east and north, m.

        Args:
            moved: The change.
            error: Its relative standard deviation; 1 where it is a guess, from which no noise is
                learned.
        """
        self.place = self.place + moved
        self._reckoned = self._reckoned + moved
        self._drift = math.hypot(self._drift, error * float(np.hypot(*moved)))
        self._knows &= error < 1.0

    def see(self, position: Pair, reckons: bool) -> Correction:
        """Process a position.

        Args:
            position: As read.
            reckons: Whether dead reckoning covers the time since the last one; if not, the position
                is taken as it is.
        """
        place_before = self.place
        shared = 0.0
        if not reckons or not np.isfinite(self._last).all():
            self.place = position.copy()
            self._variance = math.inf
        else:
            if self._knows:
                self._learn(position - self._last - self._reckoned)
            shared = self._update(position)
        self._last = position.copy()
        self._reckoned = np.zeros(_AXES)
        self._drift = 0.0
        self._knows = True
        return Correction(self.place - place_before, shared)

    def _learn(self, difference: Pair) -> None:
        """Learn from the change of the positions less that of dead reckoning."""
        noise_before = self.noise_variance
        self._count += 1
        weight = max(1.0 / self._count, thresholds.POSITION_LEARNS)
        self._mean = self._mean + weight * (difference - self._mean)
        self._square += weight * (float(difference @ difference) - self._square)
        # What a few differences said of the noise is also what the place was thought to be within.
        if (
            math.isfinite(self._variance)
            and self.noise_variance > noise_before > 0.0
            and self._counted == self._count
        ):
            self._variance *= self.noise_variance / noise_before

    @property
    def _counted(self) -> float:
        """Differences that count."""
        return min(self._count, 1.0 / thresholds.POSITION_LEARNS)

    @property
    def noise_variance(self) -> float:
        """Variance of the noise of a position along an axis, m^2."""
        if self._count < _FEWEST:
            # a single difference has no mean: all of it may be noise
            return self._square / (2.0 * _AXES)
        about_mean = max(self._square - float(self._mean @ self._mean), 0.0)
        variance = about_mean * self._counted / (self._counted - 1.0)  # Bessel's correction
        return variance / (2.0 * _AXES)

    @property
    def variance(self) -> float:
        """Variance of the place along an axis, m^2."""
        if not math.isfinite(self._variance):
            return self.noise_variance
        return self._variance

    @property
    def _doubt(self) -> float:
        """Squared standard deviations, of both axes, that noise exceeds with the probability
        `POSITION_DOUBT`.

        The deviation is known from a few differences: twice the quantile of an F distribution with
        two degrees of freedom, which a chi-squared one becomes with many.
        """
        freedom = _AXES * max(self._counted - 1.0, 1.0)
        return float(freedom * (thresholds.POSITION_DOUBT ** (-_AXES / freedom) - 1.0))

    def _update(self, position: Pair) -> float:
        """Correct the place; returns the share of the correction that the place before has, too."""
        noise_variance = self.noise_variance
        doubt = self._doubt
        # A sum of differences holds the noise of its ends only.
        ends_variance = 2.0 * _AXES * noise_variance / max(self._counted, 1.0) ** 2
        mean_square = float(self._mean @ self._mean)
        reckoning_variance = 0.0
        if mean_square > doubt * ends_variance / _AXES:
            reckoning_variance = mean_square / _AXES
        variance_before = self.variance
        innovation = position - self.place
        predicted = variance_before + reckoning_variance + self._drift**2
        # An innovation beyond the noise is a jump of the positions, or dead reckoning that went
        # wrong: it is followed.
        predicted = max(predicted, float(innovation @ innovation) / doubt - noise_variance)
        gain = predicted / max(predicted + noise_variance, _LEAST_VARIANCE_M2)
        self.place = self.place + gain * innovation
        self._variance = (1.0 - gain) * predicted
        return variance_before / max(predicted, _LEAST_VARIANCE_M2)
