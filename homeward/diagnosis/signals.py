"""What the diagnosis works on: the channels of a run in one form, and their means over short windows.

Means over windows of about a second take out current ripple and small clock errors, and make the cost of everything
after the replay independent of the sampling rate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from homeward.diagnosis.recordings import Recording
from homeward.physics import Robot

Array = NDArray[np.float64]
Unit = Literal["W", "A"]

_GAP_FACTOR = 10.0  # a step longer than this many usual steps is a gap
_GRADE_BASE_M = 2.0  # elevation is differentiated over this distance
_REACH_S = 3.0  # at top speed
_CREEPS = 0.02  # of the top speed
_FILLED = ("grade_rad", "sensing_hz", "temperature_c", "base_distance_m")


@dataclass(frozen=True)
class Signals:
    """One run as the replay and the tests take it; arrays of shape (n,).

    `observed` is battery power in W or, where only motor current was recorded, the sum of the currents' magnitudes
    in A: torque draws current whichever way it turns a wheel. `context` holds every further channel that a mismatch may
    depend on.
    """

    name: str
    unit: Unit
    time_s: Array
    speed_mps: Array  # negative in reverse
    accel_mps2: Array
    grade_rad: Array
    sensing_hz: Array
    yaw_rate_radps: Array  # 0 where unknown
    temperature_c: Array
    base_distance_m: Array
    direction: Array  # 1 on the way out, -1 on the way home
    observed: Array
    context: Mapping[str, Array]
    filled: tuple[str, ...] = ()


def signals(recording: Recording, robot: Robot) -> Signals:
    """Bring a recording into one form; samples without motion or power are left out.

    Args:
        recording: The recording.
        robot: Its robot: the track turns a difference of wheel speeds into a turning rate.
    """
    given = recording.channels
    speed = given["speed_mps"] if "speed_mps" in given else (given["wheel_left_mps"] + given["wheel_right_mps"]) / 2.0
    observed, unit = observed_of(given)
    good = np.isfinite(speed) & np.isfinite(observed)
    kept = {name: values[good] for name, values in given.items()}
    speed, observed, time_s = _at_rest(speed[good], robot), observed[good], kept["time_s"]
    filled = []
    for name in _FILLED:
        values = kept.get(name)
        if values is not None and np.isnan(values).any():
            kept[name] = _interpolated(values, time_s)
            filled.append(name)
    nothing = np.zeros(len(time_s))
    turning, yaw_rate = _turning(kept, time_s, robot)
    context: dict[str, Array] = {
        name: kept[name]
        for name in ("sensing_hz", "temperature_c", "payload_kg", "soc", "base_distance_m", "heading_rad", "voltage_v")
        if name in kept
    }
    context |= turning
    accel = np.gradient(speed, time_s) if len(time_s) > 1 else nothing
    direction = _direction(kept, speed, time_s, robot)
    if "base_distance_m" in kept and len(time_s) > 1:
        along = direction[:-1] * np.abs(speed[:-1]) * np.diff(time_s)
        context["place_m"] = kept["base_distance_m"][0] + np.concatenate(([0.0], np.cumsum(along)))
    context["accel_mps2"] = accel
    context["speed_mps"] = speed
    grade = _grade(kept, speed, time_s)
    if grade is not None:
        context["grade_rad"] = grade
    return Signals(
        recording.name, unit, time_s, speed, accel, nothing if grade is None else grade,
        kept.get("sensing_hz", nothing), yaw_rate, kept.get("temperature_c", np.full(len(time_s), 20.0)),
        kept.get("base_distance_m", nothing), direction, observed, context, tuple(filled),
    )  # fmt: skip


def _direction(kept: Mapping[str, Array], speed: Array, time_s: Array, robot: Robot) -> Array:
    """1 where the robot moves away from base and -1 where it comes back, by stretches that a position's noise is
    small against; the sign of the speed where the distance from base is unknown."""
    place_m = kept.get("base_distance_m")
    if place_m is None or len(time_s) < 2:
        return np.where(speed < 0.0, -1.0, 1.0)
    path_m = np.concatenate(([0.0], np.cumsum(np.abs(speed[:-1]) * np.diff(time_s))))
    reach_m = _REACH_S * robot.max_speed_mps
    path_m += 1e-9 * np.arange(len(path_m))  # interpolation needs it to grow
    ahead, behind = (np.interp(path_m + sign * reach_m, path_m, place_m) for sign in (1.0, -1.0))
    return np.where(ahead < behind, -1.0, 1.0)


def _at_rest(speed: Array, robot: Robot) -> Array:
    """The speed with what is too slow to be driving set to zero: a noisy sensor never shows a robot at rest."""
    return np.where(np.abs(speed) < _CREEPS * robot.max_speed_mps, 0.0, speed)


def observed_of(given: Mapping[str, Array]) -> tuple[Array, Unit]:
    """Battery power in W or, from motor currents alone, the sum of their magnitudes in A, by a recording's channels."""
    if "power_w" in given:
        return given["power_w"], "W"
    if "voltage_v" in given and "current_a" in given:
        return given["voltage_v"] * given["current_a"], "W"
    return np.abs(given["motor_left_a"]) + np.abs(given["motor_right_a"]), "A"


def _turning(kept: Mapping[str, Array], time_s: Array, robot: Robot) -> tuple[dict[str, Array], Array]:
    """Turning as the recording has it: a rate in rad/s or, without a track, a difference of wheel speeds in m/s."""
    if "yaw_rate_radps" in kept:
        rate = kept["yaw_rate_radps"]
    elif "wheel_left_mps" in kept and "wheel_right_mps" in kept:
        difference = kept["wheel_right_mps"] - kept["wheel_left_mps"]
        if robot.track_m == 0.0:
            return {"wheel_difference_mps": difference}, np.zeros(len(time_s))
        rate = difference / robot.track_m
    elif "heading_rad" in kept and len(time_s) > 1 and not np.isnan(kept["heading_rad"]).any():
        rate = np.gradient(np.unwrap(kept["heading_rad"]), time_s)
    else:
        return {}, np.zeros(len(time_s))
    return {"yaw_rate_radps": rate}, np.nan_to_num(rate)


def _grade(kept: Mapping[str, Array], speed: Array, time_s: Array) -> Array | None:
    if "grade_rad" in kept:
        return kept["grade_rad"]
    if "elevation_m" not in kept or len(time_s) < 2:
        return None
    elevation = _interpolated(kept["elevation_m"], time_s)
    place_m = np.concatenate(([0.0], np.cumsum(speed[:-1] * np.diff(time_s))))
    path_m = np.concatenate(([0.0], np.cumsum(np.abs(speed[:-1]) * np.diff(time_s))))
    if path_m[-1] < 2 * _GRADE_BASE_M:
        return None
    # Differentiate over distance driven, on a grid, so that standing still and noise make no slope.
    grid = np.arange(0.0, path_m[-1], _GRADE_BASE_M / 4)
    moving = np.concatenate(([True], np.diff(path_m) > 0.0))
    height = np.interp(grid, path_m[moving], elevation[moving])
    along = np.interp(grid, path_m[moving], place_m[moving])
    span = 4
    rise = height[span:] - height[:-span]
    run = along[span:] - along[:-span]
    steep = np.where(np.abs(run) > _GRADE_BASE_M / 2, rise / np.where(run == 0.0, 1.0, run), np.nan)
    middle = grid[span // 2 : -span // 2]
    known = np.isfinite(steep)
    if not known.any():
        return None
    slope: Array = np.arctan(np.interp(path_m, middle[known], np.clip(steep[known], -1.0, 1.0)))
    return slope


def _interpolated(values: Array, time_s: Array) -> Array:
    known = np.isfinite(values)
    return np.interp(time_s, time_s[known], values[known]) if known.any() else np.zeros(len(values))


@dataclass(frozen=True)
class Windows:
    """Bounds of the averaging windows of one run; none reaches across a gap."""

    start: NDArray[np.intp]  # (windows,), first sample
    keep: NDArray[np.bool_]  # (windows,), filled at least half

    def means(self, values: Array) -> Array:
        """Mean of each kept window, NaN left out of none: a window with a NaN is NaN."""
        counts = np.diff(np.append(self.start, len(values)))
        averages: Array = (np.add.reduceat(values, self.start) / counts)[self.keep]
        return averages

    def samples(self, means: Array, count: int) -> Array:
        """For each of `count` samples the value of its window, or of the kept one before it; the reverse of `means`."""
        window = np.searchsorted(self.start, np.arange(count), side="right") - 1
        values: Array = means[np.maximum(np.cumsum(self.keep)[window] - 1, 0)]
        return values


def usual_step_s(time_s: Array) -> float:
    """Median time between samples, s."""
    return float(np.median(np.diff(time_s)))


def gaps(time_s: Array) -> NDArray[np.intp]:
    """Indices of samples after which the recording has a gap."""
    steps = np.diff(time_s)
    return np.flatnonzero(steps > _GAP_FACTOR * np.median(steps))


def windows(time_s: Array, window_s: float) -> Windows:
    """Cut a run into windows of `window_s`, starting anew after each gap."""
    parts = np.split(np.arange(len(time_s)), gaps(time_s) + 1)
    starts = []
    for part in parts:
        number = np.floor((time_s[part] - time_s[part[0]]) / window_s + 1e-9)
        starts.append(part[0] + np.flatnonzero(np.diff(number, prepend=-1.0)))
    start = np.concatenate(starts).astype(np.intp)
    counts = np.diff(np.append(start, len(time_s)))
    return Windows(start, counts >= 0.5 * np.median(counts))
