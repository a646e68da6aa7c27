"""Tilt of a slope sensor, estimated from ways that close or are driven both ways, where the mean slope is zero."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import binned_statistic

from homeward.diagnosis import thresholds
from homeward.diagnosis.read.signals import Signals, gaps
from homeward.logs.channels import Array
from homeward.logs.thresholds import MOST_CORRELATED

_PLACES = 40  # cells along the way, compared out and home; chosen: 30 or 80 change no test of tests/diagnosis on tilt


def tilt(run: Signals) -> tuple[float, float] | None:
    """Tilt of the slope sensor of a run and its standard error, rad; positive if it reads too much; None if unknown."""
    if "place_m" not in run.context or "grade_rad" not in run.context or len(gaps(run.time_s)):
        return None
    steps_m = run.speed_mps[:-1] * np.diff(run.time_s)
    length_m = float(np.abs(steps_m).sum())
    if length_m == 0.0:
        return None
    slope = np.tan(run.grade_rad)
    near = np.flatnonzero(run.base_distance_m <= thresholds.CLOSED * length_m)
    if len(near):
        # The slope is unknown over the gap of the way and over the odometer's error.
        closed = slice(near[0], near[-1])
        onward_m = float(steps_m[closed].sum())
        open_m = max(float(np.ptp(run.base_distance_m[near[[0, -1]]])), thresholds.CLOSED * length_m / 2.0)
        if abs(onward_m) > thresholds.HALF * length_m:
            mean = float(slope[closed] @ steps_m[closed]) / onward_m
            return mean, float(np.std(slope)) * open_m / abs(onward_m)
    return _both_ways(run, slope)


def _both_ways(run: Signals, slope: Array) -> tuple[float, float] | None:
    """Mean of the slopes read out and home at the same distance from base, where they are anticorrelated."""
    moving = run.speed_mps > 0.0
    if not moving.any() or not np.ptp(run.base_distance_m):
        return None
    ends = run.base_distance_m.min(), run.base_distance_m.max()
    ways = (moving & (run.direction == direction) for direction in (1.0, -1.0))
    sides = [binned_statistic(run.base_distance_m[way], slope[way], "mean", _PLACES, ends).statistic for way in ways]
    out, home = np.array(sides)[:, np.isfinite(sides).all(axis=0)]
    if (
        len(out) < thresholds.HALF * _PLACES
        or not np.ptp(out) * np.ptp(home)
        or np.corrcoef(out, home)[0, 1] > -thresholds.NEARLY_ALL
    ):
        return None
    middle = (out + home) / 2.0
    # The error of hills that do not quite mirror is autocorrelated along the way.
    correlation = float(np.clip(np.corrcoef(middle[1:], middle[:-1])[0, 1], 0.0, MOST_CORRELATED))
    error = float(middle.std(ddof=1) / np.sqrt(len(middle)))
    return float(middle.mean()), error * float(np.sqrt((1.0 + correlation) / (1.0 - correlation)))


def without_tilt(runs: Sequence[Signals]) -> tuple[list[Signals], float]:
    """The runs without the tilt of the slope sensor, estimated from all together; the tilt, rad, 0 if not clear.

    The runs hold its standard error, and where it is not clear also what it may be.
    """
    if not (tilts := [found for run in runs if (found := tilt(run)) is not None]):
        return list(runs), 0.0
    angles, errors = np.array(tilts).T
    weight = 1.0 / np.maximum(errors, 1e-6) ** 2
    angle = float(np.average(angles, weights=weight))
    # Between runs it may vary by more than its standard error.
    varies = float(np.std(angles)) / np.sqrt(len(angles))
    clear = abs(angle) > thresholds.FAR_APART * max(float(weight.sum() ** -0.5), varies)
    # Runs on one route have the same error: their mean is no better than one of them.
    error = float(np.hypot(max(np.average(errors, weights=weight), varies), 0.0 if clear else angle))
    level = []
    for run in runs:
        known = replace(run, tilt_error_rad=error)
        if clear and "grade_rad" in run.context:
            context = {**run.context, "grade_rad": run.context["grade_rad"] - angle}
            known = replace(known, grade_rad=run.grade_rad - angle, context=context)
        level.append(known)
    return level, angle if clear else 0.0
