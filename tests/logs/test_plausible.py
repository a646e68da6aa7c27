"""Readings that no motion explains are left out, channel by channel, with a line; many of them are
no spikes."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from homeward.logs.plausible import within_top_speed
from homeward.logs.recordings import Recording, read_recording

Write = Callable[[pd.DataFrame], Path]


@pytest.mark.parametrize(
    ("channel", "spike"),
    [
        ("speed_mps", 60.0),
        ("speed_mps", -9.0),
        ("wheel_left_mps", 12.0),
        ("distance_m", 900.0),
        ("elevation_m", 200.0),
    ],
)
def test_a_spike_is_left_out_and_said(
    table: pd.DataFrame, csv: Write, channel: str, spike: float
) -> None:
    driven_m = np.cumsum(table.speed_mps) * 0.1
    table["distance_m"], table["elevation_m"] = driven_m, 400.0 + 0.05 * driven_m
    if channel == "wheel_left_mps":
        table["wheel_left_mps"] = table["wheel_right_mps"] = table.pop("speed_mps")
    good = read_recording(csv(table))
    assert not [note for note in good.notes if "left out" in note]
    table.loc[[100, 300, 301], channel] = spike
    read = read_recording(csv(table))
    assert np.flatnonzero(np.isnan(read.channels[channel])).tolist() == [100, 300, 301]
    assert any(
        note.startswith(f"3 of 600 values of {channel} are more than") for note in read.notes
    )


def test_noise_and_hard_driving_are_no_spikes(table: pd.DataFrame, csv: Write) -> None:
    table["speed_mps"] = 2.0 * (np.arange(600) // 40 % 2) + np.random.default_rng(0).normal(
        0.0, 0.3, 600
    )
    assert np.isfinite(read_recording(csv(table)).channels["speed_mps"]).all()


def test_many_are_another_unit_and_said(table: pd.DataFrame, csv: Write) -> None:
    table.loc[::20, "speed_mps"] = 40.0
    read = read_recording(csv(table))
    assert np.isfinite(read.channels["speed_mps"]).all()
    assert "check unit and clock" in " ".join(read.notes)


def test_single_speeds_beyond_the_robots_own_are_left_out(table: pd.DataFrame, csv: Write) -> None:
    table.loc[[100, 300], "speed_mps"] = 2.2  # which grip allows
    read = read_recording(csv(table))
    slow: Recording = within_top_speed(read, 1.0)
    assert np.flatnonzero(np.isnan(slow.channels["speed_mps"])).tolist() == [100, 300]
    assert (
        slow.notes[-1]
        == "2 of 600 values of speed_mps exceed 1.5 m/s, which the robot does not, and are left out"
    )
    assert within_top_speed(slow, 1.0) == slow and within_top_speed(read, 2.0) is read
    assert within_top_speed(read, 0.3) is read  # another robot or unit, as the diagnosis says
