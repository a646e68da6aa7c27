"""Noise that is smooth along a series."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Array = NDArray[np.float64]


def drift(rng: Generator, count: int, dt_s: float, correlation_s: float, deviation: float) -> Array:
    """Noise that drifts: a stationary autoregressive series of first order.

    Args:
        rng: Random numbers.
        count: Number of samples.
        dt_s: Step, s.
        correlation_s: Time after which the correlation has fallen to 1/e, s.
        deviation: Standard deviation, in the unit of the series.

    Returns:
        The series, shape (count,).
    """
    kept = np.exp(-dt_s / correlation_s)
    steps = rng.normal(size=count) * deviation * np.sqrt(1 - kept * kept)
    level = rng.normal() * deviation
    series = np.empty(count)
    for index, step in enumerate(steps):
        level = kept * level + step
        series[index] = level
    return series


def texture(rng: Generator, count: int, width: int) -> Array:
    """White noise averaged by a Hann window of `width` samples, of mean 0 and standard deviation 1,
    shape (count,)."""
    margin = 2 * width  # so that no end of the averaged noise is cut
    white = rng.normal(size=count + 2 * margin)
    averaged = np.convolve(white, np.hanning(width + 2), "same")[margin : margin + count]
    return np.asarray((averaged - averaged.mean()) / averaged.std(), dtype=np.float64)
