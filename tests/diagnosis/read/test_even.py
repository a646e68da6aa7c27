"""Uneven stamps: bursts of a phone or a bus, read as the motion was."""

import dataclasses

import numpy as np
import pytest

from homeward.diagnosis.read.even import on_even_clock
from homeward.logs.recordings import Recording

RNG = np.random.default_rng(0)
TICK_S = 0.5


def bursts(pairs: int = 400) -> np.ndarray:
    """Two stamps 22 ms apart, the next after 0.5 to 0.7 s."""
    first_s = np.cumsum(RNG.uniform(0.5, 0.7, pairs))
    return np.sort(np.concatenate([first_s, first_s + 0.022]))


def recording(time_s: np.ndarray, **channels: np.ndarray) -> Recording:
    return Recording("bursts.csv", "0", {"time_s": time_s, **channels})


def test_even_stamps_are_left_as_they_are_with_jitter_of_half_a_step() -> None:
    time_s = np.arange(0.0, 60.0, 0.1) + RNG.uniform(-0.025, 0.025, 600)
    given = recording(time_s, speed_mps=np.ones(600))
    assert on_even_clock(given, TICK_S) == (given, None)


def test_of_bursts_acceleration_is_that_of_the_motion() -> None:
    time_s = bursts()
    read_mps = np.sin(time_s / 5.0) + RNG.normal(0.0, 0.02, len(time_s))
    even, says = on_even_clock(recording(time_s, speed_mps=read_mps), TICK_S)
    assert says is not None and "uneven" in says
    ticks_s = even.channels["time_s"]
    assert np.diff(ticks_s) == pytest.approx(TICK_S)
    accel_mps2 = np.gradient(even.channels["speed_mps"], ticks_s)
    true_mps2 = np.cos(ticks_s / 5.0) / 5.0
    assert np.std(accel_mps2 - true_mps2) < 0.2 * np.std(true_mps2)
    from_stamp_to_stamp = np.gradient(read_mps, time_s) - np.cos(time_s / 5.0) / 5.0
    assert np.std(from_stamp_to_stamp) > np.std(true_mps2)


def test_energy_and_way_are_kept() -> None:
    """Current that flows in bursts of stamps is no more than it was: a mean is over time, not over
    samples."""
    time_s = bursts()
    amps = np.where(np.arange(len(time_s)) % 2, 3.0, 1.0)
    volts = 25.0 - amps
    even, _ = on_even_clock(
        recording(time_s, voltage_v=volts, current_a=amps, speed_mps=amps), TICK_S
    )
    power_w = even.channels["voltage_v"] * even.channels["current_a"]
    used_s = TICK_S * len(power_w)
    inside = time_s <= time_s[0] + used_s
    energy_j = np.trapezoid((volts * amps)[inside], time_s[inside])
    assert TICK_S * power_w.sum() == pytest.approx(energy_j, rel=5e-3)
    way_m = np.trapezoid(amps[inside], time_s[inside])
    assert TICK_S * even.channels["speed_mps"].sum() == pytest.approx(way_m, rel=5e-3)


def test_a_heading_turns_on_through_north_and_what_is_not_recorded_stays_unknown() -> None:
    time_s = bursts()
    wrapped = (0.1 * time_s + np.pi) % (2.0 * np.pi) - np.pi
    warm_c = np.where(time_s < time_s[-1] / 2.0, 20.0, np.nan)
    even, _ = on_even_clock(recording(time_s, heading_rad=wrapped, temperature_c=warm_c), TICK_S)
    rate = np.diff(even.channels["heading_rad"]) / TICK_S
    assert rate == pytest.approx(0.1, abs=0.02)
    late = even.channels["time_s"] > time_s[-1] / 2.0 + 2.0 * TICK_S
    assert np.isnan(even.channels["temperature_c"][late]).all()
    assert even.channels["temperature_c"][~late][:-5] == pytest.approx(20.0)


def test_a_gap_is_not_filled() -> None:
    time_s = bursts()
    time_s = np.where(time_s > time_s[400], time_s + 60.0, time_s)
    even, _ = on_even_clock(
        dataclasses.replace(recording(time_s, speed_mps=np.ones(len(time_s)))), TICK_S
    )
    assert np.max(np.diff(even.channels["time_s"])) > 50.0
