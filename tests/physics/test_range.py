"""The range on one charge: by hand, by search, and by the kernel where effects are active."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from homeward import Robot, load_robot
from homeward.estimation import Prior
from homeward.physics import (
    CAUSES,
    below_cutoff,
    d_max,
    ideal_range,
    leg,
    manoeuvring_energy,
    mission_energy,
    optimal_speed,
    thresholds,
)
from homeward.physics.battery import FLAT
from homeward.physics.model import GRAVITY_MPS2
from homeward.physics.range import _range_by_kernel
from homeward.physics.uncertainty import Uncertainty
from tests.physics.drives import (
    FALLING,
    PLAIN,
    STEADY,
    cut_off,
    drive,
    quantities,
    robots,
    with_effect,
)


def test_eq_4_manoeuvring_energy() -> None:
    assert manoeuvring_energy(7.0, 3.0) == 21.0


def test_eq_7_mission_energy() -> None:
    force_n = 9.80665 + 0.5 * 4.0
    by_hand = 30.0 * (5.0 / (2.0 * 0.25) + force_n / 0.5)
    assert mission_energy(PLAIN, 30.0, 2.0, 0.0, 0.25, 50.0) == pytest.approx(by_hand)


def test_eq_8_range() -> None:
    per_metre = 5.0 / (2.0 * 0.25) + (9.80665 + 0.5 * 4.0) / 0.5
    assert d_max(PLAIN, 2.0, 0.0, 0.25, 50.0) == pytest.approx(1e5 / per_metre)
    assert d_max(PLAIN, 2.0, 0.0, 0.25, 50.0, energy_j=10.0) == pytest.approx(10.0 / per_metre)


def test_optimal_speed_by_hand() -> None:
    # (P Gamma / (2 c D))^(1/3) with 5 W, 0.5, 0.5 and 0.2
    assert optimal_speed(PLAIN, 0.0, 0.2, 50.0) == pytest.approx(
        (5.0 * 0.5 / (2.0 * 0.5 * 0.2)) ** (1.0 / 3.0)
    )
    assert d_max(PLAIN, None, 0.0, 0.2, 50.0) == d_max(
        PLAIN, optimal_speed(PLAIN, 0.0, 0.2, 50.0), 0.0, 0.2, 50.0
    )


@given(
    robot=robots(with_effects=False),
    duty=st.floats(0.05, 1.0),
    hz=st.floats(0.0, 1.0),
    grade=st.floats(-1.2, 1.2),
)
def test_optimal_speed_is_the_least_of_eq_7(
    robot: Robot, duty: float, hz: float, grade: float
) -> None:
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


@given(
    robot=robots(with_effects=False),
    speed=st.floats(0.0, 1.0),
    grade=st.floats(-1.2, 1.2),
    k=quantities(0.1, 10.0),
)
def test_laws_of_scale(robot: Robot, speed: float, grade: float, k: float) -> None:
    """Ten times the energy goes ten times as far, and a robot with every force and power scaled
    goes as far as ever."""
    v = robot.min_speed_mps + speed * (robot.max_speed_mps - robot.min_speed_mps)
    reach_m = d_max(robot, v, grade)
    assert d_max(robot, v, grade, energy_j=k * robot.usable_energy_j) == pytest.approx(
        k * reach_m, rel=1e-9
    )
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


def test_effects_that_only_add_power_change_the_range_as_eq_8_says() -> None:
    """A standing load is s0 by another name, so the kernel's range must be that of Eq. 8 with a
    larger s0."""
    by_kernel = d_max(with_effect(PLAIN, "standby", power_w=2.0), 2.0, 0.1, 0.5, 10.0)
    by_equation = d_max(dataclasses.replace(PLAIN, sensing_idle_w=2.5), 2.0, 0.1, 0.5, 10.0)
    assert by_kernel == pytest.approx(float(by_equation), rel=1e-9)


def test_optimal_speed_with_effects_is_searched() -> None:
    """Viscous drag b v moves the optimum: P / v^2 = 2 c v / Gamma + b / Gamma."""
    robot = with_effect(PLAIN, "viscous", drag_ns_per_m=3.0)
    best = float(optimal_speed(robot, 0.0, 1.0, 50.0))
    roots = np.roots([2.0 * 0.5, 3.0, 0.0, -5.0 * 0.5])
    assert best == pytest.approx(
        float(roots[np.isreal(roots) & (roots.real > 0.0)].real[0]), abs=0.02
    )


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
    with pytest.raises(
        ValueError, match=rf"^{name} = {value} is not allowed; allowed: a number in [\[(].*[\])]$"
    ):
        d_max(PLAIN, **{"speed_mps": 1.0, name: np.array([0.5, value])})
    if name not in ("speed_mps", "energy_j"):
        with pytest.raises(ValueError, match=name):
            optimal_speed(PLAIN, **{name: value})
    if name != "energy_j":
        with pytest.raises(ValueError, match=name):
            mission_energy(PLAIN, **{"distance_m": 1.0, "speed_mps": 1.0, name: value})


@given(robot=robots(with_effects=False), duty=st.floats(0.01, 1.0), grade=st.floats(-0.3, 1.2))
def test_range_by_the_kernel_is_eq_8_at_any_duty_cycle(
    robot: Robot, duty: float, grade: float
) -> None:
    by_kernel = _range_by_kernel(
        robot, robot.max_speed_mps, grade, duty, 0.0, robot.usable_energy_j
    )
    assert float(by_kernel) == pytest.approx(
        float(d_max(robot, robot.max_speed_mps, grade, duty)), rel=1e-9
    )


@pytest.mark.parametrize("curve", [(), FALLING])
def test_a_range_with_effects_runs_out_where_the_steps_run_out(
    curve: tuple[tuple[float, float], ...],
) -> None:
    robot = dataclasses.replace(
        load_robot("husky"),
        chemistry=FLAT,
        cells_in_series=0,
        open_circuit_v=tuple((share, 2.4 * volts) for share, volts in curve),
        effects={
            "motor_heating": {"per_k": 0.004, "rise_k_per_w": 0.2, "time_constant_s": 1200.0},
            "internal_resistance": {"ohm": 0.05},
            "standby": {"power_w": 20.0},
        },
    )
    reach_m = float(d_max(robot, 0.8, 0.02))
    x = STEADY._replace(
        speed_mps=0.8, sensing_hz=0.0, sin_grade=np.sin(0.02), cos_grade=np.cos(0.02)
    )
    end = drive(robot, [x] * 40000, 1.0, speed_mps=0.8)
    assert end["depleted"] and end["energy_j"] == 0.0
    assert float(end["ledger_j"].sum()) == pytest.approx(robot.usable_energy_j, rel=1e-9)
    assert float(end["distance_m"]) == pytest.approx(reach_m, rel=1e-4)
    assert reach_m < 0.9 * float(d_max(dataclasses.replace(robot, effects={}), 0.8, 0.02))


def test_a_charge_that_never_ends_has_no_range() -> None:
    robot = with_effect(PLAIN, "regeneration", share=0.9)
    assert d_max(robot, 2.0, -0.8) == np.inf
    free = dataclasses.replace(PLAIN, sensing_idle_w=0.0, communication_w=0.0, controller_w=0.0)
    assert d_max(free, 2.0, -0.8) == np.inf
    assert d_max(free, 2.0, -0.8, energy_j=0.0) == d_max(robot, 2.0, -0.8, energy_j=0.0) == 0.0


def test_a_charge_that_lasts_for_ages_has_a_range() -> None:
    """A joule at a twentieth of a nanowatt: a thousandth of it lasts longer than any effect
    remembers."""
    powers = ("mass_kg", "drag_ns2_per_m2", "sensing_idle_w", "communication_w", "controller_w")
    tiny = dataclasses.replace(PLAIN, **{name: 1e-12 * getattr(PLAIN, name) for name in powers})
    by_kernel = _range_by_kernel(tiny, 2.0, 0.0, 1.0, 0.0, 1.0)
    assert float(by_kernel) == pytest.approx(float(d_max(tiny, 2.0, energy_j=1.0)), rel=1e-9)


def test_a_duty_cycle_with_a_load_ends_within_a_cycle_of_eq_8() -> None:
    """The kernel drives and stands in turn; the last cycle counts by the share for which the charge
    is enough."""
    for duty in (0.2, 0.5, 0.9):
        by_kernel = d_max(with_effect(PLAIN, "standby", power_w=2.0), 1.0, duty=duty)
        by_equation = d_max(dataclasses.replace(PLAIN, sensing_idle_w=2.5), 1.0, duty=duty)
        assert float(by_kernel) == pytest.approx(float(by_equation), rel=1e-9)


def test_an_empty_battery_goes_nowhere() -> None:
    assert d_max(PLAIN, 1.0, energy_j=0.0) == 0.0
    assert d_max(with_effect(PLAIN, "standby", power_w=2.0), 1.0, energy_j=0.0) == 0.0


class Way(NamedTuple):
    place_m: float
    grade_rad: NDArray[np.float64]
    heading_rad: NDArray[np.float64]


HILL = Way(50.0, np.array([0.0, 0.08, 0.02, -0.3, 0.0]), np.array([0.0, 0.5, 0.5, 3.0, -3.0]))
"""With a descent that is driven without power, and a turn through the west."""


def test_a_leg_of_a_robot_without_effects_is_eq_7_place_by_place() -> None:
    by_hand = sum(
        float(mission_energy(PLAIN, 50.0, 2.0, grade, sensing_hz=10.0)) for grade in HILL.grade_rad
    )
    there = leg(PLAIN, HILL, 2.0, sensing_hz=10.0)
    assert there.mean_j == pytest.approx(by_hand) and there.time_s == 125.0
    single = leg(PLAIN, Way(80.0, np.array([0.05]), np.zeros(1)), 2.0)
    assert (
        single.mean_j == pytest.approx(float(mission_energy(PLAIN, 80.0, 2.0, 0.05)))
        and single.time_s == 40.0
    )


def test_bends_of_a_leg_count_for_a_robot_that_scrubs() -> None:
    scrubs = with_effect(PLAIN, "turning", scrub=0.5)
    bends = HILL._replace(grade_rad=np.zeros(5))
    straight = bends._replace(heading_rad=np.zeros(5))
    assert leg(scrubs, straight, 2.0).mean_j == pytest.approx(leg(PLAIN, bends, 2.0).mean_j)
    # Wheels differ by track times the change of heading in the 25 s of a place; that through the
    # west is short.
    turn_mps = 0.5 * np.array([0.5, 0.0, 2.5, math.tau - 6.0, 0.0]) / 25.0
    force_n = 0.5 * 10.0 * GRAVITY_MPS2 * np.sqrt(turn_mps / (turn_mps + 4.0))
    more_j = leg(scrubs, bends, 2.0).mean_j - leg(scrubs, straight, 2.0).mean_j
    assert more_j == pytest.approx(force_n.sum() * 50.0 / 0.5)


@pytest.mark.parametrize(
    ("name", "share"),
    [
        ("rolling", 0.0),
        ("mass", 1.0),
        ("drag", 0.0),
        ("idle_power", 0.0),
        ("sample_energy", 0.0),
        ("capacity", 0.0),
    ],
)
def test_the_interval_of_a_leg_is_that_of_its_parameters_as_they_count_there(
    name: str, share: float
) -> None:
    level, climb = (Way(100.0, np.full(2, grade), np.zeros(2)) for grade in (0.0, 0.1))
    of_parameter = {
        "rolling": 0.1 * 10.0 * GRAVITY_MPS2 * 200.0 / 0.5, "mass": 0.0, "drag": 0.5 * 4.0 * 200.0 / 0.5,
        "idle_power": 1.5 * 100.0, "sample_energy": 0.03 * 20.0 * 100.0, "capacity": 0.0,
    }[name]  # fmt: skip
    given = Uncertainty(fitted=(name,), covariance=((0.01,),), between_runs=0.0)
    robot = dataclasses.replace(PLAIN, uncertainty=given)
    there = leg(robot, level, 2.0, sensing_hz=20.0)
    assert there.sd_j == pytest.approx(0.1 * of_parameter, rel=2e-3, abs=1e-6)
    assert (there.mean_j - there.low_j, there.high_j - there.mean_j) == pytest.approx(
        [1.645 * there.sd_j] * 2
    )
    # What is surely larger where the resistance is adds to it, and does not cancel it.
    rolling_j = 0.1 * 10.0 * GRAVITY_MPS2 * 200.0 / 0.5
    if name != "rolling":
        together = dataclasses.replace(
            given, fitted=("rolling", name), covariance=((0.01, 0.01), (0.01, 0.01))
        )
        both = leg(dataclasses.replace(PLAIN, uncertainty=together), level, 2.0, sensing_hz=20.0)
        assert both.sd_j == pytest.approx(0.1 * (rolling_j + of_parameter), rel=2e-3)
    if share:
        weight_j = 10.0 * GRAVITY_MPS2 * math.sin(0.1) * 200.0 / 0.5
        assert leg(robot, climb, 2.0).sd_j == pytest.approx(0.1 * weight_j, rel=2e-3)


def test_the_interval_of_a_leg_has_what_differs_between_runs_and_what_is_unexplained() -> None:
    level = Way(100.0, np.zeros(2), np.zeros(2))
    given = Uncertainty(
        fitted=("rolling",),
        covariance=((1e-6,),),
        between_runs=0.1,
        unexplained=0.3,
        unexplained_m=5.0,
    )
    there = leg(dataclasses.replace(PLAIN, uncertainty=given), level, 2.0)
    assert there.sd_j / there.mean_j == pytest.approx(
        math.hypot(0.1, given.unexplained_over(200.0))
    )
    unknown = Uncertainty(fitted=("turning.scrub",), covariance=((0.01,),))
    with pytest.raises(
        ValueError, match=r"names 'turning\.scrub', which robot 'plain' does not have"
    ):
        leg(dataclasses.replace(PLAIN, uncertainty=unknown), level, 2.0)
    with pytest.raises(ValueError, match="speed_mps"):
        leg(PLAIN, level, 0.0)


def test_generic_ranges_are_those_of_uncertain_missions() -> None:
    prior = Prior()
    assert (
        pytest.approx(math.hypot(prior.rolling_sd, prior.rolling - 1.0), abs=1e-3)
        == thresholds.GENERIC_ROLLING_SD
    )
    assert (
        pytest.approx(math.hypot(prior.mass_sd, prior.mass - 1.0), abs=1e-3)
        == thresholds.GENERIC_PAYLOAD_SD
    )
    level = Way(100.0, np.zeros(2), np.zeros(2))
    there = leg(PLAIN, level, 2.0)
    rolling_j = 0.1 * 10.0 * GRAVITY_MPS2 * 200.0 / 0.5
    both = math.hypot(thresholds.GENERIC_ROLLING_SD, thresholds.GENERIC_PAYLOAD_SD) * rolling_j
    at_rest_j = 1.5 * 100.0
    unsure_j = math.hypot(
        both, thresholds.GENERIC_IDLE_SD * at_rest_j, thresholds.OMITTED * there.mean_j
    )
    assert there.sd_j == pytest.approx(unsure_j, rel=2e-3)
    stated = Uncertainty(of="force", fitted=("idle_power",), covariance=((0.05**2,),))
    own = leg(dataclasses.replace(PLAIN, uncertainty=stated), level, 2.0)
    assert own.sd_j == pytest.approx(
        math.hypot(both, 0.05 * at_rest_j, thresholds.OMITTED * own.mean_j), rel=2e-3
    )
    # A computer that works while anything is sensed is as unsure; what a sample takes is the
    # file's.
    works = dataclasses.replace(PLAIN, computer_w=8.0)
    more_j2 = leg(works, level, 2.0, sensing_hz=0.1).sd_j ** 2 - leg(works, level, 2.0).sd_j ** 2
    assert more_j2 > (thresholds.GENERIC_IDLE_SD * 8.0 * 100.0) ** 2


@pytest.mark.parametrize("grade_rad", [0.0, 0.02])
def test_a_range_ends_at_the_cut_off(grade_rad: float) -> None:
    robot = cut_off(1.6, ohm=0.05)
    x = STEADY._replace(
        speed_mps=1.0, sensing_hz=0.0, sin_grade=np.sin(grade_rad), cos_grade=np.cos(grade_rad)
    )
    end = drive(robot, [x] * 40000, 1.0, speed_mps=1.0)
    kept_j = float(end["ledger_j"][CAUSES.index("below_cutoff")])
    load_w = float(end["terminal_w"])
    rest_v = 9.0 + 0.05 * load_w / 9.0
    assert load_w > 20.0 and kept_j == pytest.approx(1e5 * (rest_v**2 - 64.0) / 80.0, rel=1e-6)
    assert float(below_cutoff(robot, 1.0, grade_rad)) == pytest.approx(kept_j, rel=1e-9)
    reach_m = float(d_max(robot, 1.0, grade_rad))
    assert reach_m == pytest.approx(float(end["distance_m"]), rel=1e-4)
    assert reach_m < 0.8 * float(d_max(robot.without_cutoff(), 1.0, grade_rad))


def test_a_range_in_turns_ends_where_its_driving_is_cut_off() -> None:
    robot = cut_off(1.6, ohm=0.05)
    kept_j = float(below_cutoff(robot, 1.0))
    whole_m = float(d_max(robot.without_cutoff(), 1.0, duty=0.5, energy_j=1e5 - kept_j))
    assert float(below_cutoff(robot, 1.0, duty=0.5)) == pytest.approx(kept_j, rel=2e-3)
    # The voltage is lower than that of a battery of that energy, and so the loss higher.
    assert float(d_max(robot, 1.0, duty=0.5)) == pytest.approx(whole_m, rel=5e-3)


@pytest.mark.parametrize("duty", [1.0, 0.7, 0.3])
def test_a_range_in_turns_ends_within_a_turn(duty: float) -> None:
    robot = cut_off(1.6, ohm=0.0)
    # Without a resistance (81 - 64) / 80 of the energy stay, whatever the load.
    whole_m = float(d_max(robot.without_cutoff(), 1.0, duty=duty))
    assert float(d_max(robot, 1.0, duty=duty)) == pytest.approx(0.7875 * whole_m, rel=1e-6)


def test_a_load_that_no_charge_carries_has_no_range() -> None:
    robot = cut_off(64.0, ohm=1.0)
    assert d_max(robot, 1.0) == d_max(robot, 1.0, duty=0.5) == 0.0
    assert float(below_cutoff(robot, 1.0)) == robot.usable_energy_j


def test_a_cut_off_without_effects_keeps_what_is_below_its_voltage_at_rest() -> None:
    robot = dataclasses.replace(cut_off(9.0), effects={})
    # (81 - 64) / 80 of the energy
    assert float(below_cutoff(robot, 1.0)) == pytest.approx(21250.0, rel=1e-6)
    whole_m = float(d_max(robot.without_cutoff(), 1.0))
    assert float(d_max(robot, 1.0)) == pytest.approx((1.0 - 0.2125) * whole_m, rel=1e-6)
    assert below_cutoff(PLAIN, 1.0, np.zeros(3)).tolist() == [0.0, 0.0, 0.0]
