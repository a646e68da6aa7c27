"""Faults of the logging itself, removed before anything is fitted, each with a note of one line.

Spikes of one sample, charging at standstill, and readings that are held until the next one.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.read.noise import white_noise
from homeward.diagnosis.read.signals import WINDOW_S, speed_of
from homeward.logs.channels import Array, Index, Mask
from homeward.logs.recordings import Recording
from homeward.physics import Robot

_DRAWN = ("power_w", "current_a", "motor_left_a", "motor_right_a")
_SET = ("speed_mps", "wheel_left_mps", "wheel_right_mps", "yaw_rate_radps")  # they may jump with their command
_MOVED = (*_SET, "grade_rad", "elevation_m")
_CHANNEL_OF = {"wheel_left_mps": "speed_mps", "wheel_right_mps": "speed_mps"}
_JUMPY = (*_DRAWN, "voltage_v", "grade_rad", "elevation_m")


def without_faults(recording: Recording, robot: Robot) -> tuple[Recording, dict[str, float]]:
    """The recording without faulty readings, with a note for each kind of fault; power left out is NaN.

    Also the standard deviation of the error of each channel of which only some readings are fresh.
    """
    channels, notes = dict(recording.channels), list(recording.notes)
    error: dict[str, float] = {}
    for name, values in recording.channels.items():
        if not np.isfinite(values).any():
            del channels[name]
            notes.append(f"{name} holds no values and is left out")
    for name in _JUMPY:
        if name in channels:
            bad = _spikes(channels[name])
            if name in _DRAWN:
                bad &= ~_of_starts(bad, channels, robot)
            if bad.any():
                channels[name] = np.where(bad, np.nan, channels[name])
                spikes = "1 spike" if bad.sum() == 1 else f"{int(bad.sum())} spikes"
                notes.append(f"{spikes} of {name}, one sample long, left out")
    if (drawn := channels.get("power_w", channels.get("current_a"))) is not None:
        speed, slowest_mps = np.abs(speed_of(channels)), thresholds.STANDSTILL_SHARE * robot.max_speed_mps
        silent = _silent(drawn, speed > slowest_mps)
        charging = _charging(np.where(silent, np.nan, drawn), speed < slowest_mps, channels["time_s"])
        for name in channels.keys() & set(_DRAWN):
            channels[name] = np.where(silent | charging, np.nan, channels[name])
        if silent.any():
            notes.append(f"power reads exactly zero in {int(silent.sum())} samples of driving: they are left out")
        if charging.any():
            seconds = float(charging.mean()) * recording.duration_s
            notes.append(f"power flows back for {seconds:.3g} s while the robot stands: charging is left out")
    for name in (*_MOVED, *_DRAWN):
        if (fresh := _updates(channels[name]) if name in channels else None) is None:
            continue
        period_s = recording.duration_s / len(fresh)
        if name in _DRAWN:
            channels[name] = np.where(np.isin(np.arange(len(recording)), fresh), channels[name], np.nan)
            notes.append(f"{name} is held for {period_s:.2g} s at a time: only fresh readings count")
        elif (smooth := _smooth(readings := channels[name][fresh])) or name not in _SET:
            time_s = channels["time_s"]
            nearest = np.searchsorted(0.5 * (time_s[fresh][1:] + time_s[fresh][:-1]), time_s)
            channels[name] = np.interp(time_s, time_s[fresh], readings) if smooth else readings[nearest]
            # Of a random walk: interpolated (a Brownian bridge), or as at the nearest reading, on average over time.
            share = 1.0 / 6.0 if smooth else 1.0 / 4.0
            error[_CHANNEL_OF.get(name, name)] = float(np.sqrt(share * np.mean(np.diff(readings) ** 2)))
            between = "values between are interpolated" if smooth else "the nearest reading counts"
            notes.append(f"{name} is held for {period_s:.2g} s at a time: {between}")
    if resets := int((np.diff(channels.get("distance_m", np.zeros(1))) < -thresholds.RESET_M).sum()):
        notes.append(f"distance_m falls back {resets} times: the counter was reset, and is not used")
    return dataclasses.replace(recording, channels=channels, notes=tuple(notes)), error


def _spikes(values: Array) -> Mask:
    """Samples far from both their neighbours and beyond the range of all others."""
    spikes = np.zeros(len(values), dtype=bool)
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < thresholds.FEWEST_SAMPLES:
        return spikes
    one = values[known]
    beside = np.pad(one, 1, mode="reflect")
    before, after = one - beside[:-2], one - beside[2:]
    off = np.where(np.sign(before) == np.sign(after), np.minimum(np.abs(before), np.abs(after)), 0.0)
    suspect = off > thresholds.SPIKE * white_noise(one)
    if 0 < suspect.sum() <= thresholds.MOST_SPIKES * len(one):
        beyond = np.abs(one - np.median(one))
        spikes[known[suspect & (beyond > thresholds.SPIKE_BEYOND * np.max(beyond[~suspect]))]] = True
    return spikes


def _of_starts(spikes: Mask, channels: Mapping[str, Array], robot: Robot) -> Mask:
    """Spikes of power at starts, where most starts have one: they are part of the load."""
    time_s = channels["time_s"]
    speed = np.abs(np.nan_to_num(speed_of(channels)))
    slow = speed <= thresholds.STANDSTILL_SHARE * robot.max_speed_mps
    moves = speed > 0.0 if slow.any() and np.median(speed[slow]) == 0.0 else ~slow
    starts_s = time_s[1:][moves[1:] & ~moves[:-1]]
    near, with_one = np.zeros(len(time_s), dtype=bool), 0
    for start_s in starts_s.tolist():
        around = np.abs(time_s - start_s) <= WINDOW_S
        with_one += bool((spikes & around).any())
        near |= around
    return near & (2 * with_one > len(starts_s))


def _silent(drawn: Array, drives: Mask) -> Mask:
    """Samples of driving where a meter of battery power reads zero, as at its restart: the load is never zero."""
    zero = drawn == 0.0
    silent = zero & drives & (np.append(zero[1:], False) | np.insert(zero[:-1], 0, False))
    return np.asarray(silent & (silent.mean() <= thresholds.MOST_SILENT))


def _charging(drawn: Array, stands: Mask, time_s: Array) -> Mask:
    """Samples at standstill with negative power, for some seconds on end."""
    driving = drawn[~stands & np.isfinite(drawn)]
    typical = float(driving.mean()) if len(driving) else 0.0
    back = stands & (drawn < -thresholds.ZERO_ERROR * max(typical, 0.0))
    charging = np.zeros(len(time_s), dtype=bool)
    edges = np.flatnonzero(np.diff(back.astype(np.int8), prepend=0, append=0))
    for first, after in zip(edges[::2], edges[1::2], strict=True):
        if time_s[after - 1] - time_s[first] >= thresholds.CHARGES_S:
            charging[first:after] = True
    return charging


def _updates(values: Array) -> Index | None:
    """Samples at which a held channel is fresh, or None where it is not held.

    A held channel changes at most every other sample and at even distances.
    """
    known = np.isfinite(values)
    change = np.flatnonzero(np.diff(values[known]) != 0.0) + 1
    if len(change) < thresholds.FEWEST_SAMPLES:
        return None
    apart = np.diff(change)
    typical = int(np.median(apart))
    if typical < 2:
        return None
    whole = np.maximum(np.rint(apart / typical), 1.0)
    off = np.abs(apart - whole * typical)
    if float((off <= (thresholds.JITTER * typical if typical > 2 else 0.0)).mean()) < thresholds.HELD:
        return None
    # A fresh reading may equal the one before, as at rest.
    spans = zip(change[:-1], change[1:], whole.astype(int), strict=True)
    between = [np.linspace(a, b, times, endpoint=False) for a, b, times in spans]
    before, after = np.arange(change[0], -1, -typical)[:0:-1], np.arange(change[-1], int(known.sum()), typical)
    fresh = np.rint(np.concatenate([before, *between, after])).astype(np.intp)
    return np.asarray(np.flatnonzero(known)[np.unique(fresh)])


def _smooth(fresh: Array) -> bool:
    """Whether held values are autocorrelated enough to interpolate between them."""
    centred = fresh - fresh.mean()
    return float(centred[1:] @ centred[:-1]) > thresholds.HALF * float(centred @ centred)
