"""Channels in one form, and windows that respect gaps."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward import Robot, load_robot
from homeward.diagnosis import Recording
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.read.signals import gaps, signals, windows
from homeward.logs.channels import Array


def run(**channels: np.ndarray) -> Recording:
    return Recording("run", "0", channels)


TIME = np.arange(100) / 10.0


@given(
    steps=st.lists(st.sampled_from([0.1, 0.11, 0.09, 5.0]), min_size=30, max_size=300),
    window_s=st.floats(0.2, 3.0),
)
def test_windows_hold_every_sample_once_and_no_gap(steps: list[float], window_s: float) -> None:
    time_s = np.cumsum(steps)
    cut = windows(time_s, window_s)
    assert cut.start[0] == 0 and (np.diff(cut.start) > 0).all()
    for first, after in zip(cut.start, np.append(cut.start[1:], len(time_s)), strict=True):
        assert time_s[after - 1] - time_s[first] <= window_s + 1e-6
        assert not np.isin(np.arange(first, after - 1), gaps(time_s)).any()


def test_window_means() -> None:
    cut = windows(TIME, 1.0)
    np.testing.assert_allclose(cut.means(TIME), np.arange(10) + 0.45)


def test_wheels_give_speed_and_turning_rate(husky: Robot) -> None:
    left, right = np.full(100, 0.2), np.full(100, 0.6)
    one = run(time_s=TIME, wheel_left_mps=left, wheel_right_mps=right, power_w=left)
    np.testing.assert_allclose(signals(one, husky).speed_mps, 0.4)
    np.testing.assert_allclose(signals(one, husky).yaw_rate_radps, 0.4 / husky.track_m)
    trackless = signals(one, dataclasses.replace(husky, track_m=0.0))
    np.testing.assert_allclose(trackless.context["wheel_difference_mps"], 0.4)
    assert not trackless.yaw_rate_radps.any()


def test_power_is_preferred_and_current_is_a_magnitude(husky: Robot) -> None:
    speed, current = np.full(100, 0.5), np.full(100, -2.0)
    both = run(time_s=TIME, speed_mps=speed, voltage_v=12 + 0 * speed, current_a=speed, motor_left_a=current,
               motor_right_a=current)  # fmt: skip
    assert signals(both, husky).unit == "W"
    np.testing.assert_allclose(signals(both, husky).observed, 6.0)
    only = run(time_s=TIME, speed_mps=speed, motor_left_a=current, motor_right_a=-current)
    assert signals(only, husky).unit == "A"
    np.testing.assert_allclose(signals(only, husky).observed, 4.0)


@pytest.mark.parametrize("slope", [0.05, -0.1])
def test_elevation_gives_the_grade(husky: Robot, slope: float) -> None:
    time_s = np.arange(0.0, 200.0, 0.1)
    speed = np.where(time_s < 100.0, 0.5, 0.0)
    distance = np.concatenate(([0.0], np.cumsum(speed[:-1] * 0.1)))
    noise = 0.005 * np.random.default_rng(0).normal(size=len(time_s))
    one = run(
        time_s=time_s, speed_mps=speed, elevation_m=np.tan(slope) * distance + noise, power_w=speed
    )
    np.testing.assert_allclose(signals(one, husky).grade_rad, slope, atol=0.02)


def test_samples_without_power_are_left_out_and_context_is_filled(husky: Robot) -> None:
    power, grade = np.ones(100), np.linspace(0.0, 0.1, 100)
    power[10:20] = np.nan
    grade[50] = np.nan
    one = signals(run(time_s=TIME, speed_mps=np.ones(100), power_w=power, grade_rad=grade), husky)
    assert len(one.time_s) == 90 and one.filled == ("grade_rad",)
    np.testing.assert_allclose(one.grade_rad[40], grade[49:52:2].mean())


@pytest.mark.parametrize(
    ("sizes_m", "climb", "known"),
    [
        ((0.02,), 0.0, False),
        ((0.2,), 0.0, True),
        ((0.2, 0.02), 0.0, True),
        ((0.02, 0.02), 0.0, False),
        ((0.0,), 0.08, True),  # a steady climb
        ((0.0, 0.0), -0.08, True),
    ],
)
def test_slopes_that_are_smaller_than_their_error_are_unknown(
    sizes_m: tuple[float, ...], climb: float, known: bool
) -> None:
    """Several runs have one instrument, which also shows that ground is flat."""
    rng, time_s = np.random.default_rng(0), np.arange(3000) / 10.0
    recordings = []
    for number, size_m in enumerate(sizes_m):
        elevation_m = size_m * np.sin(time_s / 20.0) + climb * time_s + 0.5 * rng.normal(size=3000)
        one = run(
            time_s=time_s, speed_mps=np.ones(3000), power_w=100.0 + time_s, elevation_m=elevation_m
        )
        recordings.append(dataclasses.replace(one, sha256=str(number)))
    runs, _ = usable_runs(recordings, load_robot("husky"))
    assert {"grade_rad" in one.context for one in runs} == {known}


def test_what_rises_in_a_gap_makes_no_cliff() -> None:
    time_s = np.arange(6000) / 10.0
    recorded = (time_s < 200.0) | (time_s > 230.0)
    climb_m = 2.0 * np.sin(time_s / 30.0) + 0.03 * time_s
    channels = {
        "time_s": time_s,
        "speed_mps": np.ones(6000),
        "power_w": np.ones(6000),
        "elevation_m": climb_m,
    }
    one = signals(
        run(**{name: values[recorded] for name, values in channels.items()}), load_robot("husky")
    )
    slope = 2.0 / 30.0 * np.cos(one.time_s / 30.0) + 0.03
    assert np.max(np.abs(one.grade_rad - np.arctan(slope))[50:-50]) < 0.05  # the kink at the gap


def test_a_start_is_where_a_sensor_that_shows_rest_first_moves(husky: Robot) -> None:
    """Smoothed, the first moment of each start is as slow as a creep: taken for rest, starts would
    come late."""
    time_s = np.linspace(0.0, 299.95, 6000)
    speed: Array = np.clip(0.8 * np.sin(time_s / 5.0), 0.0, None)
    noise = 0.02 * np.random.default_rng(0).standard_normal(len(speed))
    recorded: Array = np.where(speed > 0.0, speed + noise, 0.0)
    run = signals(
        Recording(
            "run.csv", "0", {"time_s": time_s, "speed_mps": recorded, "power_w": 50.0 + speed}
        ),
        husky,
    )
    starts = [
        np.flatnonzero((one[:-1] == 0.0) & (one[1:] != 0.0)) for one in (speed, run.speed_mps)
    ]
    assert starts[0].tolist() == starts[1].tolist()
