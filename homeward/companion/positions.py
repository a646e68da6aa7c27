"""Positions filtered by dead reckoning, so that their noise does not become a longer trail.

Two numbers are learned from the differences between the change of the positions and that by speed and heading. Their
variance is twice that of a position, as noise of one reading is in two differences. Their mean is the error of dead
reckoning, as noise cancels in it.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from homeward.companion import thresholds

Pair = NDArray[np.float64]
_NONE = np.zeros(2)
_AXES = 2


class PositionFilter:
    """A Kalman filter of the position, with one variance for both axes.

    Attributes:
        place: East and north, m.
    """

    SAVED: ClassVar = (
        "place", "_variance", "_last", "_reckoned", "_reckoned_m", "_mean", "_square", "_count",
    )  # fmt: skip

    def __init__(self, place: Pair) -> None:
        self.place = place
        self._variance = math.inf
        self._last = np.full(_AXES, math.nan)
        self._reckoned, self._reckoned_m = np.zeros(_AXES), 0.0
        self._mean, self._square, self._count = np.zeros(_AXES), 0.0, 0

    def reckon(self, moved: Pair) -> None:
        """Dead reckoning: the robot moved by east and north, m."""
        self.place = self.place + moved
        self._reckoned = self._reckoned + moved
        self._reckoned_m += float(np.hypot(*moved))

    def see(self, position: Pair, reckons: bool) -> None:
        """Process a position.

        Args:
            position: As read.
            reckons: Whether dead reckoning covers the time since the last one; if not, the position is taken as it is.
        """
        if not reckons or not np.isfinite(self._last).all():
            self.place, self._variance = position.copy(), math.inf
        else:
            self._learn(position - self._last - self._reckoned)
            self._update(position)
        self._last = position.copy()
        self._reckoned, self._reckoned_m = _NONE.copy(), 0.0

    def _learn(self, difference: Pair) -> None:
        """Learn from the change of the positions less that of dead reckoning."""
        self._count += 1
        weight = max(1.0 / self._count, thresholds.POSITION_LEARNS)
        self._mean = self._mean + weight * (difference - self._mean)
        self._square += weight * (float(difference @ difference) - self._square)

    @property
    def noise_variance(self) -> float:
        """Variance of the noise of a position along an axis, m^2."""
        own = max(self._square - float(self._mean @ self._mean), 0.0)
        return own / (2.0 * _AXES)

    def _update(self, position: Pair) -> None:
        noise = self.noise_variance
        counted = min(self._count, 1.0 / thresholds.POSITION_LEARNS)
        # A sum of differences holds the noise of its ends only.
        of_ends = 2.0 * _AXES * noise / counted**2
        reckoning = max(float(self._mean @ self._mean) - of_ends, 0.0) / _AXES
        drift = reckoning + (thresholds.DEAD_RECKONING_ERROR * self._reckoned_m) ** 2
        surprise = position - self.place
        predicted = self._variance + drift if math.isfinite(self._variance) else noise
        # A surprise beyond the noise is a jump of the positions, or dead reckoning that went wrong: it is followed.
        predicted = max(predicted, float(surprise @ surprise) / thresholds.POSITION_DOUBT - noise)
        gain = predicted / max(predicted + noise, 1e-12)
        self.place = self.place + gain * surprise
        self._variance = (1.0 - gain) * predicted
