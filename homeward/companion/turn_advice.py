"""From margins to advice: the latest place to turn."""

from __future__ import annotations

import math
from collections.abc import Callable

_TRIES = 5
"""Guesses at the latest place to turn, after which it is known to some metres. Chosen: bounds the time."""


def latest(low_j: Callable[[float], float], now_j: float, most_m: float) -> float:
    """How far it may drive on before it must turn, m: a root by the secant method, never beyond a distance known as
    safe."""
    if now_j <= 0.0:
        return 0.0
    safe_m = 0.0
    safe_j = now_j
    beyond_m = math.nan
    beyond_j = math.nan
    guess_m = 0.25 * most_m
    for _ in range(_TRIES):
        value_j = low_j(guess_m)
        if value_j >= 0.0:
            safe_m = guess_m
            safe_j = value_j
            if guess_m >= most_m:
                return most_m
        else:
            beyond_m = guess_m
            beyond_j = value_j
        if math.isnan(beyond_m):
            guess_m = min(2.0 * guess_m, most_m)
        else:
            guess_m = safe_m + (beyond_m - safe_m) * safe_j / (safe_j - beyond_j)
    return min(guess_m, most_m)
