"""Lags of channels and drifting clocks, estimated from how well the channels of motion explain power.

Power is regressed on the terms of the drive. The lag of a slope channel is the shift that explains most; the drift of
the clock of power against that of motion is fitted together with the regression. A constant lag of power is not
corrected: it is named as any other fault of an instrument.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.fitted import bounded
from homeward.diagnosis.fit.refit import refit, standard_errors
from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.read.signals import WINDOW_S, Signals, slope_of, windows
from homeward.logs.channels import Array
from homeward.logs.recordings import Recording
from homeward.logs.times import median_step_s
from homeward.physics import Robot

_COARSE_S = 1.0  # step of the search for a late channel, refined around the best; chosen: two windows
_SHARED_S = tuple(0.25 * step for step in range(-12, 13))  # lags of power; chosen: up to 3 s, by half a window
_MOST_RUNS = 5  # in the search; chosen: all have the same sensor
_MOST_SEARCHED = 20_000  # samples of each run; chosen: half an hour at 10 Hz
_LONGEST_LAG_S = 20.0  # of a channel: filters of barometers and GNSS receivers take seconds; chosen
_LONGEST_DRIFT_S = 4.0  # over a run: 100 ppm, a poor crystal, are 0.4 s an hour, and loggers lose more; chosen
_MOST_OF_A_DRIFT = 200_000  # samples: over hours, 5.6 at 10 Hz, a drift is not linear; chosen
_COARSE_DRIFT_S = 0.5  # step of the first search; chosen: Gauss-Newton finds the drift from the nearest
_GROUNDS = 12  # knots along the way; chosen: coarse, as a fine profile would absorb the slopes
_ITERATIONS = 4  # Gauss-Newton steps from the best of the coarse drifts, a quarter of a second off at most; chosen


def drive_columns(run: Signals, robot: Robot, grade_rad: Array) -> Array:
    """Regressors of power, shape (n, columns): force balance times speed, starts, turning, sensing.

    Where the place is known, rolling resistance varies along the way, so that it is not confounded with a late slope.
    """
    speed = np.abs(run.speed_mps)
    top = robot.max_speed_mps
    slope = np.sin(grade_rad) * np.where(run.speed_mps < 0.0, -1.0, 1.0)
    climbs = speed * np.maximum(slope + robot.rolling_resistance, 0.0)
    pull = speed * np.maximum(run.accel_mps2 * np.sign(run.speed_mps), 0.0)
    moving = (speed > 0.0).astype(np.float64)
    starts = np.maximum(np.diff(moving, prepend=moving[0]), 0.0)  # break-away and inrush are short
    return np.column_stack([
        np.ones(len(speed)), moving, starts, speed[:, None] * _grounds(run), speed**3 / top**2, climbs, pull,
        np.abs(run.yaw_rate_radps), run.sensing_hz,
    ])  # fmt: skip


def _grounds(run: Signals) -> Array:
    """Interpolation weight of each sample for each stretch of the way, shape (n, stretches)."""
    place_m = run.context.get("place_m")
    if place_m is None or not np.isfinite(place_m).all() or float(np.ptp(place_m)) == 0.0:
        return np.ones((len(run.time_s), 1))
    knots_m = np.linspace(float(place_m.min()), float(place_m.max()), _GROUNDS)
    return np.column_stack([np.interp(place_m, knots_m, hat) for hat in np.eye(_GROUNDS)])


def late_slope(runs: Sequence[Signals], recordings: Sequence[Recording], robot: Robot) -> float:
    """Lag of the slope channel in all runs of these recordings, s; 0 where correcting it explains too little.

    Only positive lags are searched: filters are causal.
    """
    sloping = [index for index, run in enumerate(runs) if run.grade_rad.any()][:_MOST_RUNS]
    searched = [runs[index].only(np.arange(len(runs[index].time_s)) < _MOST_SEARCHED) for index in sloping]
    if not searched:
        return 0.0

    def late(late_s: float) -> list[Signals]:
        """The searched runs with slopes that were so late set right."""
        corrected = []
        for index, run in zip(sloping, searched, strict=True):
            slope = slope_of(recordings[index].channels, run.speed_mps, run.time_s, robot, late_s)
            if slope is None:
                slope = np.zeros(len(run.time_s))
            corrected.append(replace(run, grade_rad=slope))
        return corrected

    def errors(late_s: float) -> Array:
        return np.array([_regression(run, drive_columns(run, robot, run.grade_rad)) for run in late(late_s)])

    def left(late_s: float) -> float:
        runs = average(late(late_s))
        return float(np.sum((runs.observed - refit(runs, robot).predicted) ** 2))

    steps = np.arange(0.0, _LONGEST_LAG_S + 1e-9, _COARSE_S).tolist()
    best = min(steps, key=lambda late_s: float(errors(late_s).sum()))
    if best < thresholds.SHORTEST_LAG_S:
        return 0.0
    # To a tenth of a window, by the replay: what is left looks like a lag of power.
    best = float(minimize_scalar(left, bounds=(best - _COARSE_S, best + _COARSE_S), method="bounded",
                                 options={"xatol": 0.05}).x)  # fmt: skip
    least = errors(best)
    if best < thresholds.SHORTEST_LAG_S or (least > errors(0.0)).any():
        return 0.0
    return best if float(least.sum()) < (1.0 - thresholds.SMALLEST_GAIN) * _by_power(searched, robot) else 0.0


def _by_power(runs: Sequence[Signals], robot: Robot) -> float:
    """Squared error of the alternative that power lags or its clock drifts."""
    fixed = without_drift(runs, robot)[0]
    columns = [drive_columns(run, robot, run.grade_rad) for run in fixed]
    return min(
        sum(_regression(_early(run, lag_s), made) for run, made in zip(fixed, columns, strict=True))
        for lag_s in _SHARED_S
    )


def _early(run: Signals, lag_s: float | Array) -> Signals:
    """The run with a lag of its power removed."""
    return replace(run, observed=np.interp(run.time_s + lag_s, run.time_s, run.observed))


def _regression(run: Signals, columns: Array) -> float:
    """Squared residual over windows of power regressed on columns."""
    cut = windows(run.time_s, max(WINDOW_S, median_step_s(run.time_s)))
    design = np.column_stack([cut.means(column) for column in columns.T])
    target = cut.means(run.observed)
    weights = _least_squares(design, target)
    residual = target - design @ weights
    return float(residual @ residual)


def _least_squares(design: Array, target: Array) -> Array:
    """Weights of a regression, shape (columns,), from its normal equations: ten times as fast as by a decomposition."""
    return bounded(design.T @ design, design.T @ target)


def without_drift(runs: Sequence[Signals], robot: Robot) -> tuple[list[Signals], dict[str, float]]:
    """The runs without the drift of the clock of power against that of motion, and the drift over each run, s."""
    drifts = [_drift(run, robot) for run in runs]
    fixed = [_early(run, drift_s * _since(run)) if drift_s else run for run, drift_s in zip(runs, drifts, strict=True)]
    return fixed, {run.name: drift_s for run, drift_s in zip(runs, drifts, strict=True) if drift_s}


def _since(run: Signals) -> Array:
    """Share of the run's duration that has passed."""
    return np.asarray((run.time_s - run.time_s[0]) / max(float(np.ptp(run.time_s)), 1e-9))


def _drift(run: Signals, robot: Robot) -> float:
    """Time by which the clock of power falls back over the run, s, 0 where it is not significant.

    The best of a few drifts, then Gauss-Newton on lag and drift together with the coefficients; the drift's standard
    error is clustered by stretch.
    """
    stretch = (run.time_s - run.time_s[0]) // thresholds.INDEPENDENT_S
    if stretch[-1] < thresholds.FEWEST_BLOCKS or len(run.time_s) > _MOST_OF_A_DRIFT:
        return 0.0
    columns, since = drive_columns(run, robot, run.grade_rad), _since(run)

    def fit(lag_s: float, drift_s: float) -> tuple[Array, Array, float]:
        when = run.time_s - lag_s - drift_s * since
        late = np.column_stack([np.interp(when, run.time_s, column) for column in columns.T])
        weights = _least_squares(late, run.observed)
        residual = run.observed - late @ weights
        return late, weights, float(residual @ residual)

    drifts = np.arange(-_LONGEST_DRIFT_S, _LONGEST_DRIFT_S + 1e-9, _COARSE_DRIFT_S).tolist()
    starts = [(lag, drift) for drift in drifts for lag in {0.0, -drift / 2.0}]
    lag_s, drift_s = min(starts, key=lambda start: fit(*start)[2])
    error_s = np.inf
    for _ in range(_ITERATIONS):
        late, weights, _ = fit(lag_s, drift_s)
        rate = -np.gradient(late @ weights, run.time_s)
        design = np.column_stack([late, rate, rate * since])
        weights = _least_squares(design, run.observed)
        residual = run.observed - design @ weights
        lag_s += float(weights[-2])
        drift_s += float(weights[-1])
        error_s = float(standard_errors(design, residual, stretch.astype(np.intp))[-1])
    if error_s > abs(drift_s) / thresholds.FAR_APART or abs(drift_s) >= _LONGEST_DRIFT_S:
        return 0.0
    # The derivative of a noisy channel is noise, which some lag fits by chance: power itself must be explained better.
    without = min(_regression(_early(run, lag), columns) for lag in _SHARED_S)
    corrected = min(_regression(_early(run, lag + drift_s * since), columns) for lag in _SHARED_S)
    return drift_s if corrected < (1.0 - thresholds.SMALLEST_GAIN) * without else 0.0
