"""Robots moved to another place on their way home: short cuts, and homes that move."""

from __future__ import annotations

from typing import Any

from homeward.estimation import thresholds
from homeward.estimation.drive import LEAST_ROLLED, rolling
from homeward.estimation.filter import place_of, rolled_from_home
from homeward.estimation.kalman import propagate
from homeward.estimation.prior import CLIMB, ROLLED, ROLLING
from homeward.physics.jit import compiled, inline


@compiled
def relocate(
    vehicle: Any, robots: Any, hypotheses: Any, places: Any, rollings: Any, position_m: float
) -> None:
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
def _shorten(
    vehicle: Any, robot: Any, hypothesis: Any, places: Any, rollings: Any, position_m: float
) -> None:
    """Keep a part of the ground between home and here, as it was met."""
    rolled = rolled_from_home(vehicle, position_m, places, rollings)
    rolled_kept = min(rolled / max(hypothesis.rolled, LEAST_ROLLED), 1.0)
    climb_kept = position_m / robot.position_m
    propagate(hypothesis.covariance, ROLLED, rolled_kept, ROLLING, 0.0)
    propagate(hypothesis.covariance, CLIMB, climb_kept, ROLLING, 0.0)
    hypothesis.mean[ROLLED] *= rolled_kept
    hypothesis.mean[CLIMB] *= climb_kept
    for a in range(3):
        hypothesis.hessian[0, a] *= rolled_kept
        hypothesis.hessian[1, a] *= rolled_kept
    hypothesis.rolled = rolled


@inline
def _lengthen(
    vehicle: Any, robot: Any, hypothesis: Any, places: Any, rollings: Any, position_m: float
) -> None:
    """Add ground with the rolling resistance of that here."""
    place_here = place_of(vehicle, robot.position_m, places)
    rolls = (
        rolling(vehicle, places[place_here].sine_driven)
        * (position_m - robot.position_m)
        / vehicle.full_j
    )
    propagate(hypothesis.covariance, ROLLED, 1.0, ROLLING, rolls)
    hypothesis.mean[ROLLED] += rolls * hypothesis.mean[ROLLING]
    rolling_here = max(hypothesis.mean[ROLLING], thresholds.LEAST_ROLLING)
    if rollings[place_here] == 0.0:  # nothing was driven in it
        rollings[place_here] = rolling_here
    for k in range(place_here + 1, place_of(vehicle, position_m, places) + 1):
        rollings[k] = rolling_here
    hypothesis.rolled += rolling_here * rolls


@inline
def _note_ground_as_here(vehicle: Any, robot: Any, places: Any, position_m: float) -> None:
    """Store slope and direction of the place here for those up to another position."""
    place_here = place_of(vehicle, robot.position_m, places)
    ground_here = places[place_here]
    for k in range(place_here + 1, place_of(vehicle, position_m, places) + 1):
        place = places[k]
        place.sine = ground_here.sine
        place.sine_driven = ground_here.sine_driven
        place.east = ground_here.east
        place.north = ground_here.north
        place.readings = 1.0
