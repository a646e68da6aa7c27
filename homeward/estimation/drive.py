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
def rolling(vehicle: Any, sine: float) -> float:
    """Energy of rolling by the robot's file, J/m."""
    return float(model.rolling_force(vehicle, np.sqrt(max(1.0 - sine * sine, 0.0))) * vehicle.per_efficiency)


@inline
def climbing(vehicle: Any, sine: float) -> float:
    """Energy of climbing by the robot's file, J/m, negative downhill."""
    return float(model.grade_force(vehicle, sine) * vehicle.per_efficiency)


@inline
def drag(vehicle: Any, speed_mps: float, headwind_mps: float) -> float:
    """Energy of air drag against the wind, J/m."""
    return float(
        (model.drag_force(vehicle, speed_mps) + model.wind_force(vehicle, speed_mps, headwind_mps))
        * vehicle.per_efficiency
    )


@inline
def modelled_driving(vehicle: Any, sine: float, speed_mps: float) -> float:
    """Energy of driving by the robot's own model, J/m: that of the place at cruise, with the drag of the actual speed.

    Args:
        vehicle: `Vehicle`.
        sine: Sine of the slope in the direction of travel.
        speed_mps: Speed, m/s.
    """
    at_cruise = drag(vehicle, vehicle.cruise_mps, 0.0)
    return max(
        max(rolling(vehicle, sine) + climbing(vehicle, sine) + at_cruise, 0.0)
        + drag(vehicle, speed_mps, 0.0)
        - at_cruise,
        0.0,
    )


class Stretch(NamedTuple):
    """A stretch of a way over uniform ground."""

    way_m: float
    sine: float  # of the slope, in the direction of travel, as the next two
    east: float
    north: float
    speed_mps: float
    rolled: float  # rolling energy there over the file's, relative to `ROLLED`; below 0: it is `ROLLING`
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
    """Energy of driving a stretch by a hypothesis, over the file's usable energy, and its variance beyond the states'.

    It is normally distributed by the states, but never below 0. If it may be both, mean and slopes are those of the
    normal distribution truncated there.

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
    full = stretch.way_m / vehicle.full_j
    roll, climb = rolling(vehicle, stretch.sine) * full, climbing(vehicle, stretch.sine) * full
    east_mps, north_mps = (
        mean[EAST] + stretch.gust_share * mean[GUST_EAST],
        mean[NORTH] + stretch.gust_share * mean[GUST_NORTH],
    )
    headwind_mps = model.headwind(east_mps, north_mps, stretch.east, stretch.north)
    air_mps = stretch.speed_mps + headwind_mps
    stretch_jacobian[OFFSET] = 0.0
    stretch_jacobian[GAIN], stretch_jacobian[WEIGHT] = drag(vehicle, stretch.speed_mps, headwind_mps) * full, climb
    air_hessian = 2.0 * mean[GAIN] * vehicle.drag_ns2_per_m2 * vehicle.per_efficiency * full * np.sign(air_mps)
    stretch_jacobian[EAST], stretch_jacobian[NORTH] = (
        air_hessian * air_mps * stretch.east,
        air_hessian * air_mps * stretch.north,
    )
    stretch_jacobian[GUST_EAST], stretch_jacobian[GUST_NORTH] = (
        stretch.gust_share * stretch_jacobian[EAST],
        stretch.gust_share * stretch_jacobian[NORTH],
    )
    energy = mean[WEIGHT] * climb + mean[GAIN] * stretch_jacobian[GAIN]
    if stretch.rolled < 0.0:
        stretch_jacobian[ROLLING], stretch_jacobian[ROLLED], stretch_jacobian[CLIMB] = roll, 0.0, 0.0
    else:
        stretch_jacobian[ROLLING], stretch_jacobian[ROLLED], stretch_jacobian[CLIMB] = (
            0.0,
            stretch.rolled * roll,
            -misread_climb(prior, mean) * stretch.climb_share,
        )
    energy += (
        stretch_jacobian[ROLLING] * mean[ROLLING]
        + stretch_jacobian[ROLLED] * mean[ROLLED]
        + stretch_jacobian[CLIMB] * mean[CLIMB]
    )
    share, residual_variance = 1.0, 0.0
    if energy < thresholds.SURELY_CONSUMES * roll:
        variance = 0.0
        for a in range(_DRIVING):
            half = 0.5 * stretch_jacobian[a] * covariance[a, a]
            for b in range(a):
                half += stretch_jacobian[b] * covariance[a, b]
            variance += 2.0 * stretch_jacobian[a] * half
        sd = math.sqrt(max(variance, 1e-24))
        z = energy / sd
        share = 0.5 * math.erfc(-z / math.sqrt(2.0))
        density = sd * math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
        mean = energy * share + density
        residual_variance = max(energy * mean + variance * share - mean * mean - share * share * variance, 0.0)
        energy = mean
    for a in range(_DRIVING):
        jacobian[a] += share * stretch_jacobian[a]
    hessian[0] += share * air_hessian * stretch.east * stretch.east
    hessian[1] += share * air_hessian * stretch.east * stretch.north
    hessian[2] += share * air_hessian * stretch.north * stretch.north
    return energy, residual_variance


@inline
def misread_climb(prior: Any, mean: Any) -> float:
    """Derivative of the energy by a climb that the slopes did not show; smaller if the modelled energy includes it."""
    return float(mean[WEIGHT] - prior.model_knows_slopes * mean[GAIN])
