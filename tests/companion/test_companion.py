"""The companion knows how far home is and how sure that is, says when to turn, and takes what
happens to robots."""

import dataclasses
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from homeward.agents.belief import prior_of
from homeward.companion import Advice, Companion, CompanionError
from homeward.companion.prior_knowledge import known_of
from homeward.envs.options import Options
from homeward.envs.options import known_of as known_env_of
from homeward.envs.routes import Route
from homeward.physics import Robot, load_robot
from homeward.physics.battery import charge_share, energy_share, open_circuit_v
from homeward.physics.uncertainty import Uncertainty
from homeward.thresholds import POSITION_M
from tests.companion.robots import HUSKY, Driven

HOME = math.pi


def companion(**keywords: Any) -> Companion:
    return Companion(HUSKY, **{"home": (0.0, 0.0), **keywords})


@pytest.mark.parametrize(("rolling", "health"), [(0.85, 0.95), (1.25, 0.85)])
def test_it_learns_what_home_takes_and_what_is_left(rolling: float, health: float) -> None:
    one, robot = companion(), Driven(every_s=5.0, rolling=rolling, health=health)
    advice = robot.drive(one, 0.0, 2000.0)
    takes_j = robot.power_w() * 2000.0
    assert advice.way_home_m == pytest.approx(2000.0, rel=1e-3)
    assert advice.energy_home_j.low < takes_j < advice.energy_home_j.high
    # the wind of the way home it cannot know
    assert advice.energy_home_j.mean == pytest.approx(takes_j, rel=0.07)
    # A counter's gain is known within 2 %, and nobody knows how full it was within 1 %.
    assert advice.energy_left_j.low < robot.left_j < advice.energy_left_j.high
    assert advice.energy_left_j.mean == pytest.approx(robot.left_j, rel=0.05)
    assert not advice.turn_now and advice.chance_home > 0.9999


@pytest.mark.parametrize("idles", [0.85, 1.15])
def test_a_computer_that_draws_more_or_less_than_in_the_file_is_no_wind(idles: float) -> None:
    """On the way home it draws the same, whereas a wind that is against the robot helps it then."""
    file = dataclasses.replace(load_robot("f1tenth"), chemistry="flat", cells_in_series=0)
    robot = Driven(dataclasses.replace(file, controller_w=idles * file.controller_w))
    advice = robot.drive(Companion(file, home=(0.0, 0.0), cruise_mps=1.0), 0.0, 600.0)
    takes_j = robot.power_w() * 600.0
    assert advice.energy_home_j.mean == pytest.approx(takes_j, rel=0.03)
    assert advice.energy_home_j.low < takes_j < advice.energy_home_j.high


def drive_at(one: Companion, pace_mps: float, **other: Any) -> tuple[Advice, float]:
    """Drive a Husky straight out for 2,000 s, and return the advice and what the same way back
    takes, J."""
    power_w, every_s = Driven().power_w(pace_mps), 10.0
    for step in range(201):
        at_s = every_s * step
        read = {
            "speed_mps": pace_mps,
            "power_w": power_w,
            "heading_rad": 0.0,
            "grade_rad": 0.0,
        } | other
        advice = one.update(at_s, position=(pace_mps * at_s, 0.0), **read)
    return advice, power_w * 2000.0


@pytest.mark.parametrize("speed_mps", [0.3, 0.5, 0.9])
def test_the_way_home_takes_as_long_as_the_way_out(speed_mps: float) -> None:
    """A slow robot stands longer by its power at rest, which is half of a Husky's."""
    one = companion(soc=1.0)
    assert "the speed with the longest range, until the robot has driven" in " ".join(
        one.update(0.0).rests_on
    )
    advice, takes_j = drive_at(one, speed_mps)
    assert advice.energy_home_j.mean == pytest.approx(takes_j, rel=0.02)
    assert f"the way home at {speed_mps:g} m/s, as it was driven on the way out" in " ".join(
        advice.rests_on
    )
    stood = one.update(
        2600.0, speed_mps=0.0, power_w=Driven().power_w(0.0), position=(speed_mps * 2000.0, 0.0)
    )
    assert stood.energy_home_j.mean == pytest.approx(advice.energy_home_j.mean, rel=0.02)
    told, _takes_j = drive_at(companion(soc=1.0, cruise_mps=1.0), speed_mps)
    assert told.energy_home_j.mean < advice.energy_home_j.mean and "1 m/s (given)" in " ".join(
        told.rests_on
    )


def test_without_a_speed_the_pace_is_that_of_the_positions() -> None:
    advice, takes_j = drive_at(companion(soc=1.0), 0.4, speed_mps=None)
    assert advice.energy_home_j.mean == pytest.approx(takes_j, rel=0.05)


def test_a_capacity_that_was_measured_is_taken_and_what_cannot_be_is_refused() -> None:
    full_j = HUSKY.usable_energy_j
    plain, told = (
        companion(soc=1.0, **given).update(0.0, position=(0.0, 0.0))
        for given in ({}, {"capacity_j": 0.85 * full_j})
    )
    assert (
        told.energy_left_j.mean < plain.energy_left_j.mean
        and told.energy_left_j.sd < 0.7 * plain.energy_left_j.sd
    )
    assert "a measured capacity of 85%" in " ".join(told.rests_on)
    with pytest.raises(CompanionError, match=r"capacity_j = .* is not allowed; give a number in"):
        companion(capacity_j=1.1 * full_j)


def test_without_a_meter_the_battery_is_as_unsure_as_the_models_power() -> None:
    """Rolling resistance and payload are unsure for the part that drives, the power at rest for the
    other."""
    at_rest_only = dataclasses.replace(HUSKY, controller_w=2000.0)
    sds = [
        Driven(robot)
        .drive(Companion(robot, home=(0.0, 0.0)), 0.0, 200.0, power_w=None)
        .energy_home_j
        for robot in (HUSKY, at_rest_only)
    ]
    shares = [estimate.sd / estimate.mean for estimate in sds]
    assert shares[1] == pytest.approx(0.18, abs=0.02) and shares[0] > 0.1


def test_the_way_home_begins_with_turning_round() -> None:
    advice = Driven().drive(companion(), 0.0, 5.0)
    robot = Driven()
    turning_j = robot.power_w(0.0) * 10.0
    assert advice.energy_home_j.low < robot.power_w() * 5.0 + turning_j < advice.energy_home_j.high


@pytest.mark.parametrize(("home", "place"), [((0.0, 0.0), (500.0, 0.0)), (None, 500.0)])
def test_a_robot_that_starts_away_from_home_has_that_way_to_go_and_has_not_driven_it(
    home: Any, place: Any
) -> None:
    companion = Companion(HUSKY, home=home, soc=0.05)
    first, second = (companion.update(at_s, position=place, speed_mps=0.0) for at_s in (0.0, 0.1))
    assert first.energy_home_j.mean == pytest.approx(second.energy_home_j.mean, rel=0.01)
    assert first.energy_left_j.mean == pytest.approx(second.energy_left_j.mean, rel=0.01)
    assert 0.1 < first.chance_home < 0.9


def test_who_turns_when_it_says_so_comes_home_with_little_left() -> None:
    one, robot = companion(), Driven(rolling=1.2, health=0.85, every_s=5.0)
    advice = robot.drive(one, 0.0, 60.0)
    before_m = math.inf
    while not advice.turn_now:
        assert advice.turn_in_m < before_m + 500.0
        before_m = advice.turn_in_m
        advice = robot.drive(one, 0.0, 30.0)
    reached_m = robot.xy[0]
    while robot.xy[0] > 0.5:
        advice = robot.drive(one, HOME, 30.0)
        assert advice.turn_now == (advice.way_home_m > POSITION_M)  # latched
    assert 0.02 < robot.left_j / robot.full_j < 0.35
    assert reached_m > 3000.0


def turned(one: Companion, robot: Driven, **other: Any) -> Advice:
    """Drive out until it must turn."""
    advice = robot.drive(one, 0.0, 60.0, **other)
    while not advice.turn_now:
        advice = robot.drive(one, 0.0, 30.0, **other)
    return advice


def test_it_has_arrived_where_noisy_positions_are_at_home() -> None:
    rng, one, robot = (
        np.random.default_rng(0),
        companion(),
        Driven(rolling=1.2, health=0.85, every_s=5.0),
    )
    turned(one, robot)
    while robot.xy[0] > 0.5:
        robot.every_s = 5.0 if robot.xy[0] > 200.0 else 1.0
        here = robot.xy - (robot.every_s, 0.0) + rng.normal(scale=1.5, size=2)
        back = robot.drive(one, HOME, robot.every_s, position=tuple(here))
        assert back.turn_now or robot.xy[0] < 12.0, robot.xy
    stood = [one.update(robot.time_s + k, speed_mps=0.0, power_w=20.0, position=tuple(rng.normal(scale=1.5, size=2)))
             for k in range(1, 60)]  # fmt: skip
    assert (
        not any(advice.turn_now for advice in stood)
        and max(advice.way_home_m for advice in stood) < POSITION_M
    )
    assert stood[-1].warnings == ()  # noise is not absurd


def test_a_robot_that_cannot_come_back_is_told_before_it_leaves() -> None:
    robot = Driven(health=0.02)
    weak = Companion(HUSKY, home=(0.0, 0.0), soc=0.02)
    ready = weak.update(0.0, speed_mps=0.0, position=(0.0, 0.0))
    assert ready.turn_now and ready.turn_in_m == 0.0
    stays = "do not leave home: at a risk of 0.001 the robot may not come back"
    assert stays in ready.warnings
    near = robot.drive(weak, 0.0, 3.0)
    assert near.turn_now and near.way_home_m < POSITION_M
    away = robot.drive(weak, 0.0, 10.0)
    assert away.turn_now and away.way_home_m > POSITION_M and stays not in away.warnings
    back = robot.drive(weak, HOME, 13.0)
    assert back.way_home_m < POSITION_M and not back.turn_now  # who comes home has arrived
    weak.charged(0.02)
    again = robot.drive(weak, 0.0, 1.0)
    assert again.turn_now


@pytest.mark.parametrize("told", ["home", "way"])
def test_who_is_out_comes_home_also_where_home_or_the_way_there_becomes_another(told: str) -> None:
    """A base that moves tells its place again and again."""
    weak, robot = Companion(HUSKY, home=(0.0, 0.0), soc=0.02), Driven(health=0.02)
    assert robot.drive(weak, 0.0, 20.0).turn_now
    if told == "home":
        weak.move_home((robot.xy[0] - 2.0, 0.0))
    else:
        weak.take_home(route([0.0] * 2, 2.0))
    near = robot.drive(weak, HOME, 1.0)
    assert near.way_home_m < POSITION_M and not near.turn_now


def test_who_is_charged_at_home_before_it_leaves_may_leave() -> None:
    """Nobody tells of the charge: power that flows into the battery does."""
    full_j = HUSKY.usable_energy_j
    waits = Companion(HUSKY, home=(0.0, 0.0))
    empty = waits.update(0.0, speed_mps=0.0, power_w=30.0, soc=0.05, position=(0.0, 0.0))
    assert empty.turn_now
    for minute in range(1, 61):
        charge = 0.05 + 0.9 * minute / 60.0
        charged = waits.update(
            60.0 * minute,
            speed_mps=0.0,
            power_w=-0.9 * full_j / 3600.0,
            soc=charge,
            position=(0.0, 0.0),
        )
    assert charged.energy_left_j.mean > 0.7 * full_j and not charged.turn_now


@pytest.mark.parametrize(
    ("temperature_c", "hours", "turns"), [(-5.0, 0.8, True), (25.0, 3.0, False)]
)
def test_a_load_that_a_full_cold_battery_may_not_stand_is_told_before_it_leaves(
    temperature_c: float, hours: float, turns: bool
) -> None:
    """Of cells of unknown chemistry whose voltage nobody reads."""
    small = dataclasses.replace(HUSKY, rated_energy_j=150.0 * 3600.0 * hours)
    companion = Companion(small, home=(0.0, 0.0), soc=1.0)
    for second in range(120):
        advice = companion.update(
            float(second),
            speed_mps=0.5,
            power_w=150.0,
            position=(0.5 * second, 0.0),
            temperature_c=temperature_c,
        )
        assert advice.turn_now is turns
    assert any("may fall to the cut-off" in text for text in advice.warnings) is turns


def test_who_reckons_its_way_does_not_know_that_it_has_arrived() -> None:
    one, robot = companion(), Driven(every_s=5.0, rolling=1.2, health=0.85)
    turned(one, robot, position=None)
    back = robot.drive(one, HOME, robot.xy[0], position=None)
    # it does not know of the way to its first reading
    assert back.way_home_m < 6.0 and back.turn_now
    assert not robot.drive(one, HOME, 5.0).turn_now  # a position says it


def test_the_way_home_follows_the_trail_and_short_cuts_of_it() -> None:
    one, robot = companion(), Driven()
    robot.drive(one, 0.0, 300.0)
    assert robot.drive(one, 0.5 * math.pi, 300.0).way_home_m == pytest.approx(600.0, rel=0.02)
    robot.drive(one, math.pi, 300.0)
    closing = robot.drive(one, -0.5 * math.pi, 299.0)  # a square: it is back at home
    assert closing.way_home_m == pytest.approx(1.0, abs=0.5)
    out = robot.drive(one, 0.0, 500.0)
    back = robot.drive(one, HOME, 200.0)
    assert back.way_home_m == pytest.approx(out.way_home_m - 200.0, rel=0.01)
    takes_j = robot.power_w() * back.way_home_m
    assert back.energy_home_j.low < takes_j < back.energy_home_j.high


def test_it_takes_an_update_of_any_rate_alike() -> None:
    slow, fast = companion(), companion()
    by_minute = Driven(every_s=30.0, rolling=1.1).drive(slow, 0.0, 150.0)
    by_tenth = Driven(every_s=0.1, rolling=1.1).drive(fast, 0.0, 150.0)
    assert by_tenth.energy_home_j.mean == pytest.approx(by_minute.energy_home_j.mean, rel=0.01)
    assert by_tenth.energy_home_j.sd == pytest.approx(by_minute.energy_home_j.sd, rel=0.1)


def test_memory_is_bounded() -> None:
    one, robot = companion(), Driven()
    sizes = []
    for _ in range(3):
        robot.drive(one, 0.3, 100.0)
        robot.drive(one, 0.3 + math.pi, 100.0)
        sizes.append(len(json.dumps(one.state())))
    assert max(sizes) < 120_000 and sizes[-1] < 1.2 * sizes[0]


def test_it_imports_no_learning_library() -> None:
    code = (
        "import sys, homeward.companion, homeward.agents.onboard; "
        "print([name for name in ('torch', 'pandas', 'plotly') if name in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True
    )
    assert (run.returncode, run.stdout.strip()) == (0, "[]"), run.stdout + run.stderr


def test_generic_ranges_are_those_of_uncertain_missions() -> None:
    expected = prior_of(known_env_of(Options("OutAndBack", difficulty="uncertain")), 0.2)
    ours = known_of(load_robot("husky"), has_forecast=True).prior
    # Routes of the environments are as even as their maps, states of charge have no lasting error,
    # slopes no tilt, and their robots are what the model says.
    for name in set(expected._fields) - {
        "slope_within_place",
        "soc_error",
        "slope_offset",
        "model_error",
    }:
        assert getattr(ours, name) == pytest.approx(getattr(expected, name), rel=5e-3), name


def sd_of(**other: Any) -> Advice:
    one, robot = companion(), Driven(every_s=5.0)
    robot.drive(one, 0.0, 900.0)
    return robot.drive(one, 0.0, 300.0, **other)


def test_what_is_missing_widens_and_is_said() -> None:
    whole = sd_of()
    assert whole.warnings == ()
    for silent, words in (("power_w", "no power"), ("position", "no position")):
        lacking = sd_of(**{silent: None})
        assert lacking.energy_home_j.sd > 1.002 * whole.energy_home_j.sd, silent
        assert any(one.startswith(words) for one in lacking.warnings), lacking.warnings
    nothing, robot = companion(), Driven(every_s=5.0)
    robot.drive(nothing, 0.0, 900.0)
    later = nothing.update(robot.time_s + 300.0)
    assert later.energy_home_j.sd > 1.02 * whole.energy_home_j.sd
    assert later.way_home_m > 900.0  # it is taken to have gone on
    assert "no reading for 300 s" in later.warnings


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("power_w", 1e6),
        ("speed_mps", 40.0),
        ("soc", 87.0),
        ("grade_rad", 5.7),
        ("position", (1e5, 0.0)),
    ],
)
def test_absurd_readings_are_left_out_and_said(name: str, value: Any) -> None:
    one, robot = companion(), Driven(every_s=5.0)
    before = robot.drive(one, 0.0, 900.0)
    robot.every_s = 1.0
    after = robot.drive(one, 0.0, 3.0, **{name: value})
    assert after.way_home_m == pytest.approx(before.way_home_m + 3.0, abs=1.0)
    assert after.energy_left_j.mean == pytest.approx(before.energy_left_j.mean, rel=0.01)
    assert any(one.startswith(f"impossible {name} left out") for one in after.warnings), (
        after.warnings
    )


def test_repeated_and_late_readings_count_once_and_a_clock_set_back_goes_on() -> None:
    one, robot = companion(), Driven(every_s=5.0)
    before = robot.drive(one, 0.0, 900.0)
    again = one.update(900.0, **robot.reads(0.0))
    late = one.update(890.0, **robot.reads(0.0))
    assert again.energy_left_j == late.energy_left_j == before.energy_left_j
    assert any("repeated" in text for text in again.warnings) and any(
        "late" in text for text in late.warnings
    )
    robot.time_s = 100.0  # the clock was set back
    after = robot.drive(one, 0.0, 60.0)
    assert after.way_home_m == pytest.approx(960.0, abs=1.0)
    assert any("clock was set back" in text for text in after.warnings)
    assert after.energy_home_j.low < robot.power_w() * 960.0 < after.energy_home_j.high


def test_without_power_the_state_of_charge_tells() -> None:
    one, robot = companion(), Driven(every_s=5.0, rolling=1.25)
    advice = robot.drive(one, 0.0, 3000.0, power_w=None)
    assert advice.energy_home_j.low < robot.power_w() * 3000.0 < advice.energy_home_j.high
    assert "no power: energy from the model and the state of charge" in advice.rests_on


def test_voltage_times_current_is_power() -> None:
    watts, amps = companion(), companion()
    by_power = Driven(every_s=5.0).drive(watts, 0.0, 600.0)
    robot = Driven(every_s=5.0)
    by_current = robot.drive(
        amps, 0.0, 600.0, power_w=None, voltage_v=24.0, current_a=robot.power_w() / 24.0
    )
    # The first window ends with the first voltage.
    assert by_current.energy_home_j.mean == pytest.approx(by_power.energy_home_j.mean, rel=1e-3)


def test_a_swapped_battery_is_full_again_and_unlatches() -> None:
    one, robot = companion(), Driven(every_s=5.0, health=0.8)
    advice = robot.drive(one, 0.0, 60.0)
    while not advice.turn_now:
        advice = robot.drive(one, 0.0, 30.0)
    cost_j = advice.energy_home_j.mean
    one.swap_battery()
    robot.used_j = 0.0
    after = robot.drive(one, 0.0, 30.0)
    assert not after.turn_now
    assert after.energy_left_j.low < robot.full_j < after.energy_left_j.high * 1.02
    # of the robot it forgets nothing
    assert after.energy_home_j.mean == pytest.approx(cost_j, rel=0.05)


def test_a_battery_that_is_not_full_at_the_start() -> None:
    one, robot = companion(), Driven(every_s=5.0)
    robot.used_j = 0.6 * robot.full_j
    advice = robot.drive(one, 0.0, 600.0)
    assert advice.energy_left_j.low < robot.left_j < advice.energy_left_j.high
    assert (
        companion(soc=0.4).update(0.0, position=(0.0, 0.0)).energy_left_j.mean < 0.5 * robot.full_j
    )


def test_home_that_moves() -> None:
    one, robot = companion(), Driven()
    at_home = robot.drive(one, 0.0, 1000.0).energy_home_j.mean
    one.move_home((800.0, 0.0))
    nearer = robot.drive(one, 0.0, 1.0)
    assert nearer.way_home_m == pytest.approx(201.0, abs=9.0)
    assert nearer.energy_home_j.mean == pytest.approx(0.2 * at_home, rel=0.1)
    one.move_home((1001.0, 300.0))
    beside = robot.drive(one, 0.0, 1.0)
    assert beside.way_home_m == pytest.approx(1.3 * 300.0, rel=0.05)
    assert any("home has moved" in text for text in beside.rests_on)
    one.take_home(None)
    assert robot.drive(one, 0.0, 1.0).way_home_m == pytest.approx(1003.0, abs=1.0)
    one.move_home((400.0, 30.0))  # back along the trail, which has no detour, and then aside
    assert robot.drive(one, 0.0, 1.0).way_home_m == pytest.approx(604.0 + 1.3 * 30.0, abs=16.0)
    ahead = companion(home=None)
    ahead.update(0.0, position=100.0)
    ahead.move_home(350.0)
    assert ahead.update(1.0, position=100.0, speed_mps=0.0).way_home_m == pytest.approx(250.0)


@pytest.mark.parametrize("number", [int, np.int64, np.float32])
def test_the_way_to_a_place_is_the_same_in_numbers_of_any_type(number: Any) -> None:
    driven = companion()
    Driven(every_s=5.0).drive(driven, 0.0, 100.0)
    for place in (40.0, (40.0, 30.0)):
        length_m = driven.way_to(place)["way_m"].sum()
        given: Any = np.array(place, dtype=number)
        if given.ndim == 0:
            given = given[()]  # a number of that type
        assert driven.way_to(given)["way_m"].sum() == length_m > 0.0
    with pytest.raises(CompanionError, match="place = nan is not allowed; give"):
        driven.way_to(math.nan)


def test_of_several_homes_the_nearer_is_advised_and_one_out_of_reach_is_listed() -> None:
    docks = {"hut": (2000.0, 50.0), "bay": (900.0, 0.0), "town": (20_000.0, 0.0)}
    one, robot = companion(docks=docks), Driven(every_s=25.0)
    assert robot.drive(one, 0.0, 300.0).home == "home"
    near_bay = robot.drive(one, 0.0, 700.0)
    assert near_bay.home == "bay" and near_bay.way_home_m == pytest.approx(100.0, abs=9.0)
    assert [other.name for other in near_bay.others] == ["home", "hut", "town"]
    assert [other.reachable for other in near_bay.others] == [True, True, False]
    for other in near_bay.others:
        assert other.margin_j.mean < near_bay.margin_j.mean
        assert other.energy_j.mean + other.margin_j.mean == pytest.approx(
            near_bay.energy_left_j.mean, rel=1e-6
        )
    home, hut, town = near_bay.others
    alone = Driven(every_s=25.0).drive(companion(), 0.0, 1000.0)
    assert (home.way_m, home.energy_j, home.chance) == (
        alone.way_home_m,
        alone.energy_home_j,
        alone.chance_home,
    )
    assert (
        hut.way_m == pytest.approx(1.3 * math.hypot(1000.0, 50.0), rel=0.02) and town.chance < 0.01
    )
    assert any(
        "the way to the dock leads along the way driven" in text for text in near_bay.rests_on
    )
    assert "; the way to bay, 100 m, consumes" in str(near_bay) and "; town: 24.7 km, 0.00%" in str(
        near_bay
    )
    assert json.loads(json.dumps(near_bay.to_json()))["others"][2]["reachable"] is False
    advice = turned(one, robot)
    assert advice.home == "hut" and robot.xy[0] > 4500.0
    assert robot.drive(one, HOME, robot.xy[0] - 2000.0).turn_now
    there = robot.drive(one, math.pi / 2, 50.0)
    assert not there.turn_now and there.way_home_m < POSITION_M and robot.left_j > 0.0


def test_none_in_reach_the_likeliest_is_advised() -> None:
    advice = companion(
        docks={"far": (9000.0, 0.0), "farther": (9900.0, 0.0)}, home=(-9500.0, 0.0), soc=0.5
    ).update(0.0, position=(0.0, 0.0))
    assert advice.home == "home" and advice.turn_now
    assert [(other.name, other.reachable) for other in advice.others] == [
        ("far", False),
        ("farther", False),
    ]
    assert advice.chance_home > advice.others[0].chance > advice.others[1].chance


def test_a_dock_ahead_on_a_route_is_reached_over_its_slopes() -> None:
    """By metres and by coordinates alike; a home that has moved ahead had no way at all."""
    by = route([0.0] * 20 + [0.05] * 20)
    one = Companion(
        HUSKY, home=(0.0, 0.0), route=by, docks={"metres": 1500.0, "beside": (1500.0, 30.0)}
    )
    advice = Driven(every_s=5.0).drive(one, 0.0, 500.0)
    options = {other.name: other for other in advice.others}
    assert advice.home == "home"
    assert options["metres"].way_m == pytest.approx(1000.0, abs=6.0)
    corner_m = 950.0 + 1.3 * math.hypot(50.0, 30.0)  # it leaves the route a place early
    assert options["beside"].way_m == pytest.approx(corner_m, abs=6.0)
    climbs_j = HUSKY.mass_kg * 9.81 * 0.05 * 500.0 / HUSKY.traction_efficiency
    flat_j = 2.0 * advice.energy_home_j.mean
    assert options["metres"].energy_j.mean == pytest.approx(flat_j + climbs_j, rel=0.1)
    one.move_home(900.0)
    assert one.update(501.0, position=(501.0, 0.0)).way_home_m == pytest.approx(400.0, abs=9.0)


@pytest.mark.parametrize(
    ("keywords", "said"),
    [
        ({"docks": [(1.0, 2.0)]}, r"docks = \[\(1.0, 2.0\)\] is not allowed; give places by name"),
        ({"docks": {"home": (1.0, 2.0)}}, "a dock named 'home' is not allowed"),
        (
            {"docks": {"bay": 5.0}},
            r"dock 'bay' = 5.0 is not allowed; give \(east, north\) in the frame of home, within",
        ),
        ({"docks": {"bay": "near"}}, "dock 'bay' = 'near' is not allowed; give metres"),
        ({"docks": {"bay": (1e6, 0.0)}}, r"dock 'bay' = \(1000000.0, 0.0\) is not allowed"),
        ({"docks": {"bay": (math.nan, 0.0)}}, "dock 'bay' = .* is not allowed"),
        (
            {"docks": {"bay": (5.0, 0.0)}, "home": None},
            r"give metres from home along the way, 0 to 1.087e\+05",
        ),
        ({"docks": {"bay": -1.0}, "home": None}, "dock 'bay' = -1.0 is not allowed; give metres"),
        ({"docks": {"bay": 2e6}, "home": "here"}, "dock 'bay' = 2000000.0 is not allowed; give"),
    ],
)
def test_docks_that_cannot_be_are_refused_in_one_line(keywords: dict[str, Any], said: str) -> None:
    with pytest.raises(CompanionError, match=said) as refused:
        companion(**keywords)
    assert "\n" not in str(refused.value)


def test_after_a_charge_on_the_way_the_mission_goes_on() -> None:
    """What is known of robot, ground and battery stays; an hour at the charger consumes nothing,
    and nothing rises."""
    one, robot = companion(soc=1.0), Driven(rolling=1.2, health=0.85, every_s=25.0)
    before = robot.drive(one, 0.0, 3000.0)
    one.charged(0.9)
    state = json.loads(json.dumps(one.state()))
    robot.used_j = robot.full_j - 0.9 * robot.full_j
    robot.time_s += 3600.0
    after = robot.drive(one, 0.0, 25.0)
    restored = companion(soc=1.0)
    restored.restore(state)
    assert restored.update(robot.time_s, **robot.reads(0.0)) == after
    assert after.time_s == before.time_s + 3625.0 and after.way_home_m == pytest.approx(
        3025.0, abs=13.0
    )
    assert after.energy_home_j.mean == pytest.approx(before.energy_home_j.mean, rel=0.01)
    assert after.energy_left_j.low < robot.left_j < after.energy_left_j.high
    elsewhere = companion(soc=1.0)
    elsewhere.restore(state)
    away = elsewhere.update(
        robot.time_s, **robot.reads(0.0) | {"position": (2000.0, 0.0), "speed_mps": None}
    )
    assert (
        away.way_home_m == pytest.approx(2000.0, abs=9.0)
        and away.energy_left_j == after.energy_left_j
    )
    swapped = companion(soc=1.0)
    Driven(rolling=1.2, health=0.85, every_s=25.0).drive(swapped, 0.0, 3000.0)
    swapped.swap_battery(0.9)
    dropped = swapped.update(3625.0, **robot.reads(0.0))
    assert after.energy_left_j.sd < 0.8 * dropped.energy_left_j.sd
    assert not any(
        "clock" in text or "no reading" in text or "rises" in text for text in after.warnings
    )
    left_j = after.energy_left_j.mean
    for _ in range(20):
        advice = robot.drive(one, 0.0, 75.0)
        assert advice.energy_left_j.mean < left_j and advice.warnings == ()
        left_j = advice.energy_left_j.mean
    fuller = robot.drive(one, 0.0, 75.0, soc=0.95)  # nobody charged it again
    assert fuller.energy_left_j.mean < left_j + 0.01 * robot.full_j or any(
        "rises" in text for text in fuller.warnings
    )


def test_a_gauge_that_rose_at_the_charger_is_believed_afterwards() -> None:
    one, robot = companion(soc=1.0), Driven(every_s=30.0)
    robot.drive(one, 0.0, 3000.0)
    for soc in np.linspace(robot.charge(), 0.95, 20):
        robot.time_s += 60.0
        docked = one.update(robot.time_s, speed_mps=0.0, soc=float(soc))
    assert any("the state of charge has jumped" in text for text in docked.warnings)
    one.charged(0.95)
    robot.used_j = 0.05 * robot.full_j
    robot.drive(one, 0.0, 90.0)
    later = [robot.drive(one, 0.0, 60.0) for _ in range(8)]
    assert all(advice.warnings == () for advice in later)
    assert later[-1].energy_left_j.low < robot.left_j < later[-1].energy_left_j.high


def test_a_charge_that_was_told_before_the_first_reading_counts() -> None:
    for event in (Companion.charged, Companion.swap_battery):
        one = companion(soc=1.0)
        event(one, 0.3)
        assert (
            one.update(0.0, position=(0.0, 0.0), soc=0.8).energy_left_j.mean
            < 0.4 * HUSKY.usable_energy_j
        )


def route(sines: Any, place_m: float = 50.0) -> Route:
    grade, nothing = np.arcsin(np.asarray(sines, float)), np.zeros(len(sines))
    return Route(place_m, grade, nothing, nothing, nothing)


def test_of_a_home_that_moved_near_little_is_unsure_for_want_of_positions() -> None:
    one, robot = companion(), Driven(every_s=5.0)
    robot.drive(one, 0.0, 500.0)
    robot.drive(one, 0.0, 2500.0, position=None)
    one.move_home((2900.0, 0.0))
    near = robot.drive(one, 0.0, 5.0, position=None)
    assert near.way_home_m == pytest.approx(105.0, abs=9.0)
    # 250 m that it may be off by, of a way of which a metre takes what it takes on the way out
    assert near.energy_home_j.sd == pytest.approx(250.0 * robot.power_w(), rel=0.2)


def test_another_way_home_is_costed_by_its_slopes_and_grows_shorter() -> None:
    one, robot = companion(), Driven(every_s=5.0)
    flat = robot.drive(one, 0.0, 1000.0)
    one.take_home(route([0.05] * 30))
    robot.every_s = 1.0
    steep = robot.drive(one, 0.0, 1.0)
    r = robot.robot
    climbs_j = r.mass_kg * 9.81 * 0.05 * 1500.0 / r.traction_efficiency
    assert steep.way_home_m == pytest.approx(1500.0, abs=2.0)
    assert steep.energy_home_j.mean == pytest.approx(
        1.5 * flat.energy_home_j.mean + climbs_j, rel=0.1
    )
    assert robot.drive(one, 0.0, 100.0).way_home_m == pytest.approx(1400.0, abs=3.0)


def test_a_route_is_known_ahead() -> None:
    flat = Companion("husky", route=route([0.0] * 60, 100.0))
    hill = Companion("husky", route=route([0.0] * 10 + [0.3] * 50, 100.0))
    ahead = [Driven().drive(one, 0.0, 900.0, position=None) for one in (flat, hill)]
    assert ahead[0].way_home_m == ahead[1].way_home_m == pytest.approx(899.0)
    assert ahead[1].turn_in_m < 0.9 * ahead[0].turn_in_m
    assert ahead[0].chance_there_and_back is not None and ahead[1].chance_there_and_back is not None
    assert ahead[0].chance_there_and_back > ahead[1].chance_there_and_back
    robot = Driven()
    robot.time_s = 900.0
    assert robot.drive(flat, HOME, 300.0, position=None).way_home_m == pytest.approx(599.0)


def test_a_route_that_ends_where_it_begins_is_said() -> None:
    heading = np.linspace(0.0, math.tau, 40, endpoint=False)
    nothing = np.zeros(40)
    loop = Companion("husky", route=Route(50.0, nothing, nothing, nothing, heading))
    straight = Companion("husky", route=route([0.0] * 40))
    assert any("ends where it begins" in text for text in loop.update(0.0, position=0.0).rests_on)
    assert not any(
        "ends where it begins" in text for text in straight.update(0.0, position=0.0).rests_on
    )
    for place in range(40):
        advice = loop.update(
            50.0 * (place + 1), speed_mps=1.0, power_w=150.0, heading_rad=float(heading[place])
        )
    assert advice.way_home_m == pytest.approx(2000.0)  # back along it


def with_curve(*points: tuple[float, float]) -> Robot:
    """A Husky whose file has an open-circuit curve, share of charge and V."""
    return dataclasses.replace(HUSKY, open_circuit_v=points)


def test_a_cut_off_voltage_keeps_energy_in_the_battery() -> None:
    falls = with_curve((0.0, 19.0), (1.0, 25.0))
    free, bound = (
        Companion(falls, home=(0.0, 0.0), soc=1.0, cutoff_v=volts) for volts in (None, 21.0)
    )
    answers = []
    for one in (free, bound):
        robot = Driven(health=0.9, every_s=5.0)
        for _ in range(50):
            advice = robot.drive(one, 0.0, 60.0, soc=None, power_w=None, **electric(robot, falls))
        answers.append(advice)
    # At 6 A and 0.05 Ohm, 21.3 V at rest are left: 38 % of the charge, and 35 % of the energy.
    left = (
        float(energy_share(falls.curve, 1.0) - energy_share(falls.curve, 2.3 / 6.0)) * robot.full_j
        - robot.used_j
    )
    assert answers[1].energy_left_j.low < left < answers[1].energy_left_j.high
    assert answers[1].turn_in_m < answers[0].turn_in_m
    assert answers[1].chance_home <= answers[0].chance_home


def test_a_restart_goes_on_as_if_nothing_had_been(tmp_path: Path) -> None:
    one, robot = companion(), Driven(every_s=5.0, rolling=1.15)
    robot.drive(one, 0.0, 1235.0)
    one.save(tmp_path / "state.json")
    other = companion()
    other.load(tmp_path / "state.json")
    assert other._advise() == one._advise()
    robot.time_s += 60.0  # the robot stood while it restarted
    on = robot.drive(other, 0.0, 300.0)
    assert on.way_home_m == pytest.approx(1535.0, abs=2.0)
    assert on.energy_home_j.low < robot.power_w() * 1535.0 < on.energy_home_j.high


def test_the_state_and_advice_of_a_robot_that_stands_are_for_json() -> None:
    waits, robot = companion(), Driven(every_s=5.0)
    robot.drive(waits, 0.0, 300.0)
    for minute in range(60):
        stands = waits.update(
            robot.time_s + 60.0 * minute, speed_mps=0.0, power_w=30.0, position=(300.0, 0.0)
        )
    assert json.loads(json.dumps(stands.to_json()))["turn_now"] is stands.turn_now
    assert json.loads(json.dumps(waits.state()))["companion"]["_turned"] is stands.turn_now


def test_a_state_with_another_way_home_asks_for_that() -> None:
    one, other, by = companion(), companion(), route([0.05] * 30)
    Driven().drive(one, 0.0, 100.0)
    one.take_home(by)
    state = json.loads(json.dumps(one.state()))
    with pytest.raises(CompanionError, match="takes another way home; pass it as other_way="):
        other.restore(state)
    with pytest.raises(CompanionError, match="is not a route"):
        other.restore(state, "track.gpx")  # type: ignore[arg-type]
    other.restore(state, by)
    assert other._advise() == one._advise()


@pytest.mark.parametrize("content", ["{}", "[]", "nonsense", '{"schema": 1, "robot": "rusti"}'])
def test_a_state_that_cannot_be_used_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "state.json").write_text(content)
    with pytest.raises(CompanionError, match="state"):
        companion().load(tmp_path / "state.json")
    with pytest.raises(CompanionError, match="is a folder; give the file"):
        companion().load(tmp_path)


def test_the_state_of_a_long_and_winding_way_stays_small(tmp_path: Path) -> None:
    one = Companion("husky", home="here")
    for step in range(1500):
        one.update(20.0 * step, speed_mps=0.9, heading_rad=0.01 * step % 6.0, power_w=100.0)
    one.save(tmp_path / "state.json")
    assert 1_000 < (tmp_path / "state.json").stat().st_size < 200_000


def test_home_may_be_a_point() -> None:
    """The default of 5 m is for receivers; dead reckoning of a metre has no such error."""
    one, robot = companion(arrived_m=0.0), Driven(every_s=5.0)
    robot.drive(one, 0.0, 100.0)
    assert robot.drive(one, HOME, 95.0).way_home_m > 0.0


@pytest.mark.parametrize(
    ("keywords", "said"),
    [
        ({"risk": 0.0}, "risk = 0.0"), ({"soc": 87.0}, "soc = 87.0"), ({"home": "there"}, "home = 'there'"),
        ({"cruise_mps": 99.0}, "cruise_mps"), ({"window_s": -1.0}, "window_s"), ({"risk": "small"}, "risk = 'small'"),
        ({"home": (1.0,)}, r"home = \(1.0,\)"), ({"home": 3.0}, "home = 3.0"), ({"cutoff_v": 48.0}, "cutoff_v = 48.0"),
        ({"forecast_mps": 5.0}, "forecast_mps = 5.0"), ({"forecast_mps": (300.0, 0.0)}, "forecast_mps = .* in m/s"),
        ({"route": "track.gpx"}, "route = 'track.gpx' is not a route"),
    ],
)  # fmt: skip
def test_arguments_that_cannot_be_used(keywords: dict[str, Any], said: str) -> None:
    with pytest.raises(CompanionError, match=said):
        companion(**keywords)


@pytest.mark.parametrize("home", [(0.0, 0.0), "here", None])
@pytest.mark.parametrize(
    "read", [{"power_w": 60.0}, {"soc": 0.5}, {"power_w": 60.0, "heading_rad": 0.1}, {}]
)
def test_a_robot_whose_motion_is_never_read_is_not_taken_to_be_at_home(
    home: Any, read: dict[str, float]
) -> None:
    one = Companion("husky", home=home)
    advice = one.update(0.0, **read)
    assert advice.warnings == ("neither speed nor position was read yet: assumed to stand",)
    with pytest.raises(
        CompanionError, match=r"neither speed nor position was read in 61 s: give position="
    ):
        for time_s in range(1, 100):
            one.update(float(time_s), **read)


def test_a_speed_that_falls_silent_is_said_where_there_are_no_positions() -> None:
    one = Companion("husky", home="here")
    for time_s in range(600):
        before = one.update(float(time_s), speed_mps=1.0, heading_rad=0.0, power_w=100.0)
    assert before.warnings == ()
    for time_s in range(600, 700):
        after = one.update(float(time_s), power_w=100.0)
    # the safer of both
    assert after.way_home_m == pytest.approx(before.way_home_m + 100.0, abs=2.0)
    assert "neither speed nor position for 100 s: assumed to drive on as before" in after.warnings


def test_no_way_to_know_where_it_is() -> None:
    with pytest.raises(CompanionError, match="no position and no route"):
        one = Companion("husky")
        one.update(0.0, speed_mps=1.0)
        one.update(1.0, speed_mps=1.0)
    with pytest.raises(CompanionError, match="home was not set"):
        Companion("husky").update(0.0, position=(3.0, 4.0))
    with pytest.raises(CompanionError, match="power_w = 'much' is not a number"):
        companion().update(0.0, power_w="much")  # type: ignore[arg-type]
    with pytest.raises(CompanionError, match="position"):
        companion().update(0.0, position=(1.0, 2.0, 3.0))  # type: ignore[arg-type]


@pytest.mark.parametrize("soc", [80.0, "full", math.nan])
def test_a_battery_home_or_way_that_cannot_be_is_refused(soc: Any) -> None:
    one = companion()
    with pytest.raises(CompanionError, match=f"soc = {soc!r} is not allowed"):
        one.swap_battery(soc)
    with pytest.raises(CompanionError, match=f"soc = {soc!r} is not allowed"):
        one.charged(soc)
    with pytest.raises(CompanionError, match=r"home = \(1.0, 2.0, 3.0\) is not allowed"):
        one.move_home((1.0, 2.0, 3.0))  # type: ignore[arg-type]
    with pytest.raises(CompanionError, match="home = None is not allowed"):
        one.move_home(None)  # type: ignore[arg-type]
    with pytest.raises(CompanionError, match="is not a route"):
        one.take_home("track.gpx")  # type: ignore[arg-type]


def test_positions_in_degrees_are_said() -> None:
    one, robot = companion(home="here"), Driven()
    for _ in range(40):
        advice = robot.drive(one, 0.0, 1.0, position=(8.5 + 1e-5 * robot.xy[0], 47.4))
    assert any(text.startswith("the positions stay within 0.2 m while") for text in advice.warnings)
    assert any("degrees, or spinning wheels?" in text for text in advice.warnings)


def test_positions_that_freeze_are_said_and_the_way_is_reckoned() -> None:
    one, robot = companion(), Driven(every_s=5.0)
    robot.drive(one, 0.0, 500.0)
    frozen = robot.drive(one, 0.0, 500.0, position=(500.0, 0.0))
    assert any(text.startswith("the positions stay within 0.2 m while") for text in frozen.warnings)
    assert frozen.way_home_m == pytest.approx(1000.0, rel=0.05)
    # they are heard again
    assert robot.drive(one, 0.0, 60.0).way_home_m == pytest.approx(1060.0, rel=0.01)


@pytest.mark.parametrize("stops", [True, False])
def test_a_battery_that_is_swapped_untold_for_an_emptier_one_is_believed_and_said(
    stops: bool,
) -> None:
    """If it stood before the reading fell; a gauge that falls on the way is at fault itself."""
    one, robot = companion(), Driven(every_s=5.0)
    robot.drive(one, 0.0, 1000.0)
    if stops:
        robot.drive(one, 0.0, 60.0, speed_mps=0.0, power_w=robot.power_w(0.0), position=None)
    robot.used_j = 0.6 * robot.full_j
    advised = [robot.drive(one, 0.0, 25.0) for _ in range(12)]
    said = [text for advice in advised for text in advice.warnings]
    assert (
        any("less than the energy drawn implies: another battery?" in text for text in said)
        is stops
    )
    left = advised[-1].energy_left_j
    assert (left.low < robot.left_j < left.high) is stops


@pytest.mark.parametrize("positions", [True, False])
def test_a_speed_that_sticks_at_nothing_is_said(positions: bool) -> None:
    one, robot = companion(), Driven(every_s=5.0)
    other = {} if positions else {"position": None}
    robot.drive(one, 0.0, 300.0, **other)
    assert robot.drive(one, 0.0, 100.0, **other).warnings == ()
    stuck = robot.drive(one, 0.0, 300.0, speed_mps=0.0, **other)
    said = next(text for text in stuck.warnings if text.startswith("the speed reads 0 while"))
    assert ("Home may be farther" in said) is not positions
    stands = Driven(every_s=5.0)
    stands.time_s = robot.time_s
    idle = stands.drive(
        companion(), 0.0, 600.0, speed_mps=0.0, power_w=robot.power_w(0.0), position=(0.0, 0.0), soc=None
    )  # fmt: skip
    assert idle.warnings == ()


@pytest.mark.parametrize("health", [0.82, 0.98])
def test_a_coarse_state_of_charge_that_lags_fools_it_little(health: float) -> None:
    """In whole per cents and half a per cent behind, which no file says."""
    one, robot = companion(), Driven(every_s=15.0, health=health)
    for _ in range(150):
        soc = round(robot.left_j / robot.full_j + 0.005, 2)
        left = robot.drive(one, 0.0, 15.0, soc=soc).energy_left_j
        assert abs(left.mean - robot.left_j) < 3.0 * left.sd, robot.time_s


def test_a_state_of_charge_that_sticks_is_said_and_not_believed() -> None:
    one, robot = companion(), Driven(every_s=5.0)
    robot.drive(one, 0.0, 500.0)
    stuck = robot.left_j / robot.full_j
    after = robot.drive(one, 0.0, 3500.0, soc=stuck)
    assert abs(after.energy_left_j.mean - robot.left_j) < 2.0 * after.energy_left_j.sd
    assert after.energy_left_j.mean < 0.9 * stuck * robot.full_j
    assert any(
        "has jumped or stays" in text and "power alone is used" in text for text in after.warnings
    )


@pytest.mark.parametrize("gauge", [None, 0.9])
def test_more_drawn_than_a_battery_can_hold_is_said_and_widens_what_is_left(
    gauge: float | None,
) -> None:
    """Without a gauge, and with one that is stuck."""
    one, robot = companion(), Driven(every_s=25.0)
    robot.drive(one, 0.0, 25.0, soc=gauge)
    before = None
    while robot.used_j < 1.2 * robot.full_j:
        left = robot.drive(one, 0.0, 250.0, soc=gauge).energy_left_j
        if robot.left_j > 0.0:
            before = left
    assert before is not None
    advice = robot.drive(one, 0.0, 25.0, soc=gauge)
    left = advice.energy_left_j
    assert any(
        text.startswith("more was drawn than this battery can hold") for text in advice.warnings
    )
    assert left.mean <= before.high
    assert left.high > before.high + 0.2 * robot.full_j
    assert advice.turn_now
    one.swap_battery()
    swapped = robot.drive(one, 0.0, 75.0, soc=None)
    assert not any("more was drawn" in text for text in swapped.warnings)


def test_without_a_meter_it_is_the_model_that_may_consume_too_much() -> None:
    one, robot = companion(), Driven(every_s=50.0)
    while robot.used_j < 1.6 * robot.full_j:
        advice = robot.drive(one, 0.0, 500.0, soc=None, power_w=None)
    assert any("another one, or the model consumes too much?" in text for text in advice.warnings)


def test_a_battery_that_is_emptied_to_its_end_is_no_other_one() -> None:
    one, robot = companion(), Driven(every_s=25.0, health=0.97)
    while robot.left_j > 0.01 * robot.full_j:
        advice = robot.drive(one, 0.0, 25.0)
        assert advice.warnings == ()


def test_a_wind_that_turns_against_the_way_home_is_allowed_for() -> None:
    """Of 1.5 m/s, the standard deviation of what the companion expects of a wind that nobody
    forecast."""
    one, robot = Companion(HUSKY, home=(0.0, 0.0)), Driven(every_s=5.0)
    drag = robot.robot.drag_ns2_per_m2 / (
        (1.0 - robot.robot.motor_loss) * (1.0 - robot.robot.friction_loss)
    )
    calm_w = robot.power_w()
    # it helps on the way out
    out = robot.drive(one, 0.0, 1500.0, power_w=calm_w + drag * (0.5**2 - 1.0))
    home_j = (calm_w + drag * (2.5**2 - 1.0)) * out.way_home_m  # and hurts on the way home
    assert out.energy_home_j.low < home_j < out.energy_home_j.quantile(0.999)


def electric(robot: Driven, file: Robot) -> dict[str, float]:
    """Voltage and current of a battery with 0.05 Ohm and the curve of its file."""
    rest_v = float(
        open_circuit_v(file.curve, charge_share(file.curve, robot.left_j / robot.full_j))
    )
    current_a = robot.power_w() / (rest_v - 0.3)
    return {"voltage_v": rest_v - 0.05 * current_a, "current_a": current_a}


def test_a_cut_off_that_comes_early_turns_the_robot() -> None:
    """From half on the voltage falls off a knee, three times as steep as before."""
    knee = with_curve((0.0, 19.0), (0.5, 23.5), (1.0, 25.0))
    one, robot = Companion(knee, home=(0.0, 0.0), cutoff_v=21.3), Driven(every_s=10.0)
    advice = robot.drive(one, 0.0, 10.0)
    while robot.left_j > 0.0 and not advice.turn_now:
        charge = float(charge_share(knee.curve, robot.left_j / robot.full_j))
        advice = robot.drive(one, 0.0, 10.0, power_w=None, soc=charge, **electric(robot, knee))
    robot.used_j += robot.power_w() * robot.xy[0]
    assert electric(robot, knee)["voltage_v"] > 21.3  # home before the cut-off


@pytest.mark.parametrize("offset_rad", [-0.0035, 0.0035])
def test_a_slope_sensor_that_is_mounted_at_a_tilt_is_allowed_for(offset_rad: float) -> None:
    """The way home is level, as the way out was, though that was read as a slope."""
    one, robot = companion(), Driven(every_s=5.0)
    advice = robot.drive(one, 0.0, 2000.0, grade_rad=offset_rad)
    assert advice.energy_home_j.low < robot.power_w() * 2000.0 < advice.energy_home_j.high


def test_a_clock_that_is_set_forward_by_an_hour_draws_no_energy() -> None:
    one, robot = companion(), Driven(every_s=5.0)
    robot.drive(one, 0.0, 1000.0)
    robot.time_s += 3600.0
    advice = robot.drive(one, 0.0, 30.0)
    assert any(text.startswith("the clock was set forward") for text in advice.warnings)
    assert advice.energy_left_j.low < robot.left_j < advice.energy_left_j.high


def test_instruments_whose_first_readings_come_one_by_one() -> None:
    """The gauge's first reading says how full the battery is, the first temperature how cold,
    whenever they come."""
    at_once, later = (companion() for _ in range(2))
    for second in range(300):
        soc, temperature_c = 0.6 - second / 11_520, -5.0
        moves = {"speed_mps": 1.0, "power_w": 150.0, "heading_rad": 0.0}
        together = at_once.update(float(second), soc=soc, temperature_c=temperature_c, **moves)
        lacking = {
            "soc": None if second < 5 else soc,
            "temperature_c": None if second < 9 else temperature_c,
        }
        apart = later.update(float(second), **moves, **lacking)
    assert apart.energy_left_j.mean == pytest.approx(together.energy_left_j.mean, rel=0.02)
    assert apart.warnings == together.warnings == ()


def test_what_is_assumed_of_cells_slopes_and_positions_is_said() -> None:
    cold, robot = companion(), Driven(every_s=5.0)
    rests_on = robot.drive(cold, 0.0, 60.0, temperature_c=-5.0).rests_on
    assert (
        "cells of unknown chemistry, at -5 C, at 0.33 charges an hour: 70% to 100% of the label"
        in rests_on
    )
    assert (
        "slopes from a sensor that is mounted within 0.2 degrees, one standard deviation"
        in rests_on
    )
    assert "positions filtered by speed and heading, which takes their noise away" in rests_on
    unsaid = (
        Driven(every_s=5.0).drive(companion(), 0.0, 60.0, grade_rad=None, position=None).rests_on
    )
    assert any("warm, as no temperature was read" in text for text in unsaid)
    assert not any(text.startswith(("slopes from", "positions filtered")) for text in unsaid)


def test_a_voltage_tells_the_charge_also_beside_a_power_and_without_either() -> None:
    """A current that is not read follows from the power, and that from the model."""
    falls = with_curve((0.0, 19.0), (1.0, 25.0))
    deviations = []
    for silent in ((), ("current_a",), ("current_a", "power_w"), ("current_a", "voltage_v")):
        one, robot = Companion(falls, home=(0.0, 0.0), soc=1.0), Driven(health=0.85, every_s=10.0)
        for _ in range(60):
            read = {**electric(robot, falls), "power_w": robot.power_w()}
            advice = robot.drive(one, 0.0, 60.0, soc=None, **{**read, **dict.fromkeys(silent)})
        deviations.append(advice.energy_left_j.sd)
        if "power_w" not in silent:
            assert advice.energy_left_j.low < robot.left_j < advice.energy_left_j.high
    with_current, with_power, with_model, without = deviations
    assert with_current == pytest.approx(with_power, rel=0.01)
    assert with_power < 0.95 * without and with_model > with_power


def test_at_its_cut_off_voltage_nothing_is_left() -> None:
    """Also of a robot whose file has no curve."""
    one, robot = companion(cutoff_v=21.0), Driven(every_s=10.0)
    before = robot.drive(one, 0.0, 600.0, voltage_v=22.0, current_a=6.0)
    after = robot.drive(one, 0.0, 100.0, voltage_v=20.9, current_a=6.0)
    assert before.energy_left_j.mean > 0.5 * robot.full_j and not before.turn_now
    assert after.energy_left_j.mean < 0.05 * robot.full_j and after.turn_now


def test_advice_can_be_written_as_json_and_read_by_people() -> None:
    advice = Driven().drive(companion(), 0.0, 60.0)
    assert (
        json.loads(json.dumps(advice.to_json()))["energy_left_j"]["mean"]
        == advice.energy_left_j.mean
    )
    assert "the way home, 60 m, consumes" in str(advice) and "turn within" in str(advice)


def test_a_robot_file_that_says_how_sure_it_is() -> None:
    husky = load_robot("husky")

    def of(**sizes: Any) -> Advice:
        sure = Uncertainty(source="a test", **sizes)
        return Driven().drive(
            Companion(dataclasses.replace(husky, uncertainty=sure), home=(0.0, 0.0)), 0.0, 120.0
        )

    known: dict[str, Any] = {
        "fitted": ("rolling", "mass"), "covariance": ((1e-4, 0.0), (0.0, 1e-4)), "between_runs": 0.0
    }  # fmt: skip
    narrow, uneven = of(**known), of(**known, unexplained=0.5, unexplained_m=30.0)
    differs = of(**(known | {"between_runs": 0.2}))
    generic = Driven().drive(companion(), 0.0, 120.0)
    charge = of(of="charge", **known)
    assert charge.energy_home_j == generic.energy_home_j and any(
        "generic" in text for text in charge.rests_on
    )
    one_run = of(**(known | {"between_runs": None}))  # how others will differ from it is not known
    assert one_run.energy_home_j.sd > 2.0 * narrow.energy_home_j.sd
    fitted = {
        "fitted": ("rolling", "mass", "drag"),
        "covariance": tuple(map(tuple, (1e-4 * np.eye(3)).tolist())),
    }
    # which no air makes of a robot of 50 kg
    heavy = dataclasses.replace(husky, drag_ns2_per_m2=5.0)
    still, windy = (
        known_of(
            dataclasses.replace(heavy, uncertainty=Uncertainty(**sizes)), False
        ).prior.wind_sd_mps
        for sizes in (fitted, known)
    )
    assert still < 0.2 * windy
    assert narrow.energy_home_j.sd < generic.energy_home_j.sd
    assert uneven.energy_home_j.sd > 2.0 * narrow.energy_home_j.sd
    assert differs.energy_home_j.sd > narrow.energy_home_j.sd
    # nothing fitted
    assert of(between_runs=0.4).energy_home_j.sd > of(between_runs=0.1).energy_home_j.sd
    assert any("uncertainty from the robot's file: a test" in text for text in narrow.rests_on)
    assert any("generic ranges" in text for text in generic.rests_on)


def test_a_cut_off_is_that_of_the_file_unless_another_is_given() -> None:
    falls = with_curve((0.0, 19.0), (1.0, 25.0))
    stated = dataclasses.replace(falls, cutoff_v=21.0)
    left, words = {}, {}
    for name, robot, cutoff_v in (
        ("given", falls, 21.0),
        ("file", stated, None),
        ("other", stated, 20.0),
        ("usual", falls, None),
    ):
        advised = Companion(robot, home=(0.0, 0.0), soc=1.0, cutoff_v=cutoff_v)
        drives = Driven()
        advice = drives.drive(advised, 0.0, 60.0, soc=None, power_w=None, **electric(drives, falls))
        left[name] = advice.energy_left_j.mean
        words[name] = " ".join(advice.rests_on)
    # The file's cut-off also shortens the range, and so the time over which readings are averaged.
    assert left["file"] == pytest.approx(left["given"], rel=0.01)
    assert left["file"] < 0.95 * left["other"] and left["other"] < 0.95 * left["usual"]
    assert "cut-off voltage under load (given)" in words["given"] and "(given)" in words["other"]
    assert "cut-off voltage under load (the robot file's)" in words["file"]
    assert "none was given" in words["usual"]


def test_a_battery_that_is_cut_off_at_once_is_refused() -> None:
    weak = dataclasses.replace(
        with_curve((0.0, 19.0), (1.0, 25.0)),
        cutoff_v=24.9,
        effects={"internal_resistance": {"ohm": 1.0}},
    )
    with pytest.raises(CompanionError, match="'husky' is cut off at once on level ground"):
        Companion(weak, home="here")
