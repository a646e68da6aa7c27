"""Robots moved to another place on their way home: short cuts, and homes that move."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.estimation import thresholds
from homeward.estimation.drive import rolling
from homeward.estimation.filter import place_of
from homeward.estimation.kalman import carry
from homeward.estimation.prior import CLIMB, ROLLED, ROLLING
from homeward.physics.jit import compiled, inline


@compiled
def relocate(v: Any, robots: Any, hypotheses: Any, places: Any, rollings: Any, position_m: float) -> None:
    """Move robots to another place on their way home, without energy or time.

    Args:
        v: `Vehicle`.
        robots: `ROBOT_DTYPE`, shape (n,).
        hypotheses: `HYPOTHESIS_DTYPE`, shape (n, hypotheses).
        places: `PLACE_DTYPE`, shape (n, places).
        rollings: Shape (n, hypotheses, places).
        position_m: Distance from home, m.
    """
    for i in range(len(robots)):
        robot = robots[i]
        if position_m > robot.position_m:
            _note_as_here(v, robot, places[i], position_m)
        for k in range(hypotheses.shape[1]):
            h = hypotheses[i, k]
            if position_m < robot.position_m:
                _shorten(v, robot, h, places[i], rollings[i, k], position_m)
            elif position_m > robot.position_m:
                _lengthen(v, robot, h, places[i], rollings[i, k], position_m)
        robot.position_m = position_m


@inline
def _shorten(v: Any, robot: Any, h: Any, places: Any, rollings: Any, position_m: float) -> None:
    """Keep a part of the ground between home and here, as it was met."""
    total = 0.0
    for k in range(place_of(v, position_m, places) + 1):
        total += rollings[k] * rolling(v, places[k].sine_driven) * max(min(v.place_m, position_m - k * v.place_m), 0.0)
    total /= v.full_j
    kept, climb_kept = min(total / max(h.rolled, 1e-12), 1.0), position_m / robot.position_m
    carry(h.covariance, ROLLED, kept, ROLLING, 0.0)
    carry(h.covariance, CLIMB, climb_kept, ROLLING, 0.0)
    h.mean[ROLLED] *= kept
    h.mean[CLIMB] *= climb_kept
    for a in range(3):
        h.bend[0, a] *= kept
        h.bend[1, a] *= kept
    h.rolled = total


@inline
def _lengthen(v: Any, robot: Any, h: Any, places: Any, rollings: Any, position_m: float) -> None:
    """Add ground with the rolling resistance of that here."""
    first = place_of(v, robot.position_m, places)
    rolls = rolling(v, places[first].sine_driven) * (position_m - robot.position_m) / v.full_j
    carry(h.covariance, ROLLED, 1.0, ROLLING, rolls)
    h.mean[ROLLED] += rolls * h.mean[ROLLING]
    now = max(h.mean[ROLLING], thresholds.LEAST_ROLLING)
    for k in range(first, place_of(v, position_m, places) + 1):
        rollings[k] = now if k > first or rollings[k] == 0.0 else rollings[k]
    h.rolled += now * rolls


@inline
def _note_as_here(v: Any, robot: Any, places: Any, position_m: float) -> None:
    first = place_of(v, robot.position_m, places)
    here = places[first]
    for k in range(first + 1, place_of(v, position_m, places) + 1):
        places[k].sine, places[k].sine_driven = here.sine, here.sine_driven
        places[k].east, places[k].north, places[k].readings = here.east, here.north, np.float64(1.0)
