"""What is named gives way to a channel that explains more, and to none that only stands for
time."""

import dataclasses
from collections.abc import Callable

import numpy as np

from homeward import Robot
from homeward.diagnosis import Recording, diagnose
from homeward.diagnosis.explain.explanation import explain
from homeward.diagnosis.explain.residual_test import TESTED, Dependence
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.physics import replay
from homeward.synthetic import STEP_S


def test_a_loss_that_remembers_the_fastest_speed_is_no_load_that_switches(
    short_drive: Callable[..., list[Recording]], husky: Robot
) -> None:
    runs = []
    for run in short_drive(husky):
        time_s, speed_mps = run.channels["time_s"], np.abs(run.channels["speed_mps"])
        since = np.searchsorted(time_s, time_s - 30.0)
        fastest_mps = np.array(
            [speed_mps[first : now + 1].max() for now, first in enumerate(since)]
        )
        power_w = run.channels["power_w"] + 80.0 * fastest_mps**2 * speed_mps
        runs.append(dataclasses.replace(run, channels={**run.channels, "power_w": power_w}))
    assert diagnose(runs, husky).verdict == "unknown_physics"


def test_a_slope_whose_own_replay_explains_nothing_bars_no_turning(husky: Robot) -> None:
    """Straight on, turns on the spot and stops, without slopes: linearised, a constant slope looks
    like the turns."""
    rng, runs = np.random.default_rng(1), []
    for number in range(6):
        time_s = np.arange(0.0, 240.0, 0.15)
        part = np.repeat(rng.integers(0, 3, 40), 40)[: len(time_s)]
        straight_mps = np.where(
            part < 2, np.repeat(rng.uniform(0.2, 0.9, 40), 40)[: len(time_s)], 0.0
        )
        turn_radps = np.where(
            part == 2, np.repeat(rng.uniform(0.5, 1.5, 40), 40)[: len(time_s)], 0.0
        )
        amps = 7.5 + 14.0 * (turn_radps > 0.0) + rng.normal(0.0, 0.8, len(time_s))
        wheels_mps = 0.5 * husky.track_m * turn_radps
        channels = {
            "time_s": time_s, "wheel_left_mps": straight_mps - wheels_mps, "wheel_right_mps": straight_mps + wheels_mps,
            "motor_left_a": amps / 2.0, "motor_right_a": amps / 2.0,
        }  # fmt: skip
        runs.append(Recording(f"run{number}.csv", str(number), channels))
    diagnosis = diagnose(runs, husky)
    assert [effect.effect for effect in diagnosis.missing_physics] == ["turning"]
    assert not diagnosis.missing_physics[0].confused_with
    assert diagnosis.fit is not None and (diagnosis.fit.arms["file"].r2 or 0.0) > 0.95


def test_a_hill_that_was_not_recorded_is_no_effect_and_its_channel_is_asked_for(
    drive: Callable[..., list[Recording]], husky: Robot
) -> None:
    """All ways climb in their second half, and the place on them is all that a recording has of
    that."""
    runs = []
    for seed, run in enumerate(drive(husky, minutes=4.0)):
        channels = {name: values for name, values in run.channels.items() if name != "grade_rad"}
        away_m = np.cumsum(channels["speed_mps"]) * STEP_S
        climbs = away_m > 0.5 * away_m.max()
        power_w = replay(
            husky, channels["time_s"], channels["speed_mps"], yaw_rate_radps=channels["yaw_rate_radps"],
            sensing_hz=channels["sensing_hz"], grade_rad=np.where(climbs, 0.05, 0.0),
        ).power_w  # fmt: skip
        channels["power_w"] = power_w + np.random.default_rng(seed).normal(0.0, 3.0, len(power_w))
        runs.append(dataclasses.replace(run, channels={**channels, "base_distance_m": away_m}))
    diagnosis = diagnose(runs, husky)
    assert not diagnosis.missing_physics
    assert (
        "slopes that these runs, or some of them, lack (grade_rad or elevation_m) may"
        in diagnosis.summary
    )
    assert "depends on no recorded channel" not in diagnosis.summary
    assert "The robot file explains" not in diagnosis.summary


def test_what_only_the_place_shows_may_be_slopes_that_were_not_recorded(
    short_fit: Refit, short_runs: Runs
) -> None:
    place = next(channel for channel in TESTED if channel.name == "base_distance_m")
    count = len(short_runs.observed)
    blocks, far = np.arange(count) // 10, (np.arange(count) >= count // 2).astype(np.intp)
    bins, excess_w = np.array([10.0, 30.0]), np.array([0.0, 10.0])
    shown = Dependence(place, False, 0.0, 0.5, far, bins, excess_w, np.ones(count))
    flat = dataclasses.replace(
        short_runs, context={**short_runs.context, "grade_rad": np.full(count, np.nan)}
    )
    found = explain(
        short_fit, flat, [shown], blocks, flat.run, np.random.default_rng(0), lambda text: None
    )
    assert not found.naming.named and found.naming.unrecorded
