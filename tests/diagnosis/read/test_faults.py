"""Faults of logging are removed, each with a note of one line; what is the robot's own stays."""

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Recording
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.read.faults import without_faults
from tests.diagnosis.hills import SAMPLES, STEP_S, Array, Channels, drives, held, only, recordings


@pytest.fixture
def channels() -> Channels:
    """A drive without faults."""
    return only(drives("husky")[0], "grade_rad")


def mended(channels: Channels, husky: Robot) -> tuple[Channels, list[str], dict[str, float]]:
    """Channels and notes of the recording without its faults, and errors of interpolated
    channels."""
    found, error = without_faults(Recording("run.csv", "0", channels), husky)
    assert all("\n" not in note for note in found.notes)
    return dict(found.channels), list(found.notes), error


def unlike(after: Channels, before: Channels, name: str) -> list[int]:
    """Samples of a channel that are not as they were, all of them left out; other channels are
    unchanged."""
    for other in before.keys() - {name}:
        np.testing.assert_array_equal(after[other], before[other])
    changed = np.flatnonzero(after[name] != before[name])
    assert np.isnan(after[name][changed]).all()
    return changed.tolist()


def driving(channels: Channels, samples: int) -> int:
    """First sample of a stretch of driving that lasts so many samples."""
    moves = np.abs(channels["speed_mps"]) > 0.1
    return int(np.flatnonzero(np.convolve(moves, np.ones(samples), "valid") == samples)[0])


def parked(channels: Channels, seconds: float) -> Channels:
    """The drive, and the robot on a charger for some seconds after it."""
    count = round(seconds / STEP_S)
    tail = {name: np.full(count, values[-1]) for name, values in channels.items()}
    tail["time_s"] = channels["time_s"][-1] + STEP_S * np.arange(1, count + 1)
    tail["speed_mps"] = np.zeros(count)
    tail["power_w"] = np.full(count, -50.0) + np.sin(np.arange(count))
    return {name: np.concatenate([values, tail[name]]) for name, values in channels.items()}


def test_a_recording_without_faults_stays_as_it_is(channels: Channels, husky: Robot) -> None:
    after, notes, error = mended(channels, husky)
    assert unlike(after, channels, "power_w") == [] and notes == [] and error == {}


@pytest.mark.parametrize(("at", "said"), [([700], "1 spike"), ([700, 1500], "2 spikes")])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_spike_of_one_sample_is_left_out(
    at: list[int], said: str, sign: float, channels: Channels, husky: Robot
) -> None:
    spoilt = {**channels, "power_w": channels["power_w"].copy()}
    spoilt["power_w"][at] = sign * 3000.0
    after, notes, _ = mended(spoilt, husky)
    assert unlike(after, spoilt, "power_w") == at
    assert notes == [f"{said} of power_w, one sample long, left out"]


def test_a_peak_of_two_samples_is_no_spike(channels: Channels, husky: Robot) -> None:
    peak = {**channels, "power_w": channels["power_w"].copy()}
    peak["power_w"][700:702] = 3000.0, 2995.0
    assert mended(peak, husky)[1] == []


def test_a_meter_that_shows_nothing_while_the_robot_drives_is_left_out(
    channels: Channels, husky: Robot
) -> None:
    """At rest the robot may be switched off."""
    start = driving(channels, 30)
    spoilt = {
        **channels,
        "power_w": np.where(channels["speed_mps"] == 0.0, 0.0, channels["power_w"]),
    }
    spoilt["power_w"][start : start + 15] = 0.0
    after, notes, _ = mended(spoilt, husky)
    assert unlike(after, spoilt, "power_w") == list(range(start, start + 15))
    assert notes == ["power reads exactly zero in 15 samples of driving: they are left out"]


def test_a_meter_that_reads_zero_at_any_low_load_is_believed(
    channels: Channels, husky: Robot
) -> None:
    power_w = np.where(
        channels["power_w"] < np.quantile(channels["power_w"], 0.5), 0.0, channels["power_w"]
    )
    assert mended({**channels, "power_w": power_w}, husky)[1] == []


@pytest.mark.parametrize(("seconds", "found"), [(12.0, True), (2.0, False)])
def test_power_that_flows_back_for_long_while_the_robot_stands_is_charging(
    seconds: float, found: bool, channels: Channels, husky: Robot
) -> None:
    """A capacitor gives back for a moment."""
    spoilt = parked(channels, seconds)
    after, notes, _ = mended(spoilt, husky)
    assert unlike(after, spoilt, "power_w") == (
        list(range(SAMPLES, len(spoilt["time_s"]))) if found else []
    )
    assert notes == (
        [f"power flows back for {seconds:.3g} s while the robot stands: charging is left out"]
        * found
    )


@pytest.mark.parametrize("every", [5, 10])
def test_of_a_held_power_only_fresh_readings_count(
    every: int, channels: Channels, husky: Robot
) -> None:
    spoilt = held(channels, "power_w", every)
    after, notes, _ = mended(spoilt, husky)
    fresh = np.flatnonzero(np.isfinite(after["power_w"]))
    assert fresh.tolist() == list(range(0, SAMPLES, every))
    np.testing.assert_array_equal(after["power_w"][fresh], channels["power_w"][fresh])
    assert notes == [
        f"power_w is held for {every * STEP_S:.2g} s at a time: only fresh readings count"
    ]


def test_a_held_slope_is_interpolated_and_the_error_of_that_is_known(
    channels: Channels, husky: Robot
) -> None:
    """A random walk: between two readings it is a Brownian bridge."""
    walk: Array = 1e-4 * np.cumsum(np.random.default_rng(0).standard_normal(SAMPLES))
    spoilt = held({**channels, "grade_rad": walk}, "grade_rad", 10)
    after, notes, error = mended(spoilt, husky)
    assert notes == ["grade_rad is held for 1 s at a time: values between are interpolated"]
    assert list(error) == ["grade_rad"]
    assert error["grade_rad"] == pytest.approx(float(np.std(after["grade_rad"] - walk)), rel=0.1)
    (run,), _ = usable_runs([Recording("run.csv", "0", spoilt)], husky)
    # though nothing is as smooth as a straight line
    assert run.error["grade_rad"] == error["grade_rad"]


def test_a_held_slope_that_changes_from_reading_to_reading_is_not_late(
    channels: Channels, husky: Robot
) -> None:
    """Each value stands for the time around its reading, and not for that after it."""
    slope: Array = 0.05 * np.random.default_rng(0).standard_normal(SAMPLES)
    after, notes, error = mended(held({**channels, "grade_rad": slope}, "grade_rad", 10), husky)
    assert notes == ["grade_rad is held for 1 s at a time: the nearest reading counts"]
    for reading in range(10, SAMPLES - 10, 10):
        assert (after["grade_rad"][reading - 4 : reading + 5] == slope[reading]).all()
    assert error["grade_rad"] == pytest.approx(0.05 * np.sqrt(2.0 / 4.0), rel=0.1)


def test_a_counter_that_falls_back_was_reset(channels: Channels, husky: Robot) -> None:
    way_m = np.cumsum(np.abs(channels["speed_mps"])) * STEP_S
    assert mended({**channels, "distance_m": way_m}, husky)[1] == []
    notes = mended({**channels, "distance_m": np.mod(way_m, 0.4 * way_m[-1])}, husky)[1]
    assert notes == ["distance_m falls back 2 times: the counter was reset, and is not used"]


@pytest.mark.parametrize(
    "name", ["grade_rad", "yaw_rate_radps", "payload_kg", "temperature_c", "heading_rad", "soc"]
)
def test_a_channel_without_values_is_as_good_as_none(name: str, husky: Robot) -> None:
    spoilt = recordings("husky", lambda c, rng: {**only(c), name: np.full(SAMPLES, np.nan)})[:1]
    runs, findings = usable_runs(spoilt, husky)
    assert len(runs) == 1 and name not in runs[0].context
    assert any(one.text == f"{name} holds no values and is left out" for one in findings)


def test_the_spikes_of_starts_are_the_robots_own(husky: Robot) -> None:
    channels = only(drives("husky")[0])
    moves = channels["speed_mps"] > 0.02
    starts = np.flatnonzero(moves[1:] & ~moves[:-1]) + 1
    power = channels["power_w"].copy()
    power[starts] *= 20.0
    kept, _ = without_faults(Recording("a", "0", {**channels, "power_w": power}), husky)
    assert np.isfinite(kept.channels["power_w"]).all() and len(starts) > 3


def test_levels_that_are_set_are_not_taken_for_held_readings(husky: Robot) -> None:
    rng = np.random.default_rng(100)
    levels_set = np.repeat(rng.choice([0.0, 0.3, 0.6, 0.9], SAMPLES // 10), 10)
    channels = {**only(drives("husky")[0]), "speed_mps": levels_set}
    kept, _ = without_faults(Recording("a", "0", channels), husky)
    np.testing.assert_array_equal(kept.channels["speed_mps"], levels_set)


def test_a_held_speed_is_known_before_its_first_change_and_after_its_last(husky: Robot) -> None:
    channels = only(drives("husky")[0])
    speed = np.where(
        (channels["time_s"] > 20.0) & (channels["time_s"] < 230.0),
        0.3 + channels["time_s"] / 1000.0,
        0.0,
    )
    spoilt = held({**channels, "speed_mps": speed}, "speed_mps", 10)
    kept, _ = without_faults(Recording("a", "0", spoilt), husky)
    np.testing.assert_allclose(kept.channels["speed_mps"], speed, atol=0.51)
    assert (
        not kept.channels["speed_mps"][:190].any() and not kept.channels["speed_mps"][2320:].any()
    )
