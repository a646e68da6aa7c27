"""Robots moved to another place on their way home: short cuts, and homes that move."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.estimation import thresholds
from homeward.estimation.drive import rolling
from homeward.estimation.filter import place_of
from homeward.estimation.kalman import propagate
from homeward.estimation.prior import CLIMB, ROLLED, ROLLING
from homeward.physics.jit import compiled, inline


@compiled
def relocate(vehicle: Any, robots: Any, hypotheses: Any, places: Any, rollings: Any, position_m: float) -> None:
    """Move robots to another place on their way home, without energy or time.

    Args:
        vehicle: `Vehicle`.
        robots: `ROBOT_DTYPE`, shape (n,).
        hypotheses: `HYPOTHESIS_DTYPE`, shape (n, hypotheses).
        places: `PLACE_DTYPE`, shape (n, places).
        rollings: Shape (n, hypotheses, places).
        position_m: Distance from home, m.
    """
    for i in range(len(robots)):
        robot = robots[i]
        if position_m > robot.position_m:
            _note_ground_as_here(vehicle, robot, places[i], position_m)
        for k in range(hypotheses.shape[1]):
            hypothesis = hypotheses[i, k]
            if position_m < robot.position_m:
                _shorten(vehicle, robot, hypothesis, places[i], rollings[i, k], position_m)
            elif position_m > robot.position_m:
                _lengthen(vehicle, robot, hypothesis, places[i], rollings[i, k], position_m)
        robot.position_m = position_m


@inline
def _shorten(vehicle: Any, robot: Any, hypothesis: Any, places: Any, rollings: Any, position_m: float) -> None:
    """Keep a part of the ground between home and here, as it was met."""
    total = 0.0
    for k in range(place_of(vehicle, position_m, places) + 1):
        total += (
            rollings[k]
            * rolling(vehicle, places[k].sine_driven)
            * max(min(vehicle.place_m, position_m - k * vehicle.place_m), 0.0)
        )
    total /= vehicle.full_j
    kept, climb_kept = min(total / max(hypothesis.rolled, 1e-12), 1.0), position_m / robot.position_m
    propagate(hypothesis.covariance, ROLLED, kept, ROLLING, 0.0)
    propagate(hypothesis.covariance, CLIMB, climb_kept, ROLLING, 0.0)
    hypothesis.mean[ROLLED] *= kept
    hypothesis.mean[CLIMB] *= climb_kept
    for a in range(3):
        hypothesis.hessian[0, a] *= kept
        hypothesis.hessian[1, a] *= kept
    hypothesis.rolled = total


@inline
def _lengthen(vehicle: Any, robot: Any, hypothesis: Any, places: Any, rollings: Any, position_m: float) -> None:
    """Add ground with the rolling resistance of that here."""
    first = place_of(vehicle, robot.position_m, places)
    rolls = rolling(vehicle, places[first].sine_driven) * (position_m - robot.position_m) / vehicle.full_j
    propagate(hypothesis.covariance, ROLLED, 1.0, ROLLING, rolls)
    hypothesis.mean[ROLLED] += rolls * hypothesis.mean[ROLLING]
    now = max(hypothesis.mean[ROLLING], thresholds.LEAST_ROLLING)
    for k in range(first, place_of(vehicle, position_m, places) + 1):
        rollings[k] = now if k > first or rollings[k] == 0.0 else rollings[k]
    hypothesis.rolled += now * rolls


@inline
def _note_ground_as_here(vehicle: Any, robot: Any, places: Any, position_m: float) -> None:
    first = place_of(vehicle, robot.position_m, places)
    here = places[first]
    for k in range(first + 1, place_of(vehicle, position_m, places) + 1):
        places[k].sine, places[k].sine_driven = here.sine, here.sine_driven
        places[k].east, places[k].north, places[k].readings = here.east, here.north, np.float64(1.0)
