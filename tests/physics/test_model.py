"""The equations one by one: numbers by hand, laws of scale, broadcasting, and the optimal speed by search."""

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
from tests.physics.drives import PLAIN, quantities, robots, with_effect

# PLAIN: 10 kg, C_rr 0.1, c 0.5, Gamma 0.5, 1e5 J; s0 0.5 W, s1 0.01 J, radio 0.25 W, controller 0.75 W,
# computer 2 W + 0.02 J a sample.
G = 9.80665
SIN_3, COS_4 = 0.6, 0.8
GRADE_RAD = math.atan2(3.0, 4.0)


def test_eq_1_rolling_friction() -> None:
    assert rolling_force(PLAIN) == pytest.approx(0.1 * 10.0 * G)


def test_eq_2_ideal_range() -> None:
    assert ideal_range(PLAIN) == pytest.approx(1e5 / 9.80665)


def test_eq_3_traction() -> None:
    assert traction_force(PLAIN, 3.0, GRADE_RAD) == pytest.approx(1.0 * G * COS_4 + 0.5 * 9.0 + 10.0 * G * SIN_3)
    assert traction_force(PLAIN, 3.0, -GRADE_RAD) == pytest.approx(1.0 * G * COS_4 + 0.5 * 9.0 - 10.0 * G * SIN_3)


def test_eq_4_manoeuvring_energy() -> None:
    assert manoeuvring_energy(7.0, 3.0) == 21.0


def test_eq_5_ancillary_power() -> None:
    assert ancillary_power(PLAIN, 0.0) == pytest.approx(1.5)
    assert ancillary_power(PLAIN, 50.0) == pytest.approx(1.5 + 0.5 + 3.0)


def test_eq_6_usable_energy() -> None:
    worn = dataclasses.replace(PLAIN, cycle_fade=0.01, age_fade=0.1, cycles=20.0, age=3.0)
    assert usable_energy(worn, 20.0, 3.0) == worn.usable_energy_j == pytest.approx(1e5 * math.exp(-0.5))
    assert usable_energy(worn, 0.0, 0.0) == 1e5


def test_eq_7_mission_energy() -> None:
    force_n = 9.80665 + 0.5 * 4.0
    by_hand = 30.0 * (5.0 / (2.0 * 0.25) + force_n / 0.5)
    assert mission_energy(PLAIN, 30.0, 2.0, 0.0, 0.25, 50.0) == pytest.approx(by_hand)


def test_eq_8_range() -> None:
    per_metre = 5.0 / (2.0 * 0.25) + (9.80665 + 0.5 * 4.0) / 0.5
    assert d_max(PLAIN, 2.0, 0.0, 0.25, 50.0) == pytest.approx(1e5 / per_metre)
    assert d_max(PLAIN, 2.0, 0.0, 0.25, 50.0, energy_j=10.0) == pytest.approx(10.0 / per_metre)


def test_efficiencies() -> None:
    lossy = dataclasses.replace(PLAIN, storage_loss=0.1, friction_loss=0.2, ancillary_loss=0.3)
    assert lossy.traction_efficiency == traction_efficiency(lossy) == pytest.approx(0.5 * 0.8)
    assert lossy.overall_efficiency == pytest.approx(0.9 * 0.5 * 0.8 * 0.7)


def test_drive_power() -> None:
    assert drive_power(PLAIN, 12.0, 2.0) == pytest.approx(48.0)
    assert drive_power(PLAIN, -12.0, 2.0) == 0.0


def test_optimal_speed_by_hand() -> None:
    # (P Gamma / (2 c D))^(1/3) with 5 W, 0.5, 0.5 and 0.2
    assert optimal_speed(PLAIN, 0.0, 0.2, 50.0) == pytest.approx((5.0 * 0.5 / (2.0 * 0.5 * 0.2)) ** (1.0 / 3.0))
    assert d_max(PLAIN, None, 0.0, 0.2, 50.0) == d_max(PLAIN, optimal_speed(PLAIN, 0.0, 0.2, 50.0), 0.0, 0.2, 50.0)


@given(robot=robots(with_effects=False), duty=st.floats(0.05, 1.0), hz=st.floats(0.0, 1.0), grade=st.floats(-1.2, 1.2))
def test_optimal_speed_is_the_least_of_eq_7(robot: Robot, duty: float, hz: float, grade: float) -> None:
    speeds = np.linspace(robot.min_speed_mps, robot.max_speed_mps, 2001)
    searched = mission_energy(robot, 1.0, speeds, grade, duty, hz * robot.max_sensing_hz)
    best = optimal_speed(robot, grade, duty, hz * robot.max_sensing_hz)
    assert robot.min_speed_mps <= best <= robot.max_speed_mps
    closed = mission_energy(robot, 1.0, best, grade, duty, hz * robot.max_sensing_hz)
    assert closed <= searched.min() * (1.0 + 1e-12)


@pytest.mark.parametrize("grade", [-0.2, -0.11, -0.1, 0.0, 0.3])
def test_optimal_speed_on_descents_is_where_the_search_finds_it(grade: float) -> None:
    slippery = dataclasses.replace(PLAIN, drag_ns2_per_m2=2.0, max_speed_mps=20.0)
    speeds = np.linspace(0.1, 20.0, 200001)
    searched = speeds[np.argmin(mission_energy(slippery, 1.0, speeds, grade))]
    assert optimal_speed(slippery, grade) == pytest.approx(searched, abs=2e-4)


def test_without_drag_the_fastest_speed_wins() -> None:
    free = dataclasses.replace(PLAIN, drag_ns2_per_m2=0.0)
    np.testing.assert_array_equal(optimal_speed(free, np.array([-0.5, 0.0, 0.5])), [4.0, 4.0, 4.0])


@given(robot=robots(with_effects=False), speed=st.floats(0.0, 1.0), grade=st.floats(-1.2, 1.2), k=quantities(0.1, 10.0))
def test_laws_of_scale(robot: Robot, speed: float, grade: float, k: float) -> None:
    """Ten times the energy goes ten times as far, and a robot with every force and power scaled goes as far as ever."""
    v = robot.min_speed_mps + speed * (robot.max_speed_mps - robot.min_speed_mps)
    reach_m = d_max(robot, v, grade)
    assert d_max(robot, v, grade, energy_j=k * robot.usable_energy_j) == pytest.approx(k * reach_m, rel=1e-9)
    scaled = dataclasses.replace(
        robot,
        mass_kg=k * robot.mass_kg,
        drag_ns2_per_m2=k * robot.drag_ns2_per_m2,
        rated_energy_j=k * robot.rated_energy_j,
        sensing_idle_w=k * robot.sensing_idle_w,
        communication_w=k * robot.communication_w,
        controller_w=k * robot.controller_w,
    )
    assert d_max(scaled, v, grade) == pytest.approx(reach_m, rel=1e-9)
    assert ideal_range(scaled) == pytest.approx(ideal_range(robot), rel=1e-9)
    assert optimal_speed(scaled, grade) == pytest.approx(optimal_speed(robot, grade), rel=1e-9)


@given(robot=robots(with_effects=False), speed=st.floats(0.0, 1.0))
def test_the_range_is_below_the_ideal_one(robot: Robot, speed: float) -> None:
    v = robot.min_speed_mps + speed * (robot.max_speed_mps - robot.min_speed_mps)
    assert d_max(robot, v) < ideal_range(robot)
    assert d_max(robot, v) <= d_max(robot) * (1.0 + 1e-12)


@given(robot=robots(with_effects=False), grade=st.floats(-1.2, 1.2))
def test_there_and_back_costs_at_least_the_rolling_resistance(robot: Robot, grade: float) -> None:
    there_n = traction_force(robot, robot.max_speed_mps, grade)
    back_n = traction_force(robot, robot.max_speed_mps, -grade)
    rolling_n = 2.0 * robot.rolling_resistance * robot.mass_kg * GRAVITY_MPS2 * math.cos(grade)
    paid_n = (drive_power(robot, there_n, 1.0) + drive_power(robot, back_n, 1.0)) * robot.traction_efficiency
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


def test_effects_that_only_add_power_change_the_range_as_eq_8_says() -> None:
    """A standing load is s0 by another name, so the kernel's range must be that of Eq. 8 with a larger s0."""
    by_kernel = d_max(with_effect(PLAIN, "standby", power_w=2.0), 2.0, 0.1, 0.5, 10.0)
    by_equation = d_max(dataclasses.replace(PLAIN, sensing_idle_w=2.5), 2.0, 0.1, 0.5, 10.0)
    assert by_kernel == pytest.approx(float(by_equation), rel=1e-9)


def test_optimal_speed_with_effects_is_searched() -> None:
    """Viscous drag b v moves the optimum: P / v^2 = 2 c v / Gamma + b / Gamma."""
    robot = with_effect(PLAIN, "viscous", drag_ns_per_m=3.0)
    best = float(optimal_speed(robot, 0.0, 1.0, 50.0))
    roots = np.roots([2.0 * 0.5, 3.0, 0.0, -5.0 * 0.5])
    assert best == pytest.approx(float(roots[np.isreal(roots) & (roots.real > 0.0)].real[0]), abs=0.02)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("speed_mps", 0.0),
        ("speed_mps", -1.0),
        ("speed_mps", math.nan),
        ("speed_mps", math.inf),
        ("grade_rad", 5.71),
        ("grade_rad", math.nan),
        ("duty", 0.0),
        ("duty", 1.1),
        ("sensing_hz", -1.0),
        ("sensing_hz", math.inf),
        ("energy_j", -1.0),
        ("energy_j", math.nan),
    ],
)
def test_arguments_out_of_bounds_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"^{name} = {value} is not allowed; allowed: a number in [\[(].*[\])]$"):
        d_max(PLAIN, **{"speed_mps": 1.0, name: np.array([0.5, value])})
    if name not in ("speed_mps", "energy_j"):
        with pytest.raises(ValueError, match=name):
            optimal_speed(PLAIN, **{name: value})
    if name != "energy_j":
        with pytest.raises(ValueError, match=name):
            mission_energy(PLAIN, **{"distance_m": 1.0, "speed_mps": 1.0, name: value})


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda: ancillary_power(PLAIN, -5), "sensing_hz = -5.0 is not allowed; allowed: a number in [0, inf)"),
        (lambda: ancillary_power(PLAIN, [1.0, math.nan]), "sensing_hz = nan is not allowed"),
        (lambda: usable_energy(PLAIN, -1, 0), "cycles = -1.0 is not allowed; allowed: a number in [0, inf)"),
        (lambda: usable_energy(PLAIN, 0, -1), "age = -1.0 is not allowed; allowed: a number in [0, inf)"),
        (lambda: traction_force(PLAIN, -1.0, 0.0), "speed_mps = -1.0 is not allowed; allowed: a number in [0, inf)"),
        (lambda: traction_force(PLAIN, 1.0, 10.0), "grade_rad = 10.0 is not allowed; allowed: a number in [-1.5"),
        (lambda: manoeuvring_energy(math.inf, 1.0), "force_n = inf is not allowed; allowed: a number in (-inf, inf)"),
        (lambda: manoeuvring_energy(1.0, -1.0), "distance_m = -1.0 is not allowed; allowed: a number in [0, inf)"),
        (lambda: d_max(PLAIN, "fast"), "speed_mps = 'fast' is not a number or an array of numbers; allowed: (0, inf)"),
        (lambda: d_max(PLAIN, {}), "speed_mps = {} is not a number or an array of numbers; allowed: (0, inf)"),
        (lambda: d_max(PLAIN, [[1.0], [1.0, 2.0]]), "speed_mps = [[1.0], [1.0, 2.0]] is not a number or an array"),
    ],
)
def test_values_that_no_equation_knows_are_refused_in_one_line(function: Callable[[], Any], message: str) -> None:
    with pytest.raises(ValueError) as caught:
        function()
    assert str(caught.value).startswith(message) and "\n" not in str(caught.value)


@pytest.mark.parametrize("function", BROADCAST)
def test_lists_are_arrays(function: Callable[..., Any]) -> None:
    nested = function(*(values.tolist() for values in (SPEED, GRADE, DUTY, HZ)))
    np.testing.assert_array_equal(nested, function(SPEED, GRADE, DUTY, HZ))
