"""Input of the diagnosis: the channels of a run in one form, and their means over short windows.

Means over windows of about a second average out current ripple and small clock errors, and make the run time after the
replay independent of the sampling rate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from scipy.ndimage import uniform_filter1d

from homeward.diagnosis import thresholds
from homeward.diagnosis.read.noise import smoothed, white_noise
from homeward.diagnosis.read.slope import slope_along
from homeward.diagnosis.read.way import along_the_way
from homeward.logs.channels import Array, Index, Mask
from homeward.logs.recordings import Recording
from homeward.logs.times import median_step_s
from homeward.physics import Robot
from homeward.physics.log_replay import Recorded, conditions

Unit = Literal["W", "A"]

WINDOW_S = 0.5
"""Length of the averaging windows, s; longer for a recording with longer steps.

Longer ones hide the accelerations of small fast robots, shorter ones show current ripple and clock errors.
"""

_REACH_S = 3.0  # at top speed, along which position is compared; chosen: long against its noise
_FILLED = ("grade_rad", "sensing_hz", "temperature_c", "base_distance_m")
_STILL: Mapping[str, Any] = {"headwind_mps": 0.0, "roughness": None}  # not recorded: no wind, the file's roughness
_REPLAYED = ("speed_mps", "accel_mps2", "yaw_rate_radps", "direction", *_FILLED)
_CONTEXT = ("sensing_hz", "temperature_c", "payload_kg", "soc", "base_distance_m", "heading_rad", "voltage_v")


@dataclass(frozen=True)
class Signals:
    """One run, the input of the replay and the tests; arrays of shape (n,).

    `observed` is battery power in W or, where only motor current was recorded, the sum of the currents' magnitudes
    in A: torque draws current in either direction. `context` holds every further channel that a mismatch may depend on.
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
    _: KW_ONLY
    filled: tuple[str, ...] = ()
    odometer_scale: float = 0.0  # relative error of the recorded speed, by a recorded distance; corrected
    at_terminals: bool = False  # whether `observed` is voltage times current, without internal battery losses
    error: Mapping[str, float] = field(default_factory=dict)  # standard deviation of a channel's error over windows
    start_s: float = 0.0  # added to `time_s` for the time since 1970, where it is known
    tilt_error_rad: float = 0.0  # standard error of the tilt of the slope sensor; 0 where no drive shows it

    @cached_property
    def conditions(self) -> Recorded:
        """What is replayed."""
        return self.conditions_with()

    def conditions_with(self, **changed: Any) -> Recorded:
        """What is replayed, with some channels changed or added."""
        own = {name: getattr(self, name) for name in _REPLAYED}
        return conditions(self.time_s, **{**_STILL, **own, **changed})

    def only(self, chosen: Mask) -> Signals:
        """The run with these samples only."""
        if chosen.all():
            return self
        arrays: dict[str, Any] = {
            name: values[chosen] for name, values in vars(self).items() if isinstance(values, np.ndarray)
        }
        return replace(self, **arrays, context={name: values[chosen] for name, values in self.context.items()})


def signals(
    recording: Recording,
    robot: Robot,
    slope_late_s: float = 0.0,
    known_error: Mapping[str, float] | None = None,
    sloped: bool = True,
) -> Signals:
    """Bring a recording into one form; samples without motion or power are left out.

    Speed, turning rate and slope are smoothed where their noise matters.

    Args:
        recording: The recording.
        robot: Its robot: the track turns a difference of wheel speeds into a turning rate.
        slope_late_s: Time by which grade or elevation is late.
        known_error: Standard deviations over windows of errors of channels that their noise does not show.
        sloped: Whether an elevation shows slopes (`slopes_known`).
    """
    given = recording.channels
    good = np.isfinite(speed_of(given))
    kept = {name: values[good] for name, values in given.items()}
    (observed, unit), time_s = observed_of(kept), kept["time_s"]
    error: dict[str, float] = {}
    speed = speed_of(kept)
    scale = _odometer_scale(kept, speed, time_s)
    recorded = speed / (1.0 + scale)
    speed = _without_noise("speed_mps", recorded, time_s, error)
    speed = _at_rest(
        recorded,
        speed,
        max(thresholds.STANDSTILL_SHARE * robot.max_speed_mps, thresholds.CLEAR * error.get("speed_mps", 0.0)),
    )
    filled = [name for name in _FILLED if name in kept and np.isnan(kept[name]).any()]
    kept |= {name: _interpolated(kept[name], time_s) for name in filled}
    nothing = np.zeros(len(time_s))
    turning, yaw_rate = _turning(kept, time_s, robot, error)
    accel = np.gradient(speed, time_s) if len(time_s) > 1 else nothing
    context = {name: kept[name] for name in _CONTEXT if name in kept} | turning
    grade = slope_of(kept, speed, time_s, robot, slope_late_s, error) if sloped or "grade_rad" in kept else None
    direction = np.where(speed < 0.0, -1.0, 1.0)
    if "base_distance_m" in kept and len(time_s) > 1:
        driven_m, reach_m = path_m(np.abs(speed), time_s), _REACH_S * robot.max_speed_mps
        clear = grade is not None and error.get("grade_rad", 0.0) ** 2 <= thresholds.UNCLEAR * float(np.var(grade))
        slope = grade if clear else None
        direction, context["place_m"] = along_the_way(kept["base_distance_m"], driven_m, slope, reach_m)
    context |= {"accel_mps2": accel, "speed_mps": speed} | ({} if grade is None else {"grade_rad": grade})
    error |= {name: max(one, error.get(name, 0.0)) for name, one in (known_error or {}).items()}
    run = Signals(
        recording.name, unit, time_s, speed, accel, nothing if grade is None else grade,
        kept.get("sensing_hz", nothing), yaw_rate, kept.get("temperature_c", np.full(len(time_s), 20.0)),
        kept.get("base_distance_m", nothing), direction, observed, context,
        filled=tuple(filled), odometer_scale=scale, at_terminals=unit == "W" and "power_w" not in given, error=error,
        start_s=recording.start_s,
    )  # fmt: skip
    when = time_s + (slope_late_s if grade is not None else 0.0)
    there = (when >= time_s[0]) & (when <= time_s[-1])  # the slope of the last moments was not yet recorded
    return run.only(np.isfinite(observed) & there)


def _at_rest(recorded: Array, speed: Array, slowest_mps: float) -> Array:
    """The speed with rest detected: below a threshold for a noisy sensor, at exact zeros for one that shows them.

    Exact zeros keep the time of a start: a sample late may be a window late."""
    slow = np.abs(speed) < slowest_mps
    if slow.all() or not slow.any() or np.median(np.abs(recorded[slow])) > 0.0:
        return np.where(slow, 0.0, speed)
    index = np.arange(len(speed))
    forward = np.interp(index, index[~slow], speed[~slow]) >= 0.0  # sign of the motion before and after
    return np.where(slow, np.where(forward, slowest_mps, -slowest_mps) * (recorded != 0.0), speed)


def speed_of(given: Mapping[str, Array]) -> Array:
    """Recorded speed, or the mean of the wheels'."""
    if "speed_mps" in given:
        return given["speed_mps"]
    return np.asarray((given["wheel_left_mps"] + given["wheel_right_mps"]) / 2.0)


def known(recording: Recording) -> Mask:
    """Samples with motion and power, shape (n,)."""
    return np.isfinite(speed_of(recording.channels)) & np.isfinite(observed_of(recording.channels)[0])


def _odometer_scale(kept: Mapping[str, Array], speed: Array, time_s: Array) -> float:
    """Relative error of the speed by a recorded distance; 0 unless all parts of the way agree that there is one."""
    if "distance_m" not in kept or len(time_s) < thresholds.FEWEST_BLOCKS:
        return 0.0
    covered_m, driven_m = np.diff(kept["distance_m"]), np.abs(speed[:-1]) * steps_s(time_s)
    moving = driven_m > 0.0
    if not moving.any() or not np.isfinite(covered_m).all() or (covered_m < -thresholds.RESET_M).any():
        return 0.0
    covered_m, driven_m = np.abs(covered_m[moving]), driven_m[moving]
    passed = np.cumsum(driven_m) / driven_m.sum()
    part = np.minimum((passed * thresholds.FEWEST_BLOCKS).astype(np.intp), thresholds.FEWEST_BLOCKS - 1)
    by_part = np.bincount(part, driven_m) / np.maximum(np.bincount(part, covered_m), 1e-9) - 1.0
    if not ((by_part > thresholds.SAME_ODOMETER).all() or (by_part < -thresholds.SAME_ODOMETER).all()):
        return 0.0
    return float(driven_m.sum() / covered_m.sum() - 1.0)


def observed_of(given: Mapping[str, Array]) -> tuple[Array, Unit]:
    """Battery power in W or, from motor currents alone, the sum of their magnitudes in A, by a recording's channels."""
    if "power_w" in given:
        return given["power_w"], "W"
    if "voltage_v" in given and "current_a" in given:
        return given["voltage_v"] * given["current_a"], "W"
    return np.abs(given["motor_left_a"]) + np.abs(given["motor_right_a"]), "A"


def _turning(
    kept: Mapping[str, Array], time_s: Array, robot: Robot, error: dict[str, float]
) -> tuple[dict[str, Array], Array]:
    """Recorded turning: a rate in rad/s or, without a track, a difference of wheel speeds in m/s."""
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
    if np.isfinite(rate).all():
        rate = _without_noise("yaw_rate_radps", rate, time_s, error)
        # Zero where it does not significantly differ from that over a window: the power of turning rises steeply with
        # the size of the rate, and noise about zero would count as a turn.
        size = max(1, round(WINDOW_S / median_step_s(time_s)))
        noise = thresholds.CLEAR * error.get("yaw_rate_radps", 0.0)
        rate = np.where(np.abs(uniform_filter1d(rate, size)) < noise, 0.0, rate)
    return {"yaw_rate_radps": rate}, np.nan_to_num(rate)


def slope_of(
    given: Mapping[str, Array], speed: Array, time_s: Array, robot: Robot, late_s: float,
    error: dict[str, float] | None = None,
) -> Array | None:  # fmt: skip
    """Slope angle along forward travel, rad, shape (n,), from grade or elevation; None without either.

    Args:
        given: Channels of a recording, shape (samples,) each, with its `time_s`.
        speed, time_s: Speed, negative in reverse, and its time, shape (n,).
        robot: The robot, for how far it drives in a window.
        late_s: Time by which the channel is late.
        error: Receives the standard deviation of its error over windows; None for a faster, less exact result.
    """
    name = "grade_rad" if "grade_rad" in given else "elevation_m"
    if name not in given or len(time_s) < 2:
        return None
    values: Array = np.interp(time_s + late_s, given["time_s"], _interpolated(given[name], given["time_s"]))
    if name == "grade_rad":
        return values if error is None else _without_noise(name, values, time_s, error)
    after = gaps(time_s) + 1  # the distance driven in a gap is unknown: its rise is removed
    values = values - np.cumsum(np.bincount(after, values[after] - values[after - 1], len(values)))
    found = slope_along(values, speed, steps_s(time_s), robot.max_speed_mps * WINDOW_S, kinks=error is not None)
    if found is None:
        return None
    if error is not None:
        error["grade_rad"] = found[1]
    return found[0]


def slopes_known(runs: Sequence[Signals]) -> bool:
    """Whether the slopes from an elevation, in all runs together, are larger than their own error."""
    known = [run for run in runs if "grade_rad" in run.context]
    squared = sum(float(run.grade_rad @ run.grade_rad) for run in known)
    return squared >= sum(len(run.grade_rad) * run.error.get("grade_rad", 0.0) ** 2 for run in known)


def _without_noise(name: str, values: Array, time_s: Array, error: dict[str, float]) -> Array:
    """The channel, smoothed where its noise is material in its window means or, of speed, in their changes."""
    if len(values) < thresholds.FEWEST_SAMPLES or not np.ptp(values):
        return values
    size = max(1, round(WINDOW_S / median_step_s(time_s)))
    noise = white_noise(values)
    means = uniform_filter1d(values, size)[::size]
    spread, change = float(np.var(means)), float(np.mean(np.diff(means) ** 2))
    # Acceleration, the rate of change of speed, is noisier.
    if noise**2 / size <= thresholds.NEGLIGIBLE_NOISE * (min(spread, change) if name == "speed_mps" else spread):
        error[name] = float(noise / np.sqrt(size))
        return values
    breaks = np.ones(len(values) - 2)
    breaks[np.clip(gaps(time_s)[:, None] - [0, 1], 0, len(breaks) - 1)] = 0.0
    found = smoothed(values, 2, breaks=breaks, jumps=True, noise=noise)
    error[name] = float(np.std(uniform_filter1d(found.draws, size, axis=1)))
    return found.values


def _interpolated(values: Array, time_s: Array) -> Array:
    good = np.isfinite(values)
    return np.interp(time_s, time_s[good], values[good]) if good.any() else np.zeros(len(values))


@dataclass(frozen=True)
class Windows:
    """Bounds of the averaging windows of one run; none reaches across a gap."""

    start: Index  # (windows,), first sample
    counts: Index  # (windows,), samples of each
    keep: Mask  # (windows,), filled at least half

    def means(self, values: Array) -> Array:
        """Mean of each kept window; a window with a NaN is NaN."""
        return np.asarray((np.add.reduceat(values, self.start) / self.counts)[self.keep])

    def samples(self, means: Array, count: int) -> Array:
        """For each of `count` samples the value of its window, or of the kept one before it; the reverse of `means`."""
        window = np.searchsorted(self.start, np.arange(count), side="right") - 1
        return np.asarray(means[np.maximum(np.cumsum(self.keep)[window] - 1, 0)])


def steps_s(time_s: Array) -> Array:
    """Time between samples, s, shape (n - 1,); of a gap the median step, as its driving is unknown."""
    steps, typical = np.diff(time_s), median_step_s(time_s)
    return np.where(steps > thresholds.GAP * typical, typical, steps)


def path_m(speed: Array, time_s: Array) -> Array:
    """Way driven until each sample, m, shape (n,)."""
    return np.concatenate(([0.0], np.cumsum(speed[:-1] * steps_s(time_s))))


def gaps(time_s: Array) -> Index:
    """Indices of samples after which the recording has a gap."""
    return np.flatnonzero(np.diff(time_s) > thresholds.GAP * median_step_s(time_s))


def windows(time_s: Array, window_s: float) -> Windows:
    """Cut a run into windows of `window_s`, starting anew after each gap."""
    begins = np.append(0, gaps(time_s) + 1)
    part = np.searchsorted(begins, np.arange(len(time_s)), side="right") - 1
    number = np.floor((time_s - time_s[begins][part]) / window_s + 1e-9)
    start = np.union1d(begins, np.flatnonzero(np.diff(number, prepend=-1.0)))
    counts = np.diff(np.append(start, len(time_s)))
    return Windows(start, counts, counts >= thresholds.HALF * np.median(counts))
