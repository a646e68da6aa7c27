"""Each mechanism does what its name says."""

import dataclasses

import numpy as np
import pytest

from benchmarks.concealed.fixed_way.drive import Drive
from benchmarks.concealed.fixed_way.mechanisms import (
    chatter_share,
    switched,
    taken_up,
    thermostat,
    warmth,
)


def long_drive(seconds: float) -> Drive:
    """Standing for 10 s, then at 0.5 m/s on level ground, at 5 Hz."""
    time_s = np.linspace(0.0, seconds, round(seconds / 0.2), endpoint=False)
    nothing = np.zeros_like(time_s)
    speed_mps = np.where(time_s < 10.0, 0.0, 0.5)
    driven_m = np.cumsum(speed_mps) * 0.2
    ones = nothing + 1.0
    return Drive(0.2, time_s, driven_m, driven_m, speed_mps, ones, nothing, nothing, nothing)


def test_a_drive_chatters_in_a_band_of_speeds() -> None:
    speed_mps = np.array([0.0, 0.3, 0.39, 0.4, 0.45, 0.54, 0.56, 0.8])
    share = chatter_share(speed_mps, most_share=0.6)
    assert share == pytest.approx([0.0, 0.0, 0.0, 0.3, 0.6, 0.6, 0.0, 0.0])


def test_a_gearbox_warms_up_while_it_drives() -> None:
    run = long_drive(190.0)
    levels = warmth(run)
    assert np.all(levels[run.speed_mps == 0.0] == 0.0)
    assert levels[-1] == pytest.approx(1.0 - np.exp(-1.0), abs=0.01)


def test_a_warm_gearbox_cools_while_it_stands() -> None:
    driving = long_drive(190.0)
    stands_again = np.where(driving.time_s > 100.0, 0.0, driving.speed_mps)
    levels = warmth(dataclasses.replace(driving, speed_mps=stands_again))
    assert 0.0 < levels[-1] < levels.max()


def test_a_device_is_on_for_its_share_of_the_time() -> None:
    time_s = np.arange(0.0, 50_000.0, 1.0)
    series = switched(np.random.default_rng(1), time_s, on_s=80.0, off_s=120.0)
    assert set(series.tolist()) == {0.0, 1.0}
    assert series.mean() == pytest.approx(0.4, abs=0.05)
    changes = np.flatnonzero(np.diff(series))
    assert np.diff(changes).min() >= 12


def test_a_compressor_runs_longer_on_a_hotter_day() -> None:
    run = long_drive(6000.0)
    on_shares = [thermostat(np.random.default_rng(2), run, air_c).mean() for air_c in (29.0, 37.0)]
    # by hand: between 22 and 26 °C inside, settling at air + 3 °C off and air - 19 °C on
    for air_c, on_share in zip((29.0, 37.0), on_shares, strict=True):
        warming_s = 300.0 * np.log((air_c + 3.0 - 22.0) / (air_c + 3.0 - 26.0))
        cooling_s = 300.0 * np.log((26.0 - air_c + 19.0) / (22.0 - air_c + 19.0))
        assert on_share == pytest.approx(cooling_s / (cooling_s + warming_s), abs=0.06)


def test_something_is_taken_up_after_the_stop_began() -> None:
    run = long_drive(100.0)
    stands = (run.time_s >= 50.0) & (run.time_s < 70.0)
    speed_mps = np.where(stands, 0.0, run.speed_mps)
    driven_m = np.cumsum(speed_mps) * run.dt_s
    run = dataclasses.replace(run, speed_mps=speed_mps, driven_m=driven_m)
    stop_m = float(driven_m[stands][0])
    series = taken_up(run, stop_m, after_s=15.0)
    assert run.time_s[np.argmax(series)] == pytest.approx(65.0, abs=0.3)
    assert np.all(np.diff(series) >= 0.0)
