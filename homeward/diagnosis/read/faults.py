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
    channels = dict(recording.channels)
    notes = list(recording.notes)
    notes += _without_empty(channels)
    notes += _without_spikes(channels, robot)
    notes += _without_silence_and_charging(channels, robot, recording.duration_s)
    error, held = _with_fresh_readings(channels, recording.duration_s)
    notes += held
    resets = int((np.diff(channels.get("distance_m", np.zeros(1))) < -thresholds.RESET_M).sum())
    if resets:
        notes.append(f"distance_m falls back {resets} times: the counter was reset, and is not used")
    return dataclasses.replace(recording, channels=channels, notes=tuple(notes)), error


def _without_empty(channels: dict[str, Array]) -> list[str]:
    """Remove channels without a value; a note for each."""
    empty = [name for name, values in channels.items() if not np.isfinite(values).any()]
    for name in empty:
        del channels[name]
    return [f"{name} holds no values and is left out" for name in empty]


def _without_spikes(channels: dict[str, Array], robot: Robot) -> list[str]:
    """Replace spikes of one sample by NaN; a note for each channel that has some."""
    notes = []
    for name in _JUMPY:
        if name not in channels:
            continue
        spikes = _spikes(channels[name])
        if name in _DRAWN:
            spikes &= ~_of_starts(spikes, channels, robot)
        if spikes.any():
            channels[name] = np.where(spikes, np.nan, channels[name])
            count = int(spikes.sum())
            notes.append(f"{count} spike{'s' if count > 1 else ''} of {name}, one sample long, left out")
    return notes


def _without_silence_and_charging(channels: dict[str, Array], robot: Robot, duration_s: float) -> list[str]:
    """Replace power by NaN where its meter is silent and where the robot is charged; a note for each."""
    drawn = channels.get("power_w", channels.get("current_a"))
    if drawn is None:
        return []
    speed_mps = np.abs(speed_of(channels))
    slowest_mps = thresholds.STANDSTILL_SHARE * robot.max_speed_mps
    silent = _silent(drawn, speed_mps > slowest_mps)
    charging = _charging(np.where(silent, np.nan, drawn), speed_mps < slowest_mps, channels["time_s"])
    for name in channels.keys() & set(_DRAWN):
        channels[name] = np.where(silent | charging, np.nan, channels[name])
    notes = []
    if silent.any():
        notes.append(f"power reads exactly zero in {int(silent.sum())} samples of driving: they are left out")
    if charging.any():
        seconds = float(charging.mean()) * duration_s
        notes.append(f"power flows back for {seconds:.3g} s while the robot stands: charging is left out")
    return notes


def _with_fresh_readings(channels: dict[str, Array], duration_s: float) -> tuple[dict[str, float], list[str]]:
    """Of channels that are held until the next reading, use the fresh ones: the errors of the others, and notes."""
    error: dict[str, float] = {}
    notes = []
    for name in (*_MOVED, *_DRAWN):
        fresh = _updates(channels[name]) if name in channels else None
        if fresh is None:
            continue
        held = f"{name} is held for {duration_s / len(fresh):.2g} s at a time"
        values = channels[name]
        if name in _DRAWN:
            channels[name] = np.where(np.isin(np.arange(len(values)), fresh), values, np.nan)
            notes.append(f"{held}: only fresh readings count")
            continue
        readings = values[fresh]
        smooth = _smooth(readings)
        if name in _SET and not smooth:
            continue  # it follows a command that is held
        time_s = channels["time_s"]
        if smooth:
            channels[name] = np.interp(time_s, time_s[fresh], readings)
            notes.append(f"{held}: values between are interpolated")
        else:
            middle_s = 0.5 * (time_s[fresh][1:] + time_s[fresh][:-1])
            channels[name] = readings[np.searchsorted(middle_s, time_s)]
            notes.append(f"{held}: the nearest reading counts")
        # Of a random walk: interpolated (a Brownian bridge), or as at the nearest reading, on average over time.
        share = 1.0 / 6.0 if smooth else 1.0 / 4.0
        error[_CHANNEL_OF.get(name, name)] = float(np.sqrt(share * np.mean(np.diff(readings) ** 2)))
    return error, notes


def _spikes(values: Array) -> Mask:
    """Samples far from both their neighbours and beyond the range of all others."""
    spikes = np.zeros(len(values), dtype=bool)
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < thresholds.FEWEST_SAMPLES:
        return spikes
    readings = values[known]
    padded = np.pad(readings, 1, mode="reflect")
    step_up = readings - padded[:-2]
    step_down = readings - padded[2:]
    off = np.where(np.sign(step_up) == np.sign(step_down), np.minimum(np.abs(step_up), np.abs(step_down)), 0.0)
    suspect = off > thresholds.SPIKE * white_noise(readings)
    if 0 < suspect.sum() <= thresholds.MOST_SPIKES * len(readings):
        deviation = np.abs(readings - np.median(readings))
        beyond = deviation > thresholds.HALF_AGAIN * np.max(deviation[~suspect])
        spikes[known[suspect & beyond]] = True
    return spikes


def _of_starts(spikes: Mask, channels: Mapping[str, Array], robot: Robot) -> Mask:
    """Spikes of power at starts, where most starts have one: they are part of the load."""
    time_s = channels["time_s"]
    speed = np.abs(np.nan_to_num(speed_of(channels)))
    slow = speed <= thresholds.STANDSTILL_SHARE * robot.max_speed_mps
    moves = speed > 0.0 if slow.any() and np.median(speed[slow]) == 0.0 else ~slow
    starts_s = time_s[1:][moves[1:] & ~moves[:-1]]
    near = np.zeros(len(time_s), dtype=bool)
    with_spike = 0
    for start_s in starts_s.tolist():
        around = np.abs(time_s - start_s) <= WINDOW_S
        with_spike += int((spikes & around).any())
        near |= around
    return near & (2 * with_spike > len(starts_s))


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
    periods = np.maximum(np.rint(apart / typical), 1.0)
    off = np.abs(apart - periods * typical)
    jitter = thresholds.JITTER * typical if typical > 2 else 0.0
    if float((off <= jitter).mean()) < thresholds.HELD:
        return None
    # A fresh reading may equal the one before, as at rest: readings lie a period apart also where nothing changes.
    readings = [np.arange(change[0], -1, -typical)[:0:-1]]
    for start, end, count in zip(change[:-1], change[1:], periods.astype(int), strict=True):
        readings.append(np.linspace(start, end, count, endpoint=False))
    readings.append(np.arange(change[-1], int(known.sum()), typical))
    fresh = np.rint(np.concatenate(readings)).astype(np.intp)
    return np.asarray(np.flatnonzero(known)[np.unique(fresh)])


def _smooth(fresh: Array) -> bool:
    """Whether held values are autocorrelated enough to interpolate between them."""
    centred = fresh - fresh.mean()
    return float(centred[1:] @ centred[:-1]) > thresholds.HALF * float(centred @ centred)
