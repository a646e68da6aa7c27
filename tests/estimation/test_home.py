"""The way home by the robot's own model, against the range equations."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from homeward.estimation.drive import modelled_driving, vehicle_of
from homeward.estimation.filter import PLACE_DTYPE
from homeward.estimation.home import home_cost, modelled_power
from homeward.physics import Robot, ancillary_power, load_robot, mission_energy
from homeward.physics.kernel import full_charge
from homeward.physics.model import drive_power, traction_force
from homeward.physics.plain import plain

ROBOT = load_robot("husky")
PLACE_M = 25.0
VEHICLE = vehicle_of(ROBOT, PLACE_M, 0.8)
SINES = np.array([0.0, 0.08, -0.3, 0.3])
"""Of the way out: the last place is a descent on the way home that the robot rolls down by
itself."""


def places() -> Any:
    of = np.zeros(len(SINES), PLACE_DTYPE)
    of["sine_driven"] = SINES
    of["sine"] = 0.7  # of readings on the way out after which nothing was driven
    return of


@pytest.mark.parametrize("position_m", [0.0, 10.0, 25.0, 60.0, 100.0, 130.0])
def test_the_way_home_is_the_sum_of_its_places_by_eq_7(position_m: float) -> None:
    """The other way round, so uphill where the way out went down; beyond the last place the ground
    is as there."""
    starts = PLACE_M * np.arange(4)
    ends = np.append(starts[1:], np.inf)
    lengths = np.clip(position_m - starts, 0.0, ends - starts)
    expected = sum(mission_energy(ROBOT, lengths, 0.8, -np.arcsin(SINES)))
    assert home_cost(VEHICLE, places(), np.zeros(4), position_m) == pytest.approx(expected)


def test_by_hand() -> None:
    """25 m level and 25 m down 0.08: 50 kg, C_rr 0.14, c 0.13, Gamma 0.953 * 0.729, 60 W at 0.8
    m/s."""
    weight_n = 50.0 * 9.80665
    level_n = 0.14 * weight_n + 0.13 * 0.64
    down_n = 0.14 * weight_n * math.sqrt(1.0 - 0.0064) - 0.08 * weight_n + 0.13 * 0.64
    expected = 25.0 * (level_n + down_n) / (0.953 * 0.729) + 60.0 * 50.0 / 0.8
    assert home_cost(VEHICLE, places(), np.zeros(4), 50.0) == pytest.approx(expected)


def test_more_than_the_model_has_is_added_but_a_descent_returns_nothing() -> None:
    level_j = home_cost(VEHICLE, places(), np.zeros(4), 20.0)
    assert home_cost(VEHICLE, places(), np.array([3.0, 9.0, 9.0, 9.0]), 20.0) == pytest.approx(
        level_j + 60.0
    )
    idle_j = VEHICLE.idle_w * 20.0 / 0.8
    assert home_cost(VEHICLE, places(), np.array([-1e6, 0.0, 0.0, 0.0]), 20.0) == pytest.approx(
        idle_j
    )


def power(
    speed_mps: float, sensing_hz: float, sine: float = 0.0, accel_mps2: float = 0.0, yaw_rate_radps: float = 0.0,
    robot: Robot = ROBOT,
) -> tuple[float, float, float]:  # fmt: skip
    record, state = plain(robot.record()), plain(full_charge(robot))
    total_w, drive_w, steady_w = modelled_power(
        VEHICLE, record, state, speed_mps, sensing_hz, accel_mps2, sine, yaw_rate_radps, 1.0, 20.0
    )
    assert state["speed_mps"][0] == speed_mps
    return float(total_w), float(drive_w), float(steady_w)


@pytest.mark.parametrize("grade_rad", [-0.3, 0.0, 0.1])
@pytest.mark.parametrize("speed_mps", [0.0, 0.5, 1.0])
def test_the_present_power_is_ancillary_and_drive(grade_rad: float, speed_mps: float) -> None:
    total_w, drive_w, steady_w = power(speed_mps, 20.0, math.sin(grade_rad))
    expected_w = float(drive_power(ROBOT, traction_force(ROBOT, speed_mps, grade_rad), speed_mps))
    assert drive_w == pytest.approx(expected_w)
    assert total_w == pytest.approx(expected_w + float(ancillary_power(ROBOT, 20.0)))
    assert steady_w == pytest.approx(
        modelled_driving(VEHICLE, math.sin(grade_rad), speed_mps) * speed_mps
    )


def test_accelerating_and_turning_are_no_part_of_steady_driving() -> None:
    """F = 1.1 m a, and the scrub of the wheels in a turn, on top of the same steady power."""
    effects = {"inertia": {"mass_factor": 1.1}, "turning": {"scrub": 0.5}}
    robot = dataclasses.replace(ROBOT, effects=effects)
    _, even_w, steady_w = power(0.5, 0.0, robot=robot)
    assert even_w == pytest.approx(steady_w)
    _, faster_w, still_w = power(0.5, 0.0, accel_mps2=0.4, robot=robot)
    assert faster_w - even_w == pytest.approx(1.1 * 50.0 * 0.4 * 0.5 / ROBOT.traction_efficiency)
    _, turning_w, also_w = power(0.5, 0.0, yaw_rate_radps=0.3, robot=robot)
    assert turning_w > even_w + 1.0
    assert steady_w == still_w == also_w
