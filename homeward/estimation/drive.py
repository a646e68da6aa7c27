"""Energy of driving a metre: by the robot's own model and by a hypothesis about the robot and the wind."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from homeward.physics import Robot, ancillary_power, model, optimal_speed
from homeward.physics.jit import inline


class Vehicle(NamedTuple):
    """Numbers of the robot's own model, as `homeward.physics.model` asks for them."""

    full_j: float  # usable energy of a full battery
    rolling_resistance: float
    mass_kg: float  # with its payload
    drag_ns2_per_m2: float
    per_efficiency: float
    cruise_mps: float
    idle_w: float  # ancillary power with nothing sensed
    place_m: float  # length of a place of the route


def vehicle_of(robot: Robot, place_m: float, cruise_mps: float | None = None) -> Vehicle:
    """Numbers of a robot's own model.

    Args:
        robot: As its file says.
        place_m: Length of a place of the route, m.
        cruise_mps: Speed at which its model costs the way home, m/s; that with the longest range if left out.
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
    """Energy of rolling by the file, J/m."""
    return float(model.rolling_force(v, np.sqrt(max(1.0 - sine * sine, 0.0))) * v.per_efficiency)


@inline
def climbing(v: Any, sine: float) -> float:
    """Energy of climbing by the file, J/m, negative downhill."""
    return float(model.grade_force(v, sine) * v.per_efficiency)


@inline
def drag(v: Any, speed_mps: float, headwind_mps: float) -> float:
    """Energy of air drag against the wind, J/m."""
    return float((model.drag_force(v, speed_mps) + model.wind_force(v, speed_mps, headwind_mps)) * v.per_efficiency)


@inline
def modelled_driving(v: Any, sine: float, speed_mps: float) -> float:
    """Energy of driving by the robot's own model, J/m: a place costs what it does at cruise, and the drag of another
    speed is added.

    Args:
        v: `Vehicle`.
        sine: Of the slope in the direction of travel.
        speed_mps: How fast.
    """
    at_cruise = drag(v, v.cruise_mps, 0.0)
    return max(max(rolling(v, sine) + climbing(v, sine) + at_cruise, 0.0) + drag(v, speed_mps, 0.0) - at_cruise, 0.0)
