"""Energy of driving a metre: by the robot's own model and by a hypothesis about the robot and the
wind."""

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
LEAST_ROLLED = 1e-12
"""Least rolling between home and here, of a battery. Chosen: above 0, because it divides."""
LEAST_WAY_M = 1e-9
"""Least way, m. Chosen: above 0, because it divides."""
_LEAST_VARIANCE = 1e-24
"""Least variance of a stretch's energy, of a battery squared. Chosen: above 0, because its root
divides."""


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
        cruise_mps: Speed at which the way home is predicted, m/s; by default that with the longest
            range.
    """
    if cruise_mps is None:
        cruise_mps = float(optimal_speed(robot))
    payload_kg = float(robot.record()[0]["payload_mass_kg"])
    return Vehicle(
        full_j=robot.usable_energy_j,
        rolling_resistance=robot.rolling_resistance,
        mass_kg=robot.mass_kg + payload_kg,
        drag_ns2_per_m2=robot.drag_ns2_per_m2,
        per_efficiency=1.0 / robot.traction_efficiency,
        cruise_mps=cruise_mps,
        idle_w=float(ancillary_power(robot, 0.0)),
        place_m=place_m,
    )


@inline
def rolling(vehicle: Any, sine: float) -> float:
    """Energy of rolling by the robot's file, J/m."""
    cosine = np.sqrt(max(1.0 - sine * sine, 0.0))
    return float(model.rolling_force(vehicle, cosine) * vehicle.per_efficiency)


@inline
def climbing(vehicle: Any, sine: float) -> float:
    """Energy of climbing by the robot's file, J/m, negative downhill."""
    return float(model.grade_force(vehicle, sine) * vehicle.per_efficiency)


@inline
def drag(vehicle: Any, speed_mps: float, headwind_mps: float) -> float:
    """Energy of air drag against the wind, J/m."""
    drag_n = model.drag_force(vehicle, speed_mps) + model.wind_force(
        vehicle, speed_mps, headwind_mps
    )
    return float(drag_n * vehicle.per_efficiency)


@inline
def modelled_driving(vehicle: Any, sine: float, speed_mps: float) -> float:
    """Energy of driving by the robot's own model, J/m: that of the place at cruise, with the drag
    of the actual speed.

    Args:
        vehicle: `Vehicle`.
        sine: Sine of the slope in the direction of travel.
        speed_mps: Speed, m/s.
    """
    drag_at_cruise = drag(vehicle, vehicle.cruise_mps, 0.0)
    at_cruise = max(rolling(vehicle, sine) + climbing(vehicle, sine) + drag_at_cruise, 0.0)
    return max(at_cruise + drag(vehicle, speed_mps, 0.0) - drag_at_cruise, 0.0)


class Stretch(NamedTuple):
    """A stretch of a way over uniform ground."""

    way_m: float
    sine: float  # of the slope, in the direction of travel, as the next two
    east: float
    north: float
    speed_mps: float
    # rolling energy there over the file's, relative to `ROLLED`; below 0: it is `ROLLING`
    rolled: float
    climb_share: float  # of the way from here home
    gust_share: float  # share of the present gusts that remains there


@inline
def predict(
    vehicle: Any,
    prior: Any,
    mean: Any,
    covariance: Any,
    stretch: Any,
    jacobian: Any,
    hessian: Any,
    stretch_jacobian: Any,
) -> tuple[float, float]:
    """Energy of driving a stretch by a hypothesis, over the file's usable energy, and its variance
    beyond the states'.

    With the wind w = mean wind + `gust_share` gust, the speed of the air u = v + w h along the
    direction h, and the file's rolling R, climbing C and drag c u |u| of the stretch
    (docs/estimation.md, the estimation problem):

        E = gain c u |u| + weight C + rolling R                        on new ground
        E = gain c u |u| + weight C + rolled r R - climb s m           on ground that was driven on
        the way out

    where r is `stretch.rolled`, s is `stretch.climb_share` and m is `misread_climb`.

    E is linear in all states but the wind, for which the first and second derivatives are returned.
    It is normally distributed by the states, but never below 0: see `_censored`.

    Args:
        vehicle: `Vehicle`.
        prior: `Prior`.
        mean: Mean of the states, shape (STATES,).
        covariance: Their covariance.
        stretch: `Stretch`.
        jacobian: Incremented by the derivative of the energy by each state, shape (STATES,).
        hessian: Incremented by the second derivatives by the wind: east, both, north.
        stretch_jacobian: Work space, shape (STATES,).
    """
    shares_per_j_per_m = stretch.way_m / vehicle.full_j
    roll = rolling(vehicle, stretch.sine) * shares_per_j_per_m
    climb = climbing(vehicle, stretch.sine) * shares_per_j_per_m
    east_mps = mean[EAST] + stretch.gust_share * mean[GUST_EAST]
    north_mps = mean[NORTH] + stretch.gust_share * mean[GUST_NORTH]
    headwind_mps = model.headwind(east_mps, north_mps, stretch.east, stretch.north)
    air_mps = stretch.speed_mps + headwind_mps
    air_drag = drag(vehicle, stretch.speed_mps, headwind_mps) * shares_per_j_per_m
    # Second derivative of the drag by the wind along the way: c u |u| has 2 c sign(u), and u times
    # that as its first.
    air_curvature = (
        2.0
        * mean[GAIN]
        * vehicle.drag_ns2_per_m2
        * vehicle.per_efficiency
        * shares_per_j_per_m
        * np.sign(air_mps)
    )

    stretch_jacobian[OFFSET] = 0.0
    stretch_jacobian[GAIN] = air_drag
    stretch_jacobian[WEIGHT] = climb
    stretch_jacobian[EAST] = air_curvature * air_mps * stretch.east
    stretch_jacobian[NORTH] = air_curvature * air_mps * stretch.north
    stretch_jacobian[GUST_EAST] = stretch.gust_share * stretch_jacobian[EAST]
    stretch_jacobian[GUST_NORTH] = stretch.gust_share * stretch_jacobian[NORTH]
    if stretch.rolled < 0.0:  # new ground rolls as the ground here
        stretch_jacobian[ROLLING] = roll
        stretch_jacobian[ROLLED] = 0.0
        stretch_jacobian[CLIMB] = 0.0
    else:
        stretch_jacobian[ROLLING] = 0.0
        stretch_jacobian[ROLLED] = stretch.rolled * roll
        stretch_jacobian[CLIMB] = -misread_climb(prior, mean) * stretch.climb_share

    energy = mean[WEIGHT] * climb + mean[GAIN] * air_drag
    energy += (
        stretch_jacobian[ROLLING] * mean[ROLLING]
        + stretch_jacobian[ROLLED] * mean[ROLLED]
        + stretch_jacobian[CLIMB] * mean[CLIMB]
    )
    positive_chance = 1.0
    residual_variance = 0.0
    if energy < thresholds.SURELY_CONSUMES * roll:
        variance = _energy_variance(covariance, stretch_jacobian)
        energy, positive_chance, residual_variance = _censored(energy, variance)
    for a in range(_DRIVING):
        jacobian[a] += positive_chance * stretch_jacobian[a]
    hessian[0] += positive_chance * air_curvature * stretch.east * stretch.east
    hessian[1] += positive_chance * air_curvature * stretch.east * stretch.north
    hessian[2] += positive_chance * air_curvature * stretch.north * stretch.north
    return energy, residual_variance


@inline
def _energy_variance(covariance: Any, jacobian: Any) -> float:
    """Variance of an energy that is linear in the states of driving, J P J^T; each pair of states
    is visited once."""
    variance = 0.0
    for a in range(_DRIVING):
        half = 0.5 * jacobian[a] * covariance[a, a]
        for b in range(a):
            half += jacobian[b] * covariance[a, b]
        variance += 2.0 * jacobian[a] * half
    return variance


@inline
def _censored(mean: float, variance: float) -> tuple[float, float, float]:
    """Moments of max(E, 0) for a normally distributed E (Tobin, Econometrica 26, 1958: censored at
    0).

    With z = mean / sd, the distribution function F and the density f of a standard normal variable:

        mean      mean F(z) + sd f(z)
        slope     F(z), the derivative of that by the mean of E, and the probability that E is above
        0 residual  variance of max(E, 0), less the F(z)^2 variance that the slope explains

    Returns:
        Mean, slope and residual variance.
    """
    sd = math.sqrt(max(variance, _LEAST_VARIANCE))
    z = mean / sd
    positive_chance = 0.5 * math.erfc(-z / math.sqrt(2.0))
    sd_density = sd * math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    censored_mean = mean * positive_chance + sd_density
    second_moment = mean * censored_mean + variance * positive_chance
    explained = positive_chance * positive_chance * variance
    residual_variance = max(second_moment - censored_mean * censored_mean - explained, 0.0)
    return censored_mean, positive_chance, residual_variance


@inline
def misread_climb(prior: Any, mean: Any) -> float:
    """Derivative of the energy by a climb that the slopes did not show; smaller if the modelled
    energy includes it."""
    return float(mean[WEIGHT] - prior.model_knows_slopes * mean[GAIN])
