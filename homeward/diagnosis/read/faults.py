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
# may jump with their command
_SET = ("speed_mps", "wheel_left_mps", "wheel_right_mps", "yaw_rate_radps")
_MOVED = (*_SET, "grade_rad", "elevation_m")
_CHANNEL_OF = {"wheel_left_mps": "speed_mps", "wheel_right_mps": "speed_mps"}
_JUMPY = (*_DRAWN, "voltage_v", "grade_rad", "elevation_m")


def without_faults(recording: Recording, robot: Robot) -> tuple[Recording, dict[str, float]]:
    """The recording without faulty readings, with a note for each kind of fault; power left out is
    NaN.

    Also the standard deviation of the error of each channel of which only some readings are fresh.
    """
    channels = dict(recording.channels)
    notes = list(recording.notes)
    notes += _without_empty(channels)
    notes += _without_spikes(channels, robot)
    notes += _without_silence_and_charging(channels, robot, recording.duration_s)
    error, notes_on_held = _with_fresh_readings(channels, recording.duration_s)
    notes += notes_on_held
    driven_m = np.diff(channels.get("distance_m", np.zeros(1)))
    resets = int((driven_m < -thresholds.RESET_M).sum())
    if resets:
        notes.append(
            f"distance_m falls back {resets} times: the counter was reset, and is not used"
        )
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
            spikes &= ~_near_starts(spikes, channels, robot)
        count = int(spikes.sum())
        if count == 0:
            continue
        channels[name] = np.where(spikes, np.nan, channels[name])
        spikes_of = "spike of" if count == 1 else "spikes of"
        notes.append(f"{count} {spikes_of} {name}, one sample long, left out")
    return notes


def _without_silence_and_charging(
    channels: dict[str, Array], robot: Robot, duration_s: float
) -> list[str]:
    """Replace power by NaN where its meter is silent and where the robot is charged; a note for
    each."""
    drawn = channels.get("power_w", channels.get("current_a"))
    if drawn is None:
        return []
    speed_mps = np.abs(speed_of(channels))
    slowest_mps = thresholds.STANDSTILL_SHARE * robot.max_speed_mps
    drives = speed_mps > slowest_mps
    # where the speed is unknown the robot neither drives nor stands
    stands = speed_mps < slowest_mps
    silent = _silent(drawn, drives)
    charging = _charging(np.where(silent, np.nan, drawn), stands, channels["time_s"])
    faulty = silent | charging
    for name in channels.keys() & set(_DRAWN):
        channels[name] = np.where(faulty, np.nan, channels[name])
    notes = []
    if silent.any():
        notes.append(
            f"power reads exactly zero in {int(silent.sum())} samples of driving: they are left out"
        )
    if charging.any():
        seconds = float(charging.mean()) * duration_s
        notes.append(
            f"power flows back for {seconds:.3g} s while the robot stands: charging is left out"
        )
    return notes


def _with_fresh_readings(
    channels: dict[str, Array], duration_s: float
) -> tuple[dict[str, float], list[str]]:
    """Of channels that are held until the next reading, use the fresh ones: the errors of the
    others, and notes."""
    error: dict[str, float] = {}
    notes = []
    time_s = channels["time_s"]
    for name in (*_MOVED, *_DRAWN):
        if name not in channels:
            continue
        values = channels[name]
        fresh = _fresh_samples(values)
        if fresh is None:
            continue
        phrase = f"{name} is held for {duration_s / len(fresh):.2g} s at a time"
        if name in _DRAWN:
            is_fresh = np.isin(np.arange(len(values)), fresh)
            channels[name] = np.where(is_fresh, values, np.nan)
            notes.append(f"{phrase}: only fresh readings count")
            continue
        readings = values[fresh]
        readings_s = time_s[fresh]
        is_smooth = _is_smooth(readings)
        if name in _SET and not is_smooth:
            continue  # it follows a command that is held
        # Between readings the channel is taken to walk at random: over time its mean squared error
        # is a share of its mean squared step from reading to reading.
        if is_smooth:
            share = 1.0 / 6.0  # a Brownian bridge
            channels[name] = np.interp(time_s, readings_s, readings)
            notes.append(f"{phrase}: values between are interpolated")
        else:
            # on average a quarter of the time between readings away from the nearest
            share = 1.0 / 4.0
            middle_s = 0.5 * (readings_s[1:] + readings_s[:-1])
            channels[name] = readings[np.searchsorted(middle_s, time_s)]
            notes.append(f"{phrase}: the nearest reading counts")
        variance = share * np.mean(np.diff(readings) ** 2)
        error[_CHANNEL_OF.get(name, name)] = float(np.sqrt(variance))
    return error, notes


def _spikes(values: Array) -> Mask:
    """Samples far from both their neighbours and beyond the range of all others."""
    spikes = np.zeros(len(values), dtype=bool)
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) < thresholds.FEWEST_SAMPLES:
        return spikes
    readings = values[finite]
    padded = np.pad(readings, 1, mode="reflect")
    above_previous = readings - padded[:-2]
    above_next = readings - padded[2:]
    # A reading between its neighbours is no spike, however far apart they are.
    sticks_out = np.sign(above_previous) == np.sign(above_next)
    height = np.where(sticks_out, np.minimum(np.abs(above_previous), np.abs(above_next)), 0.0)
    suspect = height > thresholds.SPIKE * white_noise(readings)
    # Many of them are how this channel behaves.
    if 0 < suspect.sum() <= thresholds.MOST_SPIKES * len(readings):
        deviation = np.abs(readings - np.median(readings))
        beyond = deviation > thresholds.HALF_AGAIN * np.max(deviation[~suspect])
        spikes[finite[suspect & beyond]] = True
    return spikes


def _near_starts(spikes: Mask, channels: Mapping[str, Array], robot: Robot) -> Mask:
    """Samples near starts, where most starts have a spike of power, as it is a part of the load;
    none otherwise."""
    time_s = channels["time_s"]
    speed = np.abs(np.nan_to_num(speed_of(channels)))
    slow = speed <= thresholds.STANDSTILL_SHARE * robot.max_speed_mps
    moves = ~slow
    if slow.any() and np.median(speed[slow]) == 0.0:
        moves = speed > 0.0  # the sensor shows rest as an exact zero
    starts_s = time_s[1:][moves[1:] & ~moves[:-1]]
    near_start = np.zeros(len(time_s), dtype=bool)
    starts_with_spike = 0
    for start_s in starts_s.tolist():
        around = np.abs(time_s - start_s) <= WINDOW_S
        near_start |= around
        if (spikes & around).any():
            starts_with_spike += 1
    if 2 * starts_with_spike <= len(starts_s):
        return np.zeros(len(time_s), dtype=bool)
    return near_start


def _silent(drawn: Array, drives: Mask) -> Mask:
    """Samples of driving where a meter of battery power reads zero, as at its restart: the load is
    never zero."""
    zero = drawn == 0.0
    zero_next = np.append(zero[1:], False)
    zero_previous = np.insert(zero[:-1], 0, False)
    silent = zero & drives & (zero_next | zero_previous)
    # Zero most of the time is what this meter shows, not its restart.
    if silent.mean() > thresholds.MOST_SILENT:
        return np.zeros(len(drawn), dtype=bool)
    return np.asarray(silent)


def _charging(drawn: Array, stands: Mask, time_s: Array) -> Mask:
    """Samples at standstill with negative power, for some seconds on end."""
    of_driving = drawn[~stands & np.isfinite(drawn)]
    typical = float(of_driving.mean()) if len(of_driving) else 0.0
    # A meter whose zero is off may read slightly negative at rest.
    flows_back = stands & (drawn < -thresholds.ZERO_ERROR * max(typical, 0.0))
    charging = np.zeros(len(time_s), dtype=bool)
    edges = np.flatnonzero(np.diff(flows_back.astype(np.int8), prepend=0, append=0))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        if time_s[end - 1] - time_s[start] >= thresholds.CHARGES_S:
            charging[start:end] = True
    return charging


def _fresh_samples(values: Array) -> Index | None:
    """Samples at which a held channel is fresh, or None where it is not held.

    A held channel changes at most every other sample and at even distances.
    """
    finite = np.flatnonzero(np.isfinite(values))
    changes = np.flatnonzero(np.diff(values[finite]) != 0.0) + 1
    if len(changes) < thresholds.FEWEST_SAMPLES:
        return None
    apart = np.diff(changes)
    period = int(np.median(apart))  # of readings, in samples
    if period < 2:
        return None
    periods = np.maximum(np.rint(apart / period), 1.0)
    off = np.abs(apart - periods * period)
    jitter = thresholds.JITTER * period if period > 2 else 0.0
    if float((off <= jitter).mean()) < thresholds.HELD:
        return None
    # A fresh reading may equal the one before, as at rest: readings lie a period apart also where
    # nothing changes.
    before_changes = np.arange(changes[0], -1, -period)[:0:-1]
    readings = [before_changes]
    for start, end, count in zip(changes[:-1], changes[1:], periods.astype(int), strict=True):
        readings.append(np.linspace(start, end, count, endpoint=False))
    readings.append(np.arange(changes[-1], len(finite), period))
    fresh = np.rint(np.concatenate(readings)).astype(np.intp)
    return np.asarray(finite[np.unique(fresh)])


def _is_smooth(readings: Array) -> bool:
    """Whether held readings are autocorrelated enough to interpolate between them."""
    centred = readings - readings.mean()
    lag_one = float(centred[1:] @ centred[:-1])
    return lag_one > thresholds.HALF * float(centred @ centred)
