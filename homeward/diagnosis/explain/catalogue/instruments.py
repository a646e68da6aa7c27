"""Faults of instruments: a power reading that is shifted, scaled or late, and odometers that
disagree."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue.battery import share_of_the_drive
from homeward.diagnosis.explain.hypothesis import (
    Hypothesis,
    Instrument,
    Numbers,
    Setting,
    Term,
    everywhere,
    levels,
)
from homeward.diagnosis.explain.menu import Drive
from homeward.diagnosis.fit.replay import Runs, WithEffects
from homeward.logs.channels import Array
from homeward.logs.times import median_step_s
from homeward.physics.effects import Parameter

# tried, with both signs; chosen: finest where typical
_LAGS_S = 0.2, 0.4, 0.6, 0.8, 1.0, 1.25, 1.5, 2.0, 3.0, 4.0
_LONGEST_LAG_S = 5.0  # that is fitted; chosen: beyond the longest that is tried
# between the positions compared; chosen: so much is driven meanwhile that their noise adds little
_FIX_S = 5.0

_SCALE = Parameter(
    name="scale", unit="1", low=-0.5, high=1.0, meaning="relative error of the speed reading"
)
_OFFSET = Parameter(
    name="offset", unit="W", low=-10000.0, high=10000.0, meaning="added to every reading"
)
_GAIN = Parameter(
    name="gain", unit="1", low=-0.9, high=10.0, meaning="relative error of every reading"
)
_LAG = Parameter(
    name="lag_s",
    unit="s",
    low=-_LONGEST_LAG_S,
    high=_LONGEST_LAG_S,
    meaning="time by which the power reading is late",
)


def _also_creeping(hypothesis: Hypothesis, setting: Setting) -> Iterator[Term]:
    """Also a linear drift through all runs in their order, per unit of its final value."""
    yield from levels(hypothesis, setting)
    passed_s = np.cumsum(setting.runs.duration_s)
    drift = passed_s / passed_s[-1]
    low, high = hypothesis.limits(1)
    yield Term(hypothesis, drift[:, None], low=low, high=high, axis="time")


def _lags(hypothesis: Hypothesis, setting: Setting) -> Iterator[Term]:
    """A constant delay of the power reading, linearised at each of several lags."""
    for size_s in _LAGS_S:
        for lag_s in (size_s, -size_s):
            yield _late(hypothesis, setting, lag_s)


def _late(hypothesis: Hypothesis, setting: Setting, lag_s: float) -> Term:
    shape = {"lag_s": lag_s}
    late = hypothesis.within(hypothesis, setting.present, shape, setting.runs)
    change = setting.parameters.predict(setting.runs, setting.theta, late) - setting.predicted
    low, high = np.clip(sorted((0.5 * lag_s, 1.5 * lag_s)), _LAG.low, _LAG.high)
    column = change[:, None] / lag_s
    return Term(
        hypothesis, column, low=np.array([low]), high=np.array([high]), hidden=1, shape=shape
    )


def _by_run(hypothesis: Hypothesis, setting: Setting) -> Iterator[Term]:
    """A speed reading that a position fix contradicts: its scale is estimated from the fix, not
    from power."""
    ratios = _ratios(setting.runs)
    if min(ratios) <= 0.0:
        return  # the fix moves while the odometer does not
    # that odometer is taken to be right
    closest_to_one = min(ratios, key=lambda ratio: abs(ratio - 1.0))
    scale = np.array(ratios) / closest_to_one - 1.0
    scale[np.abs(scale) < thresholds.SAME_ODOMETER] = 0.0
    if not scale.any() or (scale <= -1.0).any():
        return
    corrected = replace(setting.present, speed_factors=(1.0 / (1.0 + scale)).tolist())
    change = setting.parameters.predict(setting.runs, setting.theta, corrected) - setting.predicted
    mean_scale = float(np.mean(scale[scale != 0.0]))
    low, high = sorted((0.7 * mean_scale, 1.3 * mean_scale))
    column = change[:, None] / mean_scale
    yield Term(hypothesis, column, low=np.array([low]), high=np.array([high]), fixed=True)


def _ratios(runs: Runs) -> list[float]:
    """Path by the odometer over path by the fix, a number per run."""
    ratios = []
    for run in runs.signals:
        # Over some seconds: the noise of a position would add to the path.
        every = max(1, round(_FIX_S / median_step_s(run.time_s)))
        step_m = np.abs(run.speed_mps[:-1]) * np.diff(run.time_s)
        path_m = np.concatenate(([0.0], np.cumsum(step_m)))
        by_odometer_m = np.diff(path_m[::every])
        by_fix_m = np.abs(np.diff(run.base_distance_m[::every]))
        # Not in a turn, where the path exceeds the change of distance.
        straight = by_fix_m > thresholds.HALF * by_odometer_m
        total_by_fix_m = float(by_fix_m[straight].sum())
        ratio = 1.0
        if total_by_fix_m > 0.0:
            ratio = float(by_odometer_m[straight].sum()) / total_by_fix_m
        ratios.append(ratio)
    return ratios


def _on_scaled_speed(hypothesis: Hypothesis, drive: Drive, size: float, shape: Numbers) -> Array:
    corrected = WithEffects(speed_factors=[1.0 / (1.0 + size)])
    return drive.predict(drive.fit.theta, corrected) - drive.plain


def _on_offset(hypothesis: Hypothesis, drive: Drive, size: float, shape: Numbers) -> Array:
    return np.full(len(drive.plain), size)  # also when everything is off


ODOMETRY_SCALE = Hypothesis(
    Instrument(
        id="odometry_scale",
        parameters=(_SCALE,),
        sentence="The odometer reads too much or too little: a fault of an instrument, not physics.",
        equation="speed reading = (1 + scale) speed",
        source="worn or swapped wheels",
        needs=("speed_mps", "base_distance_m"),
        confused_with=("viscous",),
    ),
    steady=_by_run,
    shown_by=(),
    check="drive along a tape measure and compare the distance with the log",
    on_drive=_on_scaled_speed,
)

HYPOTHESES = (
    Hypothesis(
        Instrument(
            id="sensor_offset",
            parameters=(_OFFSET,),
            sentence="The power reading is shifted by a constant from some moment on: a fault of an instrument, "
            "not physics.",
            equation="reading = power + offset",
            source="zero drift of a current sensor",
            needs=("power_w",),
            confused_with=("standby", "intermittent_load"),
        ),
        steady=None,
        changes="once",
        signed=True,
        load=everywhere,
        varying=_also_creeping,
        check="read a clamp meter on the battery lead with the robot switched off: the log must show the same",
        on_drive=_on_offset,
    ),
    Hypothesis(
        Instrument(
            id="sensor_gain",
            parameters=(_GAIN,),
            sentence="The power reading is scaled by a factor from some moment on: a fault of an instrument, "
            "not physics.",
            equation="reading = (1 + gain) power",
            source="scale error of a current or voltage sensor",
            needs=("power_w",),
            confused_with=("ageing",),
        ),
        steady=None,
        changes="once",
        signed=True,
        load=lambda hypothesis, setting: setting.predicted,
        check="read a clamp meter on the battery lead, standing and at top speed, beside the log",
        on_drive=share_of_the_drive,
    ),
    Hypothesis(
        Instrument(
            id="clock_lag",
            parameters=(_LAG,),
            sentence="The clocks of power and motion disagree: a fault of an instrument, not physics.",
            equation="reading(t) = power(t - lag)",
            source="unsynchronised loggers",
            needs=("time_s",),
            confused_with=("inertia",),
        ),
        steady=_lags,
        within=lambda hypothesis, so_far, numbers, runs: replace(so_far, lag_s=numbers["lag_s"]),
        otherwise="wherever the power changes",
        check="start sharply a few times and compare when wheels and power move in the logs with one clock for both",
        at_wheels=True,
    ),
    ODOMETRY_SCALE,
)
