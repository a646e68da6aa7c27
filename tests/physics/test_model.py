"""The equations one by one: numbers by hand, laws of scale, broadcasting, and the optimal speed by
search."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward import Robot
from homeward.physics import (
    ancillary_power,
    d_max,
    ideal_range,
    manoeuvring_energy,
    mission_energy,
    optimal_speed,
    traction_force,
    usable_energy,
)
from homeward.physics.model import GRAVITY_MPS2, drive_power, rolling_force, traction_efficiency
from tests.physics.drives import PLAIN, robots, with_effect

# PLAIN: 10 kg, C_rr 0.1, c 0.5, Gamma 0.5, 1e5 J; s0 0.5 W, s1 0.01 J, radio 0.25 W, controller
# 0.75 W, computer 2 W + 0.02 J a sample.
G = 9.80665
SIN_3, COS_4 = 0.6, 0.8
GRADE_RAD = math.atan2(3.0, 4.0)


def test_eq_1_rolling_friction() -> None:
    assert rolling_force(PLAIN) == pytest.approx(0.1 * 10.0 * G)


def test_eq_2_ideal_range() -> None:
    assert ideal_range(PLAIN) == pytest.approx(1e5 / 9.80665)


def test_eq_3_traction() -> None:
    assert traction_force(PLAIN, 3.0, GRADE_RAD) == pytest.approx(
        1.0 * G * COS_4 + 0.5 * 9.0 + 10.0 * G * SIN_3
    )
    assert traction_force(PLAIN, 3.0, -GRADE_RAD) == pytest.approx(
        1.0 * G * COS_4 + 0.5 * 9.0 - 10.0 * G * SIN_3
    )


def test_eq_5_ancillary_power() -> None:
    assert ancillary_power(PLAIN, 0.0) == pytest.approx(1.5)
    assert ancillary_power(PLAIN, 50.0) == pytest.approx(1.5 + 0.5 + 3.0)


def test_eq_6_usable_energy() -> None:
    worn = dataclasses.replace(PLAIN, cycle_fade=0.01, age_fade=0.1, cycles=20.0, age=3.0)
    assert (
        usable_energy(worn, 20.0, 3.0)
        == worn.usable_energy_j
        == pytest.approx(1e5 * math.exp(-0.5))
    )
    assert usable_energy(worn, 0.0, 0.0) == 1e5


def test_efficiencies() -> None:
    lossy = dataclasses.replace(PLAIN, storage_loss=0.1, friction_loss=0.2, ancillary_loss=0.3)
    assert lossy.traction_efficiency == traction_efficiency(lossy) == pytest.approx(0.5 * 0.8)
    assert lossy.overall_efficiency == pytest.approx(0.9 * 0.5 * 0.8 * 0.7)


def test_drive_power() -> None:
    assert drive_power(PLAIN, 12.0, 2.0) == pytest.approx(48.0)
    assert drive_power(PLAIN, -12.0, 2.0) == 0.0


@given(robot=robots(with_effects=False), grade=st.floats(-1.2, 1.2))
def test_there_and_back_costs_at_least_the_rolling_resistance(robot: Robot, grade: float) -> None:
    there_n = traction_force(robot, robot.max_speed_mps, grade)
    back_n = traction_force(robot, robot.max_speed_mps, -grade)
    rolling_n = 2.0 * robot.rolling_resistance * robot.mass_kg * GRAVITY_MPS2 * math.cos(grade)
    paid_n = (
        drive_power(robot, there_n, 1.0) + drive_power(robot, back_n, 1.0)
    ) * robot.traction_efficiency
    assert paid_n >= rolling_n * (1.0 - 1e-9)


SPEED, GRADE = np.array([0.5, 1.0, 2.0]), np.array([[-0.3], [0.0], [0.2], [0.4]])
DUTY, HZ = np.array([0.3, 0.6, 1.0]), np.array([[0.0], [10.0], [50.0], [100.0]])
BROADCAST: list[Callable[..., Any]] = [
    lambda v, th, d, f: traction_force(PLAIN, v, th),
    lambda v, th, d, f: ancillary_power(PLAIN, f) + manoeuvring_energy(v, d),
    lambda v, th, d, f: usable_energy(PLAIN, v, f),
    lambda v, th, d, f: drive_power(PLAIN, traction_force(PLAIN, v, th), np.asarray(v)),
    lambda v, th, d, f: mission_energy(PLAIN, 2.0, v, th, d, f),
    lambda v, th, d, f: optimal_speed(PLAIN, th, d, f),
    lambda v, th, d, f: d_max(PLAIN, v, th, d, f),
    lambda v, th, d, f: d_max(PLAIN, None, th, d, f, energy_j=v),
    lambda v, th, d, f: d_max(with_effect(PLAIN, "standby", power_w=2.0), v, th, d, f),
    lambda v, th, d, f: optimal_speed(with_effect(PLAIN, "no_load", power_w=1.0), th, d, f),
]


@pytest.mark.parametrize("function", BROADCAST)
def test_functions_take_floats_and_arrays_that_broadcast(function: Callable[..., Any]) -> None:
    table = function(SPEED, GRADE, DUTY, HZ)
    assert table.shape == (4, 3)
    for i, j in np.ndindex(4, 3):
        one = function(float(SPEED[j]), float(GRADE[i, 0]), float(DUTY[j]), float(HZ[i, 0]))
        assert np.ndim(one) == 0
        assert float(one) == pytest.approx(float(table[i, j]), rel=1e-12)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (
            lambda: ancillary_power(PLAIN, -5),
            "sensing_hz = -5.0 is not allowed; allowed: a number in [0, inf)",
        ),
        (lambda: ancillary_power(PLAIN, [1.0, math.nan]), "sensing_hz = nan is not allowed"),
        (
            lambda: usable_energy(PLAIN, -1, 0),
            "cycles = -1.0 is not allowed; allowed: a number in [0, inf)",
        ),
        (
            lambda: usable_energy(PLAIN, 0, -1),
            "age = -1.0 is not allowed; allowed: a number in [0, inf)",
        ),
        (
            lambda: traction_force(PLAIN, -1.0, 0.0),
            "speed_mps = -1.0 is not allowed; allowed: a number in [0, inf)",
        ),
        (
            lambda: traction_force(PLAIN, 1.0, 10.0),
            "grade_rad = 10.0 is not allowed; allowed: a number in [-1.5",
        ),
        (
            lambda: manoeuvring_energy(math.inf, 1.0),
            "force_n = inf is not allowed; allowed: a number in (-inf, inf)",
        ),
        (
            lambda: manoeuvring_energy(1.0, -1.0),
            "distance_m = -1.0 is not allowed; allowed: a number in [0, inf)",
        ),
        (
            lambda: d_max(PLAIN, "fast"),
            "speed_mps = 'fast' is not a number or an array of numbers; allowed: (0, inf)",
        ),
        (
            lambda: d_max(PLAIN, {}),
            "speed_mps = {} is not a number or an array of numbers; allowed: (0, inf)",
        ),
        (
            lambda: d_max(PLAIN, [[1.0], [1.0, 2.0]]),
            "speed_mps = [[1.0], [1.0, 2.0]] is not a number or an array",
        ),
    ],
)
def test_values_that_no_equation_knows_are_refused_in_one_line(
    function: Callable[[], Any], message: str
) -> None:
    with pytest.raises(ValueError) as caught:
        function()
    assert str(caught.value).startswith(message) and "\n" not in str(caught.value)


@pytest.mark.parametrize("function", BROADCAST)
def test_lists_are_arrays(function: Callable[..., Any]) -> None:
    nested = function(*(values.tolist() for values in (SPEED, GRADE, DUTY, HZ)))
    np.testing.assert_array_equal(nested, function(SPEED, GRADE, DUTY, HZ))
