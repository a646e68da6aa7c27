"""What was predicted in a run, and what came."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward.companion import Advice

Array = NDArray[np.float64]

WINDOWS = 40
"""Readings that the estimator takes in of a recording at least. Chosen: a fifth of those of a whole charge; a
recording may be a part of one."""
LEAST_WINDOW_S = 2.0
"""Shortest time over which readings are summed up. Chosen."""


@dataclass(frozen=True)
class Watched:
    """What was predicted in a run, and what came; arrays of shape (moments,).

    Attributes:
        name: Of the recording.
        time_s: Since its start.
        left_m: Way that was then still to come.
        took_j: Energy that the rest then consumed.
        mean_j: What was predicted of it.
        low_j: Lower end of the 90 % interval.
        high_j: Upper end.
        length_m: Way of the whole run.
        rests_on: What the predictions rest on, a sentence each.
        warnings: What was warned of, with the time of the first such warning, s.
        advice: The last advice; None of motor currents.
        unit: `J`, or `A s` of motor currents: so are what it consumed and what was predicted then.
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
        """Where the truth was in the interval, shape (moments,)."""
        return np.asarray((self.low_j <= self.took_j) & (self.took_j <= self.high_j))


def rest_of(values: Array) -> Array:
    """Sum from each sample to the end, and 0 for the end, shape (n + 1,)."""
    return np.append(np.cumsum(values[::-1])[::-1], 0.0)
