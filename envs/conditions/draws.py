"""Random numbers determined by a key, the number of a decision and a channel, whatever was drawn
before.

Missions that are copied, or driven by another policy, therefore have the same weather and the same
noise.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.physics.jit import inline

SOC, POWER, SPEED, GRADE, GUST_EAST, GUST_NORTH, FORECAST_GRADE, FORECAST_INTEREST, GAUGE, RESET = (
    range(10)
)
"""Channels with independent numbers."""

# SplitMix64 (Steele, Lea, Flood, Fast splittable pseudorandom number generators, OOPSLA 2014).
_WEYL, _MIX_1, _MIX_2 = (
    np.uint64(0x9E3779B97F4A7C15),
    np.uint64(0xBF58476D1CE4E5B9),
    np.uint64(0x94D049BB133111EB),
)
_CHANNELS = np.uint64(16)
_BITS = tuple(np.uint64(bits) for bits in (16, 27, 30, 31, 32, 48))
_LOW, _HALF, _PER_HALF = np.uint64(0xFFFF), np.uint64(32), 2.0**-32
_MEAN, _DEVIATION = 4 * 65535 / 2, float(np.sqrt(4 * (65536**2 - 1) / 12))


@inline
def _mixed(key: Any, number: Any, channel: Any) -> Any:
    """64 random bits."""
    z = key + (np.uint64(number) * _CHANNELS + np.uint64(channel)) * _WEYL
    z = (z ^ (z >> _BITS[2])) * _MIX_1
    z = (z ^ (z >> _BITS[1])) * _MIX_2
    return z ^ (z >> _BITS[3])


@inline
def uniform(key: Any, number: Any, channel: Any) -> Any:
    """Uniform number from 0 to below 1; arguments as of `normal`."""
    return np.float64(_mixed(key, number, channel) >> _HALF) * _PER_HALF


@inline
def normal(key: Any, number: Any, channel: Any) -> Any:
    """Approximately standard normal number: a sum of four uniform ones, within +-3.46.

    Args:
        key: Key of the mission, uint64.
        number: Number of the decision or the place.
        channel: One of the channels.
    """
    z = _mixed(key, number, channel)
    total = np.float64(z & _LOW) + np.float64((z >> _BITS[0]) & _LOW)
    total += np.float64((z >> _BITS[4]) & _LOW) + np.float64(z >> _BITS[5])
    return (total - _MEAN) / _DEVIATION
