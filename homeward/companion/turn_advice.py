"""From margins to advice: the latest place to turn, and whether it is here."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

_TRIES = 5
"""Guesses at the latest place to turn, after which it is known to some metres. Chosen: bounds the
time."""


class Turn(NamedTuple):
    """When the robot must turn.

    Attributes:
        in_m: Way that it may still drive away from home, m.
        in_s: Time until then, s: at its pace, or sooner, if what it draws standing uses the margin
            up.
        is_due: Whether it must turn now, so that it has turned in time.
    """

    in_m: float
    in_s: float
    is_due: bool


def when_to_turn(
    low_j: Callable[[float], float],
    now_j: float,
    most_m: float,
    pace_mps: float,
    draws_w: float,
    reaction_s: float,
) -> Turn:
    """When to turn for the margin at the accepted risk not to fall below zero.

    Args:
        low_j: That margin, J, after a way onwards, m.
        now_j: The same here.
        most_m: Longest way onwards that is looked at, m.
        pace_mps: Speed onwards, with its stops.
        draws_w: Power that it draws at least, driving or standing, above zero.
        reaction_s: Time from the advice until it has turned.
    """
    in_m = latest(low_j, now_j, most_m)
    in_s = min(in_m / max(pace_mps, 1e-9), max(now_j, 0.0) / draws_w)
    is_due = in_m <= reaction_s * pace_mps or in_s <= reaction_s
    return Turn(in_m, in_s, is_due)


def latest(low_j: Callable[[float], float], now_j: float, most_m: float) -> float:
    """How far it may drive on before it must turn, m: a root by the secant method, never beyond a
    distance known as safe."""
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
