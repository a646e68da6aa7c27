"""The robot's own model on its way: its present power, and the energy of the driven ground on the
way home."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.estimation.drive import modelled_driving
from homeward.estimation.filter import place_of
from homeward.physics.jit import compiled
from homeward.physics.kernel import Conditions, demand


def modelled_power(
    vehicle: Any,
    robots: Any,
    states: Any,
    speed_mps: float,
    sensing_hz: float,
    accel_mps2: float,
    sine: float,
    yaw_rate_radps: float,
    ahead: float,
    temperature_c: float,
) -> tuple[float, float, float]:
    """Power by the robot's own model, that of its drive, and the part of that for rolling, climbing
    and drag alone, W.

    It is for still air.

    Args:
        vehicle: `Vehicle`.
        robots: `ROBOT_DTYPE`, shape (1,), as `homeward.physics.plain` makes them, like the next
            ones.
        states: `ROBOT_STATE_DTYPE`, shape (1,); written.
        speed_mps: Speed, m/s.
        sensing_hz: Sensing rate, Hz.
        accel_mps2: Acceleration along the direction of travel, m/s^2.
        sine: Sine of the slope in the direction of travel.
        yaw_rate_radps: Turning rate, rad/s.
        ahead: 1 on the way out, -1 on the way home.
        temperature_c: Of the air, C.
    """
    robot = robots[0]
    state = states[0]
    conditions = Conditions(
        speed_mps=speed_mps,
        sensing_hz=sensing_hz,
        accel_mps2=accel_mps2,
        sin_grade=sine,
        cos_grade=np.sqrt(max(1.0 - sine * sine, 0.0)),
        yaw_rate_radps=yaw_rate_radps,
        roughness=robot.surface_usual,
        headwind_mps=0.0,
        temperature_c=temperature_c,
        base_distance_m=0.0,
        direction=ahead,
    )
    power_w = demand(robot, state, conditions)
    steady_w = modelled_driving(vehicle, sine, speed_mps) * speed_mps
    state.speed_mps = speed_mps
    return power_w, state.drive_w, steady_w


@compiled
def home_cost(vehicle: Any, places: Any, extra_j_per_m: Any, position_m: float) -> float:
    """Energy home over the ground driven, at cruise and without sensing, by the robot's own model,
    J.

    Args:
        vehicle: `Vehicle`.
        places: `PLACE_DTYPE`, shape (places,).
        extra_j_per_m: Consumption there beyond rolling, climbing and drag by the model: turning,
            accelerating, J/m, shape (places,). It is assumed on the way home, too.
        position_m: Distance from home, m.
    """
    total_j = vehicle.idle_w / vehicle.cruise_mps * position_m
    place_here = place_of(vehicle, position_m, places)
    for k in range(place_here + 1):
        start_m = k * vehicle.place_m
        end_m = (k + 1) * vehicle.place_m
        if k == place_here:
            end_m = position_m
        driving_j_per_m = modelled_driving(vehicle, -places[k].sine_driven, vehicle.cruise_mps)
        total_j += max(driving_j_per_m + extra_j_per_m[k], 0.0) * (end_m - start_m)
    return float(total_j)
