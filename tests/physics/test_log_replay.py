"""Replay of a recorded drive: the same physics as the step, sample by sample, at millions of
samples a second."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward import Robot
from homeward.physics import CAUSES, ancillary_power, mission_energy, replay, traction_force
from homeward.physics.model import drive_power
from tests.physics.drives import (
    FALLING,
    PLAIN,
    STEADY,
    conditions,
    cut_off,
    drive,
    robots,
    with_effect,
)

TIME_S = np.arange(5.0)


@given(data=st.data(), robot=robots())
def test_replay_is_the_step_sample_by_sample(data: st.DataObject, robot: Robot) -> None:
    steps = data.draw(st.lists(conditions(robot), min_size=2, max_size=6))
    dt_s = data.draw(
        st.lists(st.floats(0.01, 100.0), min_size=len(steps) - 1, max_size=len(steps) - 1)
    )
    time_s = np.concatenate([[0.0], np.cumsum(dt_s)])
    held = [*np.diff(time_s), time_s[-1] - time_s[-2]]
    channels: dict[str, Any] = {
        name: np.array([getattr(x, name) for x in steps])
        for name in STEADY._fields
        if name not in ("sin_grade", "cos_grade")
    }
    grade_rad = np.array([math.atan2(x.sin_grade, x.cos_grade) for x in steps])
    again = replay(robot, time_s, grade_rad=grade_rad, **channels)
    end = drive(robot, steps, held, np.inf, speed_mps=steps[0].speed_mps)
    assert list(again.energy_j) == list(CAUSES)
    np.testing.assert_allclose(list(again.energy_j.values()), end["ledger_j"], rtol=1e-9, atol=1e-9)
    assert again.power_w @ held == pytest.approx(sum(again.energy_j.values()), rel=1e-6, abs=1e-6)
    assert again.power_w[-1] == pytest.approx(float(end["power_w"]), rel=1e-9)


def test_power_is_that_of_the_equations() -> None:
    speed_mps, grade_rad = (
        np.array([0.0, 1.0, 2.0, 2.0, 3.0]),
        np.array([0.3, 0.0, 0.2, -0.4, -0.05]),
    )
    again = replay(PLAIN, TIME_S, speed_mps, grade_rad=grade_rad, sensing_hz=20.0)
    force_n = np.where(speed_mps > 0.0, traction_force(PLAIN, speed_mps, grade_rad), 0.0)
    np.testing.assert_allclose(again.traction_n, force_n, rtol=1e-12)
    np.testing.assert_allclose(again.drive_w, drive_power(PLAIN, force_n, speed_mps), rtol=1e-12)
    np.testing.assert_allclose(
        again.power_w, again.drive_w + ancillary_power(PLAIN, 20.0), rtol=1e-12
    )


def test_energy_is_that_of_eq_7() -> None:
    # the last sample lasts 3 s too
    again = replay(PLAIN, np.array([0.0, 1.0, 4.0]), 2.0, grade_rad=0.1)
    assert sum(again.energy_j.values()) == pytest.approx(
        float(mission_energy(PLAIN, 14.0, 2.0, 0.1)), rel=1e-12
    )


def test_driving_backwards_is_driving_forwards_the_other_way() -> None:
    robot = dataclasses.replace(
        PLAIN, effects={"inertia": {"mass_factor": 1.0}, "hidden_grade": {"slope": 0.05}}
    )
    back = replay(robot, TIME_S, -2.0, grade_rad=0.2, accel_mps2=-0.5)
    there = replay(PLAIN, TIME_S, 2.0, grade_rad=-0.2)
    np.testing.assert_allclose(
        back.traction_n,
        there.traction_n + 10.0 * 0.5 - 10.0 * 9.80665 * 0.05 * math.cos(0.2),
        rtol=1e-12,
    )


def test_speed_alone_tells_the_acceleration() -> None:
    """By central differences: from rest to rest, inertia takes no energy that it does not give
    back."""
    time_s = np.linspace(0.0, 20.0, 41)
    speed_mps = 2.0 * np.sin(np.pi * time_s / 20.0) ** 2
    robot = dataclasses.replace(
        PLAIN,
        rolling_resistance=0.5,
        effects={"inertia": {"mass_factor": 1.0}, "payload": {"mass_kg": 5.0}},
    )
    alone = replay(robot, time_s, speed_mps)
    given = replay(robot, time_s, speed_mps, accel_mps2=np.gradient(speed_mps, time_s))
    steady = replay(robot, time_s, speed_mps, accel_mps2=0.0)
    np.testing.assert_array_equal(alone.power_w, given.power_w)
    assert steady.energy_j["inertia"] == 0.0
    assert (alone.traction_n - steady.traction_n)[10] == pytest.approx(
        15.0 * 0.1 * math.pi, rel=0.01
    )
    assert alone.energy_j["inertia"] == pytest.approx(0.0, abs=1e-9)
    backwards = replay(robot, time_s, -speed_mps)
    np.testing.assert_allclose(backwards.power_w, alone.power_w, rtol=1e-12)


def test_braking_to_slow_down_gives_energy_back() -> None:
    """On the plane: a car that sprints and brakes, as regeneration sees the sum of all forces."""
    time_s = np.arange(0.0, 6.0, 0.5)
    speed_mps = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 4.0, 4.0, 3.0, 2.0, 1.0, 0.0, 0.0])
    inertia, regeneration = {"inertia": {"mass_factor": 1.0}}, {"regeneration": {"share": 0.6}}
    on = replay(dataclasses.replace(PLAIN, effects=inertia | regeneration), time_s, speed_mps)
    off = replay(dataclasses.replace(PLAIN, effects=inertia), time_s, speed_mps)
    rolling = replay(dataclasses.replace(PLAIN, effects=regeneration), time_s, speed_mps)
    braking = on.traction_n < 0.0
    assert list(np.flatnonzero(braking)) == [7, 8, 9]
    np.testing.assert_allclose(
        on.power_w - off.power_w, np.where(braking, 0.6 * on.traction_n * speed_mps, 0.0), atol=1e-9
    )
    assert on.energy_j["regeneration"] == pytest.approx(
        float((0.6 * on.traction_n * speed_mps)[braking].sum() * 0.5)
    )
    assert rolling.energy_j["regeneration"] == 0.0


def test_turning_on_the_spot_shows_as_force_at_the_wheels() -> None:
    robot = with_effect(PLAIN, "turning", scrub=0.3)
    yaw_rate_radps = np.array([0.0, 0.8, -0.8, 0.8, 0.0])
    spot = replay(robot, TIME_S, 0.0, yaw_rate_radps=yaw_rate_radps)
    scrub_n = 0.3 * 10.0 * 9.80665 * (yaw_rate_radps != 0.0)
    np.testing.assert_allclose(spot.wheel_force_n, scrub_n, rtol=1e-12)
    np.testing.assert_allclose(spot.drive_w, scrub_n * 0.5 * 0.8 * 0.5 / 0.5, rtol=1e-12)
    assert (
        not spot.traction_n.any()
        and not replay(PLAIN, TIME_S, 0.0, yaw_rate_radps=0.8).wheel_force_n.any()
    )


def test_the_force_at_the_wheels_is_what_the_drive_pays_for() -> None:
    """P = F v / Gamma, on curves that are wide enough for the robot to be as fast as its outer
    wheels."""
    robot = with_effect(PLAIN, "turning", scrub=0.3)
    grade_rad = np.array([0.0, 0.1, -0.5, -0.5, 0.0])
    again = replay(
        robot, TIME_S, 2.0, grade_rad=grade_rad, yaw_rate_radps=np.array([0.0, 1.0, 0.0, 1.0, -2.0])
    )
    np.testing.assert_allclose(again.drive_w, again.wheel_force_n * 2.0 / 0.5, rtol=1e-12)
    assert again.traction_n[2] < 0.0 == again.wheel_force_n[2] and again.wheel_force_n[3] > 0.0


HOME = [1.0, 1.0, 1.0, -1.0, -1.0]


@pytest.mark.parametrize(
    ("channels", "direction"),
    [
        ({}, [1.0] * 5),
        ({"speed_mps": -2.0}, [-1.0] * 5),
        ({"direction": np.array(HOME)}, HOME),
        ({"direction": -1.0}, [-1.0] * 5),
        ({"direction": np.array(HOME), "speed_mps": -2.0, "base_distance_m": TIME_S}, HOME),
        ({"base_distance_m": np.array([0.0, 2.0, 4.0, 2.0, 0.0])}, [1.0, 1.0, 1.0, -1.0, -1.0]),
        ({"base_distance_m": np.array([0.0, 2.0, 4.0, 3.9, 0.0]), "speed_mps": -2.0}, HOME),
        ({"base_distance_m": np.array([9.0, 9.0, 9.0, 7.0, 7.0])}, [-1.0] * 5),
        ({"base_distance_m": np.array([4.0, 6.0, 6.0, 6.0, 6.0])}, [1.0] * 5),
        ({"base_distance_m": 50.0}, [1.0] * 5),
    ],
)
def test_a_hidden_slope_rises_on_the_way_out_and_falls_on_the_way_home(
    channels: dict[str, Any], direction: list[float]
) -> None:
    """Whichever way round the robot drives; a distance that stands still leaves it on its way."""
    with_slope = replay(
        with_effect(PLAIN, "hidden_grade", slope=0.05), TIME_S, **{"speed_mps": 2.0} | channels
    )
    without = replay(PLAIN, TIME_S, **{"speed_mps": 2.0} | channels)
    slope_n = with_slope.traction_n - without.traction_n
    np.testing.assert_allclose(slope_n, 10.0 * 9.80665 * 0.05 * np.array(direction), rtol=1e-9)


def test_what_moves_at_the_first_sample_did_not_start_there() -> None:
    robot = with_effect(PLAIN, "breakaway", start_j=70.0)
    assert replay(robot, TIME_S, 2.0).energy_j["breakaway"] == 0.0
    assert replay(robot, TIME_S, np.array([0.0, 1.0, 0.0, 1.0, 1.0])).energy_j[
        "breakaway"
    ] == pytest.approx(140.0)


def test_the_battery_of_a_replay_does_not_run_out() -> None:
    again = replay(PLAIN, np.array([0.0, 1e6, 2e6]), 2.0)
    assert sum(again.energy_j.values()) > 100.0 * PLAIN.usable_energy_j


@pytest.mark.parametrize(
    ("time_s", "channels", "expected"),
    [
        ([0.0], {}, "time_s must hold at least two increasing times in seconds"),
        ([], {}, "time_s must hold at least two increasing times in seconds"),
        ([0.0, 0.0], {}, "time_s must hold at least two increasing times in seconds"),
        ([1.0, 0.0], {}, "time_s must hold at least two increasing times in seconds"),
        ([0.0, math.nan], {}, "time_s must hold at least two increasing times in seconds"),
        ([0.0, math.inf], {}, "time_s must hold at least two increasing times in seconds"),
        ([[0.0, 1.0]], {}, "time_s must hold at least two increasing times in seconds"),
        (
            [0.0, 1.0],
            {"grade_rad": np.zeros(3)},
            "grade_rad has shape (3,); allowed: one number or shape (2,), as time_s",
        ),
        (
            [0.0, 1.0],
            {"accel_mps2": np.array([0.0, math.nan])},
            "accel_mps2 = nan at sample 1 is not finite; fill or cut the gap first",
        ),
        (
            [0.0, 1.0],
            {"headwind_mps": math.inf},
            "headwind_mps = inf at sample 0 is not finite; fill or cut the gap first",
        ),
        (
            [0.0, 1.0],
            {"direction": np.array([1.0, 0.5])},
            "direction = 0.5 is not allowed; give 1 on the way out and -1 on the way home",
        ),
    ],
)
def test_recordings_that_cannot_be_replayed(
    time_s: list[float], channels: dict[str, Any], expected: str
) -> None:
    with pytest.raises(ValueError) as error:
        replay(PLAIN, np.array(time_s), 1.0, **channels)
    assert str(error.value) == expected


def test_the_voltage_of_a_replay_falls_with_its_charge_and_the_replay_goes_on_below_empty() -> None:
    """A recording shows that the battery did not run out: below empty it keeps the voltage of an
    empty one."""
    robot = dataclasses.replace(
        with_effect(PLAIN, "internal_resistance", ohm=0.05), open_circuit_v=FALLING
    )
    time_s = np.arange(4000.0)
    again = replay(robot, time_s, 2.0)
    assert (np.diff(again.power_w) >= 0.0).all()
    load_w = float(replay(PLAIN, time_s, 2.0).power_w[0])
    for loss_w, rest_v in ((again.power_w[0] - load_w, 11.5), (again.power_w[-1] - load_w, 8.0)):
        current_a = (rest_v - math.sqrt(rest_v**2 - 4.0 * 0.05 * load_w)) / (2.0 * 0.05)
        assert loss_w == pytest.approx(0.05 * current_a**2, rel=1e-6)
    assert sum(again.energy_j.values()) > 1.1 * robot.usable_energy_j


def test_a_recorded_drive_is_not_cut_off() -> None:
    """It shows that the battery did not end; what the step draws is the same with a cut-off."""
    robot = cut_off(36.0)
    time_s = np.linspace(0.0, 5e3, 501)
    again = replay(robot, time_s, 0.0)
    free = replay(robot.without_cutoff(), time_s, 0.0)
    assert again.energy_j == free.energy_j and again.energy_j["below_cutoff"] == 0.0
    np.testing.assert_array_equal(again.power_w, free.power_w)
    # Until the battery of a drive is cut off, they are the same.
    end = drive(robot, [STEADY._replace(speed_mps=0.0, sensing_hz=0.0)] * 500, 10.0)
    lasts = int(end["time_s"] / 10.0)
    assert 0 < lasts < 500 and end["depleted"]
    drawn_j = 10.0 * again.power_w[:lasts].sum()
    in_last_step_j = again.power_w[lasts] * (float(end["time_s"]) - 10.0 * lasts)
    kept_j = float(end["ledger_j"][CAUSES.index("below_cutoff")])
    assert drawn_j + in_last_step_j + kept_j == pytest.approx(1e5, rel=1e-6)
