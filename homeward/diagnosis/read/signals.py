"""Input of the diagnosis: the channels of a run in one form, and their means over short windows.

Means over windows of about a second average out current ripple and small clock errors, and make the
run time after the replay independent of the sampling rate.
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

Longer ones hide the accelerations of small fast robots, shorter ones show current ripple and clock
errors.
"""

_REACH_S = 3.0  # at top speed, along which position is compared; chosen: long against its noise
_ROOM_TEMPERATURE_C = 20.0  # where none was recorded
_FILLED = ("grade_rad", "sensing_hz", "temperature_c", "base_distance_m")
# not recorded: no wind, the file's roughness
_STILL: Mapping[str, Any] = {"headwind_mps": 0.0, "roughness": None}
_REPLAYED = ("speed_mps", "accel_mps2", "yaw_rate_radps", "direction", *_FILLED)
_CONTEXT = (
    "sensing_hz",
    "temperature_c",
    "payload_kg",
    "soc",
    "base_distance_m",
    "heading_rad",
    "voltage_v",
)


@dataclass(frozen=True)
class Signals:
    """One run, the input of the replay and the tests; arrays of shape (n,).

    `observed` is battery power in W or, where only motor current was recorded, the sum of the
    currents' magnitudes in A: torque draws current in either direction. `context` holds every
    further channel that a mismatch may depend on.
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
    # relative error of the recorded speed, by a recorded distance; corrected
    odometer_scale: float = 0.0
    # whether `observed` is voltage times current, without internal battery losses
    at_terminals: bool = False
    # standard deviation of a channel's error over windows
    error: Mapping[str, float] = field(default_factory=dict)
    start_s: float = 0.0  # added to `time_s` for the time since 1970, where it is known
    # standard error of the tilt of the slope sensor; 0 where no drive shows it
    tilt_error_rad: float = 0.0

    @cached_property
    def conditions(self) -> Recorded:
        """What is replayed."""
        return self.conditions_with()

    def conditions_with(self, **changed: Any) -> Recorded:
        """What is replayed, with some channels changed or added."""
        recorded = {name: getattr(self, name) for name in _REPLAYED}
        return conditions(self.time_s, **{**_STILL, **recorded, **changed})

    def only(self, selected: Mask) -> Signals:
        """The run with the selected samples only; `selected` has shape (n,)."""
        if selected.all():
            return self
        fields = vars(self).items()
        arrays: dict[str, Any] = {
            name: values[selected] for name, values in fields if isinstance(values, np.ndarray)
        }
        context = {name: values[selected] for name, values in self.context.items()}
        return replace(self, **arrays, context=context)


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
        known_error: Standard deviations over windows of errors of channels that their noise does
            not show.
        sloped: Whether an elevation shows slopes (`slopes_known`).
    """
    has_motion = np.isfinite(speed_of(recording.channels))
    channels = {name: values[has_motion] for name, values in recording.channels.items()}
    observed, unit = observed_of(channels)
    time_s = channels["time_s"]
    error: dict[str, float] = {}  # of each channel, filled in below
    recorded_mps = speed_of(channels)
    odometer_scale = _odometer_scale(channels, recorded_mps, time_s)
    speed_mps = _smooth_speed(recorded_mps / (1.0 + odometer_scale), time_s, robot, error)
    filled = _fill(channels)
    zeros = np.zeros(len(time_s))
    accel_mps2 = _rate_of_change(speed_mps, time_s)
    context = {name: channels[name] for name in _CONTEXT if name in channels}
    turning, yaw_rate_radps = _turning(channels, time_s, robot, error)
    context |= turning
    grade_rad = None
    if sloped or "grade_rad" in channels:
        grade_rad = slope_of(channels, speed_mps, time_s, robot, slope_late_s, error)
    direction, place_m = _on_the_way(channels, speed_mps, _clear_slope(grade_rad, error), robot)
    if place_m is not None:
        context["place_m"] = place_m
    context["accel_mps2"] = accel_mps2
    context["speed_mps"] = speed_mps
    if grade_rad is not None:
        context["grade_rad"] = grade_rad
    if known_error is not None:
        error |= _larger(known_error, error)
    run = Signals(
        name=recording.name,
        unit=unit,
        time_s=time_s,
        speed_mps=speed_mps,
        accel_mps2=accel_mps2,
        grade_rad=zeros if grade_rad is None else grade_rad,
        sensing_hz=channels.get("sensing_hz", zeros),
        yaw_rate_radps=yaw_rate_radps,
        temperature_c=channels.get("temperature_c", np.full(len(time_s), _ROOM_TEMPERATURE_C)),
        base_distance_m=channels.get("base_distance_m", zeros),
        direction=direction,
        observed=observed,
        context=context,
        filled=filled,
        odometer_scale=odometer_scale,
        at_terminals=unit == "W" and "power_w" not in channels,
        error=error,
        start_s=recording.start_s,
    )
    usable = np.isfinite(observed)
    if grade_rad is not None:
        # the slope of the last moments was not yet recorded
        usable &= _within(time_s + slope_late_s, time_s)
    return run.only(usable)


def _fill(channels: dict[str, Array]) -> tuple[str, ...]:
    """Interpolate missing values of the channels of `_FILLED`; the names of those that have
    some."""
    incomplete = tuple(
        name for name in _FILLED if name in channels and np.isnan(channels[name]).any()
    )
    for name in incomplete:
        channels[name] = _interpolated(channels[name], channels["time_s"])
    return incomplete


def _within(moment_s: Array, time_s: Array) -> Mask:
    """Whether each moment lies within the recorded time, shape (n,)."""
    return np.asarray((moment_s >= time_s[0]) & (moment_s <= time_s[-1]))


def _smooth_speed(
    recorded_mps: Array, time_s: Array, robot: Robot, error: dict[str, float]
) -> Array:
    """The speed without its noise and with rest detected; `error` receives the standard deviation
    of its error."""
    smooth_mps = _without_noise("speed_mps", recorded_mps, time_s, error)
    slowest_of_robot_mps = thresholds.STANDSTILL_SHARE * robot.max_speed_mps
    slowest_of_sensor_mps = thresholds.CLEAR * error.get("speed_mps", 0.0)
    return _with_rest(recorded_mps, smooth_mps, max(slowest_of_robot_mps, slowest_of_sensor_mps))


def _with_rest(recorded_mps: Array, speed_mps: Array, slowest_mps: float) -> Array:
    """The speed with rest detected: below a threshold for a noisy sensor, at exact zeros for one
    that shows them.

    Exact zeros keep the time of a start: a sample late may be a window late.
    """
    slow = np.abs(speed_mps) < slowest_mps
    if slow.all() or not slow.any() or np.median(np.abs(recorded_mps[slow])) > 0.0:
        return np.where(slow, 0.0, speed_mps)
    # A slow sample that is no exact zero moves at the threshold, in the direction of the motion
    # before and after.
    index = np.arange(len(speed_mps))
    forward = np.interp(index, index[~slow], speed_mps[~slow]) >= 0.0
    creeping_mps = np.where(forward, slowest_mps, -slowest_mps) * (recorded_mps != 0.0)
    return np.where(slow, creeping_mps, speed_mps)


def _rate_of_change(values: Array, time_s: Array) -> Array:
    """Derivative by time at each sample, shape (n,); 0 of a single one."""
    if len(values) < 2:
        return np.zeros(len(values))
    return np.asarray(np.gradient(values, time_s))


def _on_the_way(
    channels: Mapping[str, Array], speed_mps: Array, slope: Array | None, robot: Robot
) -> tuple[Array, Array | None]:
    """Direction, 1 on the way out and -1 on the way home, and place on the way, m, of each sample,
    shape (n,) each.

    Where the distance from base is unknown, reverse counts as the way home, and there is no place.
    """
    time_s = channels["time_s"]
    if "base_distance_m" not in channels or len(time_s) < 2:
        return np.where(speed_mps < 0.0, -1.0, 1.0), None
    driven_m = path_m(np.abs(speed_mps), time_s)
    reach_m = _REACH_S * robot.max_speed_mps
    return along_the_way(channels["base_distance_m"], driven_m, slope, reach_m)


def _larger(by_reading: Mapping[str, float], error: Mapping[str, float]) -> dict[str, float]:
    """The known errors of channels, or those that their noise shows where these are larger."""
    return {name: max(deviation, error.get(name, 0.0)) for name, deviation in by_reading.items()}


def _clear_slope(grade_rad: Array | None, error: Mapping[str, float]) -> Array | None:
    """The slope where it varies by more than its error, so that it shows which way the robot
    drives."""
    if grade_rad is None:
        return None
    is_clear = error.get("grade_rad", 0.0) ** 2 <= thresholds.UNCLEAR * float(np.var(grade_rad))
    return grade_rad if is_clear else None


def speed_of(channels: Mapping[str, Array]) -> Array:
    """Recorded speed, or the mean of the wheels', m/s."""
    if "speed_mps" in channels:
        return channels["speed_mps"]
    return np.asarray((channels["wheel_left_mps"] + channels["wheel_right_mps"]) / 2.0)


def known(recording: Recording) -> Mask:
    """Samples with motion and power, shape (n,)."""
    return np.isfinite(speed_of(recording.channels)) & np.isfinite(
        observed_of(recording.channels)[0]
    )


def _odometer_scale(channels: Mapping[str, Array], speed_mps: Array, time_s: Array) -> float:
    """Relative error of the speed by a recorded distance; 0 unless all parts of the way agree that
    there is one."""
    if "distance_m" not in channels or len(time_s) < thresholds.FEWEST_BLOCKS:
        return 0.0
    counted_m = np.diff(channels["distance_m"])
    driven_m = np.abs(speed_mps[:-1]) * steps_s(time_s)
    moving = driven_m > 0.0
    if (
        not moving.any()
        or not np.isfinite(counted_m).all()
        or (counted_m < -thresholds.RESET_M).any()
    ):
        return 0.0
    counted_m = np.abs(counted_m[moving])  # a counter may count down
    driven_m = driven_m[moving]
    passed = np.cumsum(driven_m) / driven_m.sum()
    part = np.minimum(
        (passed * thresholds.FEWEST_BLOCKS).astype(np.intp), thresholds.FEWEST_BLOCKS - 1
    )
    counted_by_part_m = np.maximum(np.bincount(part, counted_m), 1e-9)
    error_by_part = np.bincount(part, driven_m) / counted_by_part_m - 1.0
    all_too_fast = (error_by_part > thresholds.SAME_ODOMETER).all()
    all_too_slow = (error_by_part < -thresholds.SAME_ODOMETER).all()
    if not (all_too_fast or all_too_slow):
        return 0.0
    return float(driven_m.sum() / counted_m.sum() - 1.0)


def observed_of(channels: Mapping[str, Array]) -> tuple[Array, Unit]:
    """Battery power in W or, from motor currents alone, the sum of their magnitudes in A, by a
    recording's channels."""
    if "power_w" in channels:
        return channels["power_w"], "W"
    if "voltage_v" in channels and "current_a" in channels:
        return channels["voltage_v"] * channels["current_a"], "W"
    return np.abs(channels["motor_left_a"]) + np.abs(channels["motor_right_a"]), "A"


def _turning(
    channels: Mapping[str, Array], time_s: Array, robot: Robot, error: dict[str, float]
) -> tuple[dict[str, Array], Array]:
    """Recorded turning by its channel, a rate in rad/s or, without a track, a difference of wheel
    speeds in m/s; and the rate that is replayed, rad/s, 0 where it is unknown."""
    unknown = np.zeros(len(time_s))
    if "yaw_rate_radps" in channels:
        rate_radps = channels["yaw_rate_radps"]
    elif "wheel_left_mps" in channels and "wheel_right_mps" in channels:
        difference_mps = channels["wheel_right_mps"] - channels["wheel_left_mps"]
        if robot.track_m == 0.0:
            return {"wheel_difference_mps": difference_mps}, unknown
        rate_radps = difference_mps / robot.track_m
    elif (
        "heading_rad" in channels
        and len(time_s) > 1
        and not np.isnan(channels["heading_rad"]).any()
    ):
        rate_radps = np.gradient(np.unwrap(channels["heading_rad"]), time_s)
    else:
        return {}, unknown
    if np.isfinite(rate_radps).all():
        rate_radps = _without_noise("yaw_rate_radps", rate_radps, time_s, error)
        # Zero where it does not significantly differ from that over a window: the power of turning
        # rises steeply with the size of the rate, and noise about zero would count as a turn.
        over_window_radps = uniform_filter1d(rate_radps, _window_samples(time_s))
        noise_radps = thresholds.CLEAR * error.get("yaw_rate_radps", 0.0)
        rate_radps = np.where(np.abs(over_window_radps) < noise_radps, 0.0, rate_radps)
    return {"yaw_rate_radps": rate_radps}, np.nan_to_num(rate_radps)


def slope_of(
    channels: Mapping[str, Array],
    speed: Array,
    time_s: Array,
    robot: Robot,
    late_s: float,
    error: dict[str, float] | None = None,
) -> Array | None:
    """Slope angle along forward travel, rad, shape (n,), from grade or elevation; None without
    either.

    Args:
        channels: Of a recording, shape (samples,) each, with its `time_s`.
        speed, time_s: Speed, negative in reverse, and its time, shape (n,).
        robot: The robot, for how far it drives in a window.
        late_s: Time by which the channel is late.
        error: Receives the standard deviation of its error over windows; None for a faster, less
            exact result.
    """
    name = "grade_rad" if "grade_rad" in channels else "elevation_m"
    if name not in channels or len(time_s) < 2:
        return None
    complete = _interpolated(channels[name], channels["time_s"])
    values: Array = np.interp(time_s + late_s, channels["time_s"], complete)
    if name == "grade_rad":
        return values if error is None else _without_noise(name, values, time_s, error)
    # The distance driven in a gap is unknown: its rise is removed.
    after_gap = gaps(time_s) + 1
    rises_m = values[after_gap] - values[after_gap - 1]
    elevation_m = values - np.cumsum(np.bincount(after_gap, rises_m, len(values)))
    cell_m = robot.max_speed_mps * WINDOW_S
    slope_and_error = slope_along(
        elevation_m, speed, steps_s(time_s), cell_m, kinks=error is not None
    )
    if slope_and_error is None:
        return None
    slope_rad, error_rad = slope_and_error
    if error is not None:
        error["grade_rad"] = error_rad
    return slope_rad


def slopes_known(runs: Sequence[Signals]) -> bool:
    """Whether the slopes from an elevation, in all runs together, are larger than their own
    error."""
    sloping = [run for run in runs if "grade_rad" in run.context]
    squared = sum(float(run.grade_rad @ run.grade_rad) for run in sloping)
    squared_error = sum(
        len(run.grade_rad) * run.error.get("grade_rad", 0.0) ** 2 for run in sloping
    )
    return squared >= squared_error


def _window_samples(time_s: Array) -> int:
    """Samples in a window of `WINDOW_S`, at least one."""
    return max(1, round(WINDOW_S / median_step_s(time_s)))


def _without_noise(name: str, values: Array, time_s: Array, error: dict[str, float]) -> Array:
    """The channel, smoothed where its noise is material in its window means or, of speed, in their
    changes."""
    if len(values) < thresholds.FEWEST_SAMPLES or not np.ptp(values):
        return values
    size = _window_samples(time_s)
    noise = white_noise(values)
    means = uniform_filter1d(values, size)[::size]
    signal = float(np.var(means))
    if name == "speed_mps":
        # Acceleration, the rate of change of speed, is noisier.
        signal = min(signal, float(np.mean(np.diff(means) ** 2)))
    if noise**2 / size <= thresholds.NEGLIGIBLE_NOISE * signal:
        error[name] = float(noise / np.sqrt(size))
        return values
    breaks = np.ones(len(values) - 2)
    across_gaps = gaps(time_s)[:, None] - [0, 1]  # two of the second differences reach across each
    breaks[np.clip(across_gaps, 0, len(breaks) - 1)] = 0.0
    smooth = smoothed(values, 2, breaks=breaks, jumps=True, noise=noise)
    error[name] = float(np.std(uniform_filter1d(smooth.draws, size, axis=1)))
    return smooth.values


def _interpolated(values: Array, time_s: Array) -> Array:
    """The channel with missing values interpolated; zeros where all are missing."""
    finite = np.isfinite(values)
    if not finite.any():
        return np.zeros(len(values))
    return np.interp(time_s, time_s[finite], values[finite])


@dataclass(frozen=True)
class Windows:
    """Bounds of the averaging windows of one run; none reaches across a gap."""

    start: Index  # (windows,), first sample
    counts: Index  # (windows,), samples of each
    keep: Mask  # (windows,), filled at least half

    def means(self, values: Array) -> Array:
        """Mean of each kept window; a window with a NaN is NaN."""
        means = np.add.reduceat(values, self.start) / self.counts
        return np.asarray(means[self.keep])

    def samples(self, means: Array, count: int) -> Array:
        """For each of `count` samples the value of its window, or of the kept one before it; the
        reverse of `means`."""
        window = np.searchsorted(self.start, np.arange(count), side="right") - 1
        kept_until = np.cumsum(self.keep)  # kept windows up to each and with it
        return np.asarray(means[np.maximum(kept_until[window] - 1, 0)])


def steps_s(time_s: Array) -> Array:
    """Time between samples, s, shape (n - 1,); of a gap the median step, as its driving is
    unknown."""
    steps = np.diff(time_s)
    median_s = median_step_s(time_s)
    return np.where(steps > thresholds.GAP * median_s, median_s, steps)


def path_m(speed: Array, time_s: Array) -> Array:
    """Way driven until each sample, m, shape (n,)."""
    return np.concatenate(([0.0], np.cumsum(speed[:-1] * steps_s(time_s))))


def gaps(time_s: Array) -> Index:
    """Indices of samples after which the recording has a gap."""
    return np.flatnonzero(np.diff(time_s) > thresholds.GAP * median_step_s(time_s))


def windows(time_s: Array, window_s: float) -> Windows:
    """Cut a run into windows of `window_s`, starting anew after each gap."""
    part_start = np.append(0, gaps(time_s) + 1)  # first samples of the parts between gaps
    part = np.searchsorted(part_start, np.arange(len(time_s)), side="right") - 1
    since_s = time_s - time_s[part_start][part]
    # a sample on the edge begins a window in spite of rounding
    number = np.floor(since_s / window_s + 1e-9)
    start = np.union1d(part_start, np.flatnonzero(np.diff(number, prepend=-1.0)))
    counts = np.diff(np.append(start, len(time_s)))
    return Windows(start, counts, keep=counts >= thresholds.HALF * np.median(counts))
