"""Predictions and measured values of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward.companion import Advice

Array = NDArray[np.float64]

WINDOWS = 40
"""Minimum number of readings of a recording for the estimator. Chosen: a fifth of those of a whole
charge; a recording may be a part of one."""
COVERED = 0.9
"""Probability of the interval of a prediction, that which the companion shows."""
LEAST_WINDOW_S = 2.0
"""Shortest time over which readings are averaged. Chosen: above the transients of speed and
current."""


@dataclass(frozen=True)
class Watched:
    """Predictions and measured values of a run; arrays of shape (moments,).

    Attributes:
        name: Name of the recording.
        time_s: Time since its start, s.
        left_m: Way left, m.
        took_j: Energy that the rest consumed, J.
        mean_j: Predicted mean of it, J.
        low_j: Lower end of the 90 % interval, J.
        high_j: Upper end, J.
        length_m: Length of the whole run, m.
        rests_on: Readings and assumptions behind the predictions, a sentence each.
        warnings: Warnings, with the time of the first of each kind, s.
        advice: The last advice; None with motor currents.
        unit: `J`, or `A s` with motor currents, for all of the above.
    """

    name: str
    time_s: Array
    left_m: Array
    took_j: Array
    mean_j: Array
    low_j: Array
    high_j: Array
    length_m: float
    rests_on: tuple[str, ...]
    warnings: tuple[tuple[float, str], ...]
    advice: Advice | None = None
    unit: str = "J"

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Where the measured value was in the interval, shape (moments,)."""
        return np.asarray((self.low_j <= self.took_j) & (self.took_j <= self.high_j))


def rest_of(values: Array) -> Array:
    """Sum from each sample to the end, and 0 for the end, shape (n + 1,)."""
    return np.append(np.cumsum(values[::-1])[::-1], 0.0)
