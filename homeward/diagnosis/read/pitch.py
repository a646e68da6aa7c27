"""Tilt of a slope sensor, estimated from ways that close or are driven both ways, where the mean
slope is zero."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import binned_statistic

from homeward.diagnosis import thresholds
from homeward.diagnosis.read.signals import Signals, gaps
from homeward.logs.channels import Array
from homeward.logs.thresholds import MOST_CORRELATED

# cells along the way, compared out and home; chosen: 30 or 80 change no test of tests/diagnosis on
# tilt
_PLACES = 40


def tilt(run: Signals) -> tuple[float, float] | None:
    """Tilt of the slope sensor of a run and its standard error, rad; positive if it reads too much;
    None if unknown."""
    if "place_m" not in run.context or "grade_rad" not in run.context or len(gaps(run.time_s)):
        return None
    steps_m = run.speed_mps[:-1] * np.diff(run.time_s)
    length_m = float(np.abs(steps_m).sum())
    if length_m == 0.0:
        return None
    slope = np.tan(run.grade_rad)
    near_base = np.flatnonzero(run.base_distance_m <= thresholds.CLOSED * length_m)
    if len(near_base):
        start = near_base[0]
        end = near_base[-1]
        closed = slice(start, end)
        onward_m = float(steps_m[closed].sum())
        # The slope is unknown over the gap of the way and over the odometer's error.
        gap_m = float(abs(run.base_distance_m[end] - run.base_distance_m[start]))
        unknown_m = max(gap_m, thresholds.CLOSED * length_m / 2.0)
        if abs(onward_m) > thresholds.HALF * length_m:
            mean = float(slope[closed] @ steps_m[closed]) / onward_m
            error = float(np.std(slope)) * unknown_m / abs(onward_m)
            return mean, error
    return _both_ways(run, slope)


def _both_ways(run: Signals, slope: Array) -> tuple[float, float] | None:
    """Mean of the slopes read out and home at the same distance from base, where they are
    anticorrelated, and its standard error."""
    if not (run.speed_mps > 0.0).any() or not np.ptp(run.base_distance_m):
        return None
    out = _by_place(run, slope, direction=1.0)
    home = _by_place(run, slope, direction=-1.0)
    driven_both_ways = np.isfinite(out) & np.isfinite(home)
    out = out[driven_both_ways]
    home = home[driven_both_ways]
    if len(out) < thresholds.HALF * _PLACES or not np.ptp(out) * np.ptp(home):
        return None
    # The hills have opposite signs, and cancel; the tilt has the same.
    if np.corrcoef(out, home)[0, 1] > -thresholds.NEARLY_ALL:
        return None
    middle = (out + home) / 2.0
    # The error of hills that do not quite mirror is autocorrelated along the way.
    lag_one = np.corrcoef(middle[1:], middle[:-1])[0, 1]
    correlation = float(np.clip(lag_one, 0.0, MOST_CORRELATED))
    error = float(middle.std(ddof=1) / np.sqrt(len(middle)))
    inflation = float(np.sqrt((1.0 + correlation) / (1.0 - correlation)))
    return float(middle.mean()), error * inflation


def _by_place(run: Signals, slope: Array, direction: float) -> Array:
    """Mean slope in each cell of the distance from base on one way, (places,); NaN where the robot
    did not drive."""
    driven = (run.speed_mps > 0.0) & (run.direction == direction)
    base_m = run.base_distance_m
    ends_m = base_m.min(), base_m.max()
    return np.asarray(
        binned_statistic(base_m[driven], slope[driven], "mean", _PLACES, ends_m).statistic
    )


def without_tilt(runs: Sequence[Signals]) -> tuple[list[Signals], float]:
    """The runs without the tilt of the slope sensor, estimated from all together; the tilt, rad, 0
    if not clear.

    The runs hold its standard error, and where it is not clear also what it may be.
    """
    tilts = [tilt(run) for run in runs]
    estimates = [estimate for estimate in tilts if estimate is not None]
    if not estimates:
        return list(runs), 0.0
    angles_rad, errors_rad = np.array(estimates).T
    weight = 1.0 / np.maximum(errors_rad, 1e-6) ** 2
    angle_rad = float(np.average(angles_rad, weights=weight))
    # Between runs it may vary by more than its standard error.
    spread_rad = float(np.std(angles_rad)) / np.sqrt(len(angles_rad))
    mean_error_rad = max(float(weight.sum() ** -0.5), spread_rad)
    is_clear = abs(angle_rad) > thresholds.FAR_APART * mean_error_rad
    # Runs on one route have the same error: their mean is no better than one of them.
    run_error_rad = max(np.average(errors_rad, weights=weight), spread_rad)
    uncorrected_rad = 0.0 if is_clear else angle_rad
    tilt_error_rad = float(np.hypot(run_error_rad, uncorrected_rad))
    level = []
    for run in runs:
        corrected = replace(run, tilt_error_rad=tilt_error_rad)
        if is_clear and "grade_rad" in run.context:
            context = {**run.context, "grade_rad": run.context["grade_rad"] - angle_rad}
            corrected = replace(corrected, grade_rad=run.grade_rad - angle_rad, context=context)
        level.append(corrected)
    if not is_clear:
        return level, 0.0
    return level, angle_rad
