"""Synthetic recordings: drawn from a seed, and the robot's power but for noise of a stated size."""

import gzip
import io

import numpy as np
import pandas as pd
import pytest

from homeward import load_robot, synthetic
from homeward.datasets import shipped_recording
from homeward.physics import replay
from homeward.synthetic import RESOLUTION, SAMPLES, STEP_S, record, scrubbing_husky

HUSKY = load_robot("husky")


@pytest.fixture(scope="module")
def drive() -> pd.DataFrame:
    return record(HUSKY, 3)


def test_a_seed_is_a_drive(drive: pd.DataFrame) -> None:
    pd.testing.assert_frame_equal(record(HUSKY, 3), drive)
    assert not record(HUSKY, 4).equals(drive)


def test_it_is_eight_minutes_at_ten_hertz_to_the_digits_of_the_sensors(drive: pd.DataFrame) -> None:
    assert len(drive) * STEP_S == pytest.approx(480.0) and len(drive) == SAMPLES
    np.testing.assert_allclose(np.diff(drive["time_s"]), 0.1)
    for name, decimals in RESOLUTION.items():
        np.testing.assert_array_equal(drive[name], np.round(drive[name], decimals))


def test_it_stands_drives_turns_climbs_and_senses(drive: pd.DataFrame) -> None:
    standing = drive["speed_mps"] == 0.0
    assert 0.05 < standing.mean() < 0.6
    assert drive["speed_mps"].between(-0.02, 0.92).all()
    # noise alone: it turns while it drives
    assert abs(drive["yaw_rate_radps"][standing]).max() < 0.04
    assert abs(drive["yaw_rate_radps"]).max() > 0.25
    assert drive["grade_rad"].min() < -0.05 and drive["grade_rad"].max() > 0.09
    assert set(drive["sensing_hz"]) <= {0.0, 10.0, 25.0} and drive["sensing_hz"].nunique() > 1


def test_power_is_that_of_the_replay_but_for_noise(drive: pd.DataFrame) -> None:
    """A drift of 2 % of the power and a ripple of 3 W; what noisy motion adds is averaged over a
    second."""
    columns = {
        name: drive[name].to_numpy() for name in ("grade_rad", "yaw_rate_radps", "sensing_hz")
    }
    expected_w = replay(
        HUSKY, drive["time_s"].to_numpy(), drive["speed_mps"].to_numpy(), **columns
    ).power_w
    error_w = (drive["power_w"] - expected_w).to_numpy()
    assert abs(error_w.mean()) < 0.02 * expected_w.mean()
    ripple_w = np.diff(error_w[drive["speed_mps"] == 0.0]) / np.sqrt(2.0)
    assert np.std(ripple_w) == pytest.approx(3.0, rel=0.1)
    seconds = error_w.reshape(-1, 10).mean(axis=1) / expected_w.reshape(-1, 10).mean(axis=1)
    assert 0.01 < np.std(seconds) < 0.04


def test_noise_does_not_depend_on_the_robot(drive: pd.DataFrame) -> None:
    """The same drive and the same draws: only the power differs."""
    other = record(load_robot("rusti"), 3)
    pd.testing.assert_frame_equal(other.drop(columns="power_w"), drive.drop(columns="power_w"))


def test_levels_are_held_within_their_times() -> None:
    levels = synthetic._levels(np.random.default_rng(0), tuple(map(float, range(1000))), 3.0, 9.0)
    assert len(levels) == SAMPLES
    changes = np.flatnonzero(np.diff(levels))
    held_s = np.diff(changes) * STEP_S
    assert held_s.min() >= 2.9 and held_s.max() < 9.0
    assert len(changes) > 50


def test_the_shipped_recording_is_what_its_command_makes() -> None:
    made = pd.read_csv(io.BytesIO(gzip.decompress(scrubbing_husky())))
    shipped = pd.read_csv(shipped_recording())
    assert list(made) == list(shipped) == list(RESOLUTION)
    # to the last digit, which another processor may round otherwise
    for name, decimals in RESOLUTION.items():
        error = np.abs(shipped[name] - made[name]).max()
        assert error < 1.5 * 10.0**-decimals, f"{name}: run `python -m homeward.synthetic FILE`"
