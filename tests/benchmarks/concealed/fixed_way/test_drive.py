"""A drive goes out and back within the robot's limits, and does what is planned."""

import dataclasses

import numpy as np
import pytest

from benchmarks.concealed.fixed_way.drive import (
    Drive,
    NewPace,
    Plan,
    Spell,
    Stop,
    drive,
    slower_uphill,
)
from benchmarks.concealed.fixed_way.way import Way, draw_way

CALM = Plan(pace_mps=0.7, random_stops=0, random_spells=0, dodges=0)


@pytest.fixture(scope="module")
def way() -> Way:
    return draw_way(np.random.default_rng(3), length_m=60.0)


def driven(way: Way, plan: Plan) -> Drive:
    return drive(way, plan, np.random.default_rng(4))


def mean_mps(run: Drive, start_m: float, end_m: float) -> float:
    is_between = (run.driven_m >= start_m) & (run.driven_m < end_m)
    return float(run.speed_mps[is_between].mean())


def test_a_drive_begins_and_ends_standing_at_the_base(way: Way) -> None:
    run = driven(way, Plan(pace_mps=0.7))
    assert run.speed_mps[0] == run.speed_mps[-1] == 0.0
    assert run.place_m[0] == 0.0
    assert run.place_m[-1] < 0.1
    assert run.place_m.max() == way.length_m


def test_a_drive_keeps_the_limits_of_the_robot(way: Way) -> None:
    run = driven(way, dataclasses.replace(CALM, pace_mps=2.0))
    change_mps2 = np.diff(run.speed_mps) / run.dt_s
    assert run.speed_mps.max() == 1.0
    assert change_mps2.max() <= 0.3 + 1e-9


def test_the_way_driven_is_the_integral_of_the_speed(way: Way) -> None:
    run = driven(way, Plan(pace_mps=0.7))
    is_on_the_way = np.diff(run.driven_m) > 0.0
    steps_m = run.speed_mps[1:] * run.dt_s
    assert np.diff(run.driven_m)[is_on_the_way] == pytest.approx(steps_m[is_on_the_way], abs=0.05)


def test_the_way_home_goes_down_where_the_way_out_goes_up(way: Way) -> None:
    run = driven(way, CALM)
    expected_rad = way.at(way.grade_rad, run.place_m)
    is_home = run.direction == -1.0
    assert run.grade_rad[is_home] == pytest.approx(-expected_rad[is_home])
    assert run.grade_rad[run.direction == 1.0] == pytest.approx(expected_rad[run.direction == 1.0])


def test_the_heading_turns_with_the_yaw_rate(way: Way) -> None:
    run = driven(way, CALM)
    turned_rad = run.heading_rad[-1] - run.heading_rad[0]
    assert np.sum(run.yaw_rate_radps) * run.dt_s == pytest.approx(turned_rad, abs=0.1)
    assert abs(turned_rad) == pytest.approx(np.pi, abs=0.1)


def test_a_stop_is_made_where_and_for_how_long_it_is_planned(way: Way) -> None:
    run = driven(way, dataclasses.replace(CALM, stops=(Stop(driven_m=30.0, seconds=20.0),)))
    stands_there = (run.speed_mps == 0.0) & (np.abs(run.driven_m - 30.0) < 0.1)
    assert np.sum(stands_there) * run.dt_s == pytest.approx(20.0, abs=0.2)


def test_a_spell_is_slower_and_a_new_pace_stays(way: Way) -> None:
    plain = driven(way, CALM)
    spell = driven(way, dataclasses.replace(CALM, spells=(Spell(20.0, 40.0, factor=0.5),)))
    changed = driven(way, dataclasses.replace(CALM, new_pace=NewPace(20.0, pace_mps=0.35)))
    assert mean_mps(spell, 25.0, 38.0) == pytest.approx(0.5 * mean_mps(plain, 25.0, 38.0), rel=0.1)
    assert mean_mps(spell, 45.0, 55.0) == pytest.approx(mean_mps(plain, 45.0, 55.0), rel=0.1)
    assert mean_mps(changed, 45.0, 55.0) == pytest.approx(
        0.5 * mean_mps(plain, 45.0, 55.0), rel=0.1
    )


def test_the_pace_is_slower_uphill_in_either_direction(way: Way) -> None:
    factor = slower_uphill(way, slower_share=0.2, steep_rad=0.04)
    steepest = int(np.argmax(way.grade_rad))
    assert factor(way.place_m, 1)[steepest] == pytest.approx(0.8)
    assert factor(way.place_m, -1)[steepest] == 1.0


def test_the_same_seed_gives_the_same_drive(way: Way) -> None:
    plan = Plan(pace_mps=0.7)
    assert np.array_equal(driven(way, plan).yaw_rate_radps, driven(way, plan).yaw_rate_radps)
