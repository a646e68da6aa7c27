"""Recordings of a robot that stands, with autocorrelated noise."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from homeward.diagnosis import Recording

Array = NDArray[np.float64]


def noise(rng: np.random.Generator, count: int, phi: float) -> Array:
    """Autoregressive noise of standard deviation 1."""
    drawn: Array = lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], rng.standard_normal(count + 1000))[
        1000:
    ]
    return drawn


def standing(
    power_w: Array, name: str = "run.csv", step_s: float = 0.5, **channels: Array
) -> Recording:
    """A recording of a robot that stands."""
    time_s = step_s * np.arange(len(power_w), dtype=np.float64)
    return Recording(
        name,
        name,
        {"time_s": time_s, "speed_mps": np.zeros(len(power_w)), "power_w": power_w, **channels},
    )
