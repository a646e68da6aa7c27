"""Every number that the paper lets one check, and what must hold because of its errata."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward import Robot, load_robot
from homeward.physics import (
    ancillary_power,
    d_max,
    ideal_range,
    mission_energy,
    traction_force,
    usable_energy,
)
from homeward.physics.model import GRAVITY_MPS2, composition, drive_power, sensing_power

RUSTI = load_robot("rusti")
NO_DRAG = dataclasses.replace(RUSTI, drag_ns2_per_m2=0.0)
GRADES = st.floats(-1.5, 1.5)
SPEEDS = st.floats(RUSTI.min_speed_mps, RUSTI.max_speed_mps)
DUTIES = st.floats(0.01, 1.0)
INCLINE_RAD = math.radians(5.71)  # Trajectory
COMPONENTS_W = {
    "manoeuvring": (4.8158, 6.8456),
    "sensing": (0.0293, 0.0348),
    "radio": (0.165, 0.166),
    "micro-controller": (0.3928, 0.3928),
}  # Table III


def test_overall_efficiency_follows_from_the_factors_of_table_i() -> None:
    assert pytest.approx(0.995 * 0.942 * 0.092 * 0.999, rel=1e-12) == RUSTI.overall_efficiency
    assert round(100 * RUSTI.overall_efficiency, 4) == 8.6144


def test_the_friction_loss_of_the_text_does_not_give_the_printed_efficiency() -> None:
    printed = 0.08615
    text = dataclasses.replace(RUSTI, friction_loss=0.918)
    assert abs(RUSTI.overall_efficiency - printed) < 1e-5
    assert abs(text.overall_efficiency - printed) > 0.009


@pytest.mark.parametrize(
    ("component", "least_pct", "most_pct"),
    [
        ("manoeuvring", 89.03, 92.10),
        ("sensing", 0.39, 0.64),
        ("radio", 2.22, 3.07),
        ("micro-controller", 5.28, 7.27),
    ],
)
def test_composition_by_the_rule_of_table_iii(
    component: str, least_pct: float, most_pct: float
) -> None:
    least, most = composition(COMPONENTS_W)[component]
    assert (round(100 * least, 2), round(100 * most, 2)) == (least_pct, most_pct)


def test_the_printed_sensing_share_does_not_follow_from_the_rule() -> None:
    least, most = composition(COMPONENTS_W)["sensing"]
    assert 100 * least < 0.46 and 100 * most > 0.54


def test_manoeuvring_share_with_an_embedded_computer_of_8_to_15_w() -> None:
    shares = []
    for bound, computer_w in ((1, 15.0), (0, 8.0)):
        total_w = sum(watts[bound] for watts in COMPONENTS_W.values()) + computer_w
        shares.append(round(100 * COMPONENTS_W["manoeuvring"][bound] / total_w, 1))
    assert shares == [30.5, 35.9]  # 36.5 is printed


def test_drive_power_at_1_mps_without_drag() -> None:
    power_w = mission_energy(NO_DRAG, 1.0, 1.0) - ancillary_power(NO_DRAG, 0.0)
    assert round(float(power_w), 2) == 8.83


def test_composition_of_fixed_powers_is_their_share() -> None:
    shares = composition({"drive": (3.0, 3.0), "radio": (1.0, 1.0)})
    assert shares == {"drive": (0.75, 0.75), "radio": (0.25, 0.25)}


def test_sensing_power_at_100_hz_by_the_formula() -> None:
    assert round(float(sensing_power(RUSTI, 100.0)), 4) == 0.0350


def test_ancillary_power_is_the_sum_of_the_papers_parts() -> None:
    assert float(ancillary_power(RUSTI, 100.0)) == pytest.approx(
        0.0293 + 0.0057318 + 0.166 + 0.3928, rel=1e-12
    )


def test_embedded_computer_is_off_at_rest_and_rises_from_8_to_15_w() -> None:
    extra_w = ancillary_power(
        load_robot("rusti_computer"), np.array([0.0, 1e-9, 100.0])
    ) - ancillary_power(RUSTI, np.array([0.0, 1e-9, 100.0]))
    np.testing.assert_allclose(extra_w, [0.0, 8.0, 15.0], rtol=1e-9)


def test_ideal_range_is_energy_over_friction() -> None:
    assert ideal_range(RUSTI) == pytest.approx(55440.0 / (0.1 * 0.78 * GRAVITY_MPS2), rel=1e-12)


def test_the_incline_needs_almost_no_force_downhill() -> None:
    downhill, uphill = traction_force(NO_DRAG, 1.0, np.array([-INCLINE_RAD, INCLINE_RAD]))
    assert abs(downhill) < 1e-3 * uphill


def test_ten_cycles_as_printed_would_take_71_percent_of_the_battery() -> None:
    lost = 1.0 - float(usable_energy(RUSTI, 10.0, 0.0)) / RUSTI.rated_energy_j
    assert round(lost, 2) == 0.71


@given(speed=SPEEDS, grade=GRADES, duty=DUTIES)
def test_eq_8_inverts_eq_7(speed: float, grade: float, duty: float) -> None:
    reach_m = d_max(RUSTI, speed, grade, duty)
    assert float(mission_energy(RUSTI, reach_m, speed, grade, duty)) == pytest.approx(
        RUSTI.usable_energy_j, rel=1e-9
    )


@given(speed=SPEEDS, duty=DUTIES)
def test_ancillary_energy_is_that_of_eq_7_and_not_eta4_of_the_battery(
    speed: float, duty: float
) -> None:
    parked = dataclasses.replace(RUSTI, ancillary_loss=0.5)
    assert mission_energy(parked, 1.0, speed, 0.0, duty) == mission_energy(
        RUSTI, 1.0, speed, 0.0, duty
    )


def test_stopping_costs_range() -> None:
    reach_m = d_max(RUSTI, 1.0, duty=np.linspace(0.1, 1.0, 10))
    assert np.all(np.diff(reach_m) > 0.0)


@given(speed=SPEEDS, grade=GRADES)
def test_a_descent_never_gives_energy(speed: float, grade: float) -> None:
    assert drive_power(RUSTI, traction_force(RUSTI, speed, grade), speed) >= 0.0


@given(
    speed=SPEEDS,
    legs=st.lists(st.tuples(st.floats(-0.7, 0.7), st.floats(0.1, 100.0)), min_size=1, max_size=6),
    friction=st.floats(1e-6, 0.5),
)
def test_no_closed_loop_gains_energy(
    speed: float, legs: list[tuple[float, float]], friction: float
) -> None:
    robot: Robot = dataclasses.replace(RUSTI, rolling_resistance=friction)
    grade, length_m = np.array(legs).T
    climb_m = length_m @ np.sin(grade)
    # The last leg comes back to the height of the first.
    back = -math.copysign(0.5, climb_m)
    grade, length_m = np.append(grade, back), np.append(length_m, abs(climb_m) / math.sin(0.5))
    drive_j = drive_power(robot, traction_force(robot, speed, grade), speed) * length_m / speed
    friction_j = (
        robot.rolling_resistance * robot.mass_kg * GRAVITY_MPS2 * (length_m @ np.cos(grade))
    )
    assert drive_j.sum() * robot.traction_efficiency >= friction_j * (1.0 - 1e-9)
