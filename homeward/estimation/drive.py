"""Energy of driving a metre: by the robot's own model and by a hypothesis about the robot and the wind."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from homeward.estimation import thresholds
from homeward.estimation.prior import (
    CLIMB,
    EAST,
    GAIN,
    GUST_EAST,
    GUST_NORTH,
    NORTH,
    OFFSET,
    ROLLED,
    ROLLING,
    WEIGHT,
)
from homeward.physics import Robot, ancillary_power, model, optimal_speed
from homeward.physics.jit import inline

_DRIVING = CLIMB + 1  # the states that determine the energy of driving come first


class Vehicle(NamedTuple):
    """Parameters of the robot's own model, named as `homeward.physics.model` expects them."""

    full_j: float  # usable energy of a full battery
    rolling_resistance: float
    mass_kg: float  # with its payload
    drag_ns2_per_m2: float
    per_efficiency: float
    cruise_mps: float
    idle_w: float  # ancillary power without sensing
    place_m: float  # length of a place of the route


def vehicle_of(robot: Robot, place_m: float, cruise_mps: float | None = None) -> Vehicle:
    """Parameters of a robot's own model.

    Args:
        robot: The robot of the file.
        place_m: Length of a place of the route, m.
        cruise_mps: Speed at which the way home is predicted, m/s; by default that with the longest range.
    """
    payload_kg = float(robot.record()[0]["payload_mass_kg"])
    return Vehicle(
        full_j=robot.usable_energy_j,
        rolling_resistance=robot.rolling_resistance,
        mass_kg=robot.mass_kg + payload_kg,
        drag_ns2_per_m2=robot.drag_ns2_per_m2,
        per_efficiency=1.0 / robot.traction_efficiency,
        cruise_mps=float(optimal_speed(robot)) if cruise_mps is None else cruise_mps,
        idle_w=float(ancillary_power(robot, 0.0)),
        place_m=place_m,
    )


@inline
def rolling(v: Any, sine: float) -> float:
    """Energy of rolling by the robot's file, J/m."""
    return float(model.rolling_force(v, np.sqrt(max(1.0 - sine * sine, 0.0))) * v.per_efficiency)


@inline
def climbing(v: Any, sine: float) -> float:
    """Energy of climbing by the robot's file, J/m, negative downhill."""
    return float(model.grade_force(v, sine) * v.per_efficiency)


@inline
def drag(v: Any, speed_mps: float, headwind_mps: float) -> float:
    """Energy of air drag against the wind, J/m."""
    return float((model.drag_force(v, speed_mps) + model.wind_force(v, speed_mps, headwind_mps)) * v.per_efficiency)


@inline
def modelled_driving(v: Any, sine: float, speed_mps: float) -> float:
    """Energy of driving by the robot's own model, J/m: that of the place at cruise, with the drag of the actual speed.

    Args:
        v: `Vehicle`.
        sine: Sine of the slope in the direction of travel.
        speed_mps: Speed, m/s.
    """
    at_cruise = drag(v, v.cruise_mps, 0.0)
    return max(max(rolling(v, sine) + climbing(v, sine) + at_cruise, 0.0) + drag(v, speed_mps, 0.0) - at_cruise, 0.0)


class Stretch(NamedTuple):
    """A stretch of a way over uniform ground."""

    way_m: float
    sine: float  # of the slope, in the direction of travel, as the next two
    east: float
    north: float
    speed_mps: float
    rolled: float  # rolling energy there over the file's, relative to `ROLLED`; below 0: it is `ROLLING`
    climb_share: float  # of the way from here home
    stays: float  # share of the present gusts that remains there


@inline
def predict(v: Any, prior: Any, x: Any, p: Any, s: Any, slope: Any, bend: Any, part: Any) -> tuple[float, float]:
    """Energy of driving a stretch by a hypothesis, over the file's usable energy, and its variance beyond the states'.

    It is normally distributed by the states, but never below 0. If it may be both, mean and slopes are those of the
    normal distribution truncated there.

    Args:
        v: `Vehicle`.
        prior: `Prior`.
        x: Mean of the states, shape (STATES,).
        p: Their covariance.
        s: `Stretch`.
        slope: Incremented by the derivative of the energy by each state, shape (STATES,).
        bend: Incremented by the second derivatives by the wind: east, both, north.
        part: Work space, shape (STATES,).
    """
    full = s.way_m / v.full_j
    roll, climb = rolling(v, s.sine) * full, climbing(v, s.sine) * full
    east_mps, north_mps = x[EAST] + s.stays * x[GUST_EAST], x[NORTH] + s.stays * x[GUST_NORTH]
    headwind_mps = model.headwind(east_mps, north_mps, s.east, s.north)
    air_mps = s.speed_mps + headwind_mps
    part[OFFSET] = 0.0
    part[GAIN], part[WEIGHT] = drag(v, s.speed_mps, headwind_mps) * full, climb
    second = 2.0 * x[GAIN] * v.drag_ns2_per_m2 * v.per_efficiency * full * np.sign(air_mps)
    part[EAST], part[NORTH] = second * air_mps * s.east, second * air_mps * s.north
    part[GUST_EAST], part[GUST_NORTH] = s.stays * part[EAST], s.stays * part[NORTH]
    energy = x[WEIGHT] * climb + x[GAIN] * part[GAIN]
    if s.rolled < 0.0:
        part[ROLLING], part[ROLLED], part[CLIMB] = roll, 0.0, 0.0
    else:
        part[ROLLING], part[ROLLED], part[CLIMB] = 0.0, s.rolled * roll, -misread_climb(prior, x) * s.climb_share
    energy += part[ROLLING] * x[ROLLING] + part[ROLLED] * x[ROLLED] + part[CLIMB] * x[CLIMB]
    share, residual_variance = 1.0, 0.0
    if energy < thresholds.SURELY_CONSUMES * roll:
        variance = 0.0
        for a in range(_DRIVING):
            half = 0.5 * part[a] * p[a, a]
            for b in range(a):
                half += part[b] * p[a, b]
            variance += 2.0 * part[a] * half
        sd = math.sqrt(max(variance, 1e-24))
        z = energy / sd
        share = 0.5 * math.erfc(-z / math.sqrt(2.0))
        density = sd * math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
        mean = energy * share + density
        residual_variance = max(energy * mean + variance * share - mean * mean - share * share * variance, 0.0)
        energy = mean
    for a in range(_DRIVING):
        slope[a] += share * part[a]
    bend[0] += share * second * s.east * s.east
    bend[1] += share * second * s.east * s.north
    bend[2] += share * second * s.north * s.north
    return energy, residual_variance


@inline
def misread_climb(prior: Any, x: Any) -> float:
    """Derivative of the energy by a climb that the slopes did not show; smaller if the modelled energy includes it."""
    return float(x[WEIGHT] - prior.model_knows_slopes * x[GAIN])
