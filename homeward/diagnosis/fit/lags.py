"""Lags of channels and drifting clocks, estimated from how well the channels of motion explain
power.

Power is regressed on the terms of the drive. The lag of a slope channel is the shift that explains
most; the drift of the clock of power against that of motion is fitted together with the regression.
A constant lag of power is not corrected: it is named as any other fault of an instrument.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.bounded import bounded
from homeward.diagnosis.fit.estimates import standard_errors
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.read.signals import WINDOW_S, Signals, slope_of, windows
from homeward.logs.channels import Array, Index
from homeward.logs.recordings import Recording
from homeward.logs.times import median_step_s
from homeward.physics import Robot

# step of the search for a late channel, refined around the best; chosen: two windows
_COARSE_S = 1.0
_PRECISE_S = 0.05  # of that lag; chosen: a tenth of a window
# chosen: up to 3 s, by half a window
_LAGS_OF_POWER_S = tuple(0.25 * step for step in range(-12, 13))
_MOST_RUNS = 5  # in the search; chosen: all have the same sensor
_MOST_SEARCHED = 20_000  # samples of each run; chosen: half an hour at 10 Hz
_LONGEST_LAG_S = 20.0  # of a channel: filters of barometers and GNSS receivers take seconds; chosen
# over a run: 100 ppm, a poor crystal, are 0.4 s an hour, and loggers lose more; chosen
_LONGEST_DRIFT_S = 4.0
_MOST_OF_A_DRIFT = 200_000  # samples: over hours, 5.6 at 10 Hz, a drift is not linear; chosen
# step of the first search; chosen: Gauss-Newton finds the drift from the nearest
_COARSE_DRIFT_S = 0.5
_KNOTS = 12  # along the way; chosen: coarse, as a fine profile would absorb the slopes
# Gauss-Newton steps from the best of the coarse drifts, a quarter of a second off at most; chosen
_ITERATIONS = 4


def drive_columns(run: Signals, robot: Robot, grade_rad: Array) -> Array:
    """Regressors of power, shape (n, columns): force balance times speed, starts, turning, sensing.

    Where the place is known, rolling resistance varies along the way, so that it is not confounded
    with a late slope.
    """
    speed = np.abs(run.speed_mps)
    # Slope and acceleration along the motion, also in reverse. A descent that the robot rolls down
    # draws nothing.
    slope = np.sin(grade_rad) * np.where(run.speed_mps < 0.0, -1.0, 1.0)
    accel = run.accel_mps2 * np.sign(run.speed_mps)
    moving = (speed > 0.0).astype(np.float64)
    return np.column_stack([
        np.ones(len(speed)),
        moving,
        # starts: break-away and inrush are short
        np.maximum(np.diff(moving, prepend=moving[0]), 0.0),
        speed[:, None] * _stretches(run),  # rolling resistance
        speed**3 / robot.max_speed_mps**2,  # drag
        speed * np.maximum(slope + robot.rolling_resistance, 0.0),
        speed * np.maximum(accel, 0.0),
        np.abs(run.yaw_rate_radps),
        run.sensing_hz,
    ])  # fmt: skip


def _stretches(run: Signals) -> Array:
    """Interpolation weight of each sample for each stretch of the way, shape (n, stretches); one
    where the place is not known."""
    place_m = run.context.get("place_m")
    if place_m is None or not np.isfinite(place_m).all():
        return np.ones((len(run.time_s), 1))
    nearest_m = float(place_m.min())
    farthest_m = float(place_m.max())
    if nearest_m == farthest_m:
        return np.ones((len(run.time_s), 1))
    knots_m = np.linspace(nearest_m, farthest_m, _KNOTS)
    return np.column_stack([np.interp(place_m, knots_m, hat) for hat in np.eye(_KNOTS)])


def late_slope(runs: Sequence[Signals], recordings: Sequence[Recording], robot: Robot) -> float:
    """Lag of the slope channel in all runs of these recordings, s; 0 where correcting it explains
    too little.

    Only positive lags are searched: filters are causal.
    """
    sloping = [index for index, run in enumerate(runs) if run.grade_rad.any()][:_MOST_RUNS]
    searched = [_head(runs[index]) for index in sloping]
    if not searched:
        return 0.0

    def corrected(late_s: float) -> list[Signals]:
        """The searched runs with slopes that were so late set right."""
        pairs = zip(sloping, searched, strict=True)
        return [_with_slope_of(recordings[index], run, robot, late_s) for index, run in pairs]

    def errors_by_regression(late_s: float) -> Array:
        """Squared error of each searched run."""
        return np.array([_squared_error(run, _columns(run, robot)) for run in corrected(late_s)])

    def error_by_replay(late_s: float) -> float:
        averaged = average(corrected(late_s))
        return averaged.squared_error(refit(averaged, robot).predicted)

    lags_s = np.arange(0.0, _LONGEST_LAG_S + 1e-9, _COARSE_S).tolist()
    coarse_s = min(lags_s, key=lambda late_s: float(errors_by_regression(late_s).sum()))
    if coarse_s < thresholds.SHORTEST_LAG_S:
        return 0.0
    # To a tenth of a window, by the replay: what is left looks like a lag of power.
    bounds_s = (coarse_s - _COARSE_S, coarse_s + _COARSE_S)
    search = minimize_scalar(
        error_by_replay, bounds=bounds_s, method="bounded", options={"xatol": _PRECISE_S}
    )
    lag_s = float(search.x)
    errors = errors_by_regression(lag_s)
    if lag_s < thresholds.SHORTEST_LAG_S or (errors > errors_by_regression(0.0)).any():
        return 0.0
    # A lag or drift of power, which looks alike, must explain clearly less.
    error_to_beat = (1.0 - thresholds.SMALLEST_GAIN) * _error_by_power(searched, robot)
    return lag_s if float(errors.sum()) < error_to_beat else 0.0


def _head(run: Signals) -> Signals:
    """The part of a run that is searched."""
    return run.only(np.arange(len(run.time_s)) < _MOST_SEARCHED)


def _with_slope_of(recording: Recording, run: Signals, robot: Robot, late_s: float) -> Signals:
    """The run with the slopes of its recording as if they were so late; flat where they are
    unknown."""
    slope = slope_of(recording.channels, run.speed_mps, run.time_s, robot, late_s)
    if slope is None:
        slope = np.zeros(len(run.time_s))
    return replace(run, grade_rad=slope)


def _columns(run: Signals, robot: Robot) -> Array:
    """Regressors of power with the slopes of the run, see `drive_columns`."""
    return drive_columns(run, robot, run.grade_rad)


def _error_by_power(runs: Sequence[Signals], robot: Robot) -> float:
    """Squared error of the alternative that power lags, in all runs by the same time, or its clock
    drifts."""
    steady, _ = without_drift(runs, robot)
    columns = [_columns(run, robot) for run in steady]

    def squared_error(lag_s: float) -> float:
        pairs = zip(steady, columns, strict=True)
        return sum(_squared_error(_early(run, lag_s), of_run) for run, of_run in pairs)

    return min(map(squared_error, _LAGS_OF_POWER_S))


def _early(run: Signals, lag_s: float | Array) -> Signals:
    """The run with a lag of its power removed."""
    return replace(run, observed=np.interp(run.time_s + lag_s, run.time_s, run.observed))


def _squared_error(run: Signals, columns: Array) -> float:
    """Squared residual, summed over windows, of power regressed on columns of samples, shape (n,
    columns)."""
    cut = windows(run.time_s, max(WINDOW_S, median_step_s(run.time_s)))
    design = np.column_stack([cut.means(column) for column in columns.T])
    target = cut.means(run.observed)
    weights = _least_squares(design, target)
    residual = target - design @ weights
    return float(residual @ residual)


def _least_squares(design: Array, target: Array) -> Array:
    """Weights of a regression, shape (columns,), from its normal equations: ten times as fast as by
    a decomposition."""
    return bounded(design.T @ design, design.T @ target)


def without_drift(runs: Sequence[Signals], robot: Robot) -> tuple[list[Signals], dict[str, float]]:
    """The runs without the drift of the clock of power against that of motion, and the drift over
    each run, s."""
    steady = []
    drifts: dict[str, float] = {}
    for run in runs:
        drift_s = _drift(run, robot)
        if drift_s == 0.0:
            steady.append(run)
            continue
        steady.append(_early(run, drift_s * _passed(run)))
        drifts[run.name] = drift_s
    return steady, drifts


def _passed(run: Signals) -> Array:
    """Share of the run's duration that has passed, shape (n,)."""
    duration_s = max(float(np.ptp(run.time_s)), 1e-9)
    return np.asarray((run.time_s - run.time_s[0]) / duration_s)


def _drift(run: Signals, robot: Robot) -> float:
    """Time by which the clock of power falls back over the run, s, 0 where it is not
    significant."""
    stretch = (run.time_s - run.time_s[0]) // thresholds.INDEPENDENT_S
    if stretch[-1] < thresholds.FEWEST_BLOCKS or len(run.time_s) > _MOST_OF_A_DRIFT:
        return 0.0
    columns = _columns(run, robot)
    drift_s, error_s = _fitted_drift(run, columns, stretch.astype(np.intp))
    if error_s > abs(drift_s) / thresholds.FAR_APART or abs(drift_s) >= _LONGEST_DRIFT_S:
        return 0.0
    # The derivative of a noisy channel is noise, which some lag fits by chance: power itself must
    # be explained better.
    of_clock_s = drift_s * _passed(run)
    error_with = min(
        _squared_error(_early(run, lag_s + of_clock_s), columns) for lag_s in _LAGS_OF_POWER_S
    )
    error_without = min(_squared_error(_early(run, lag_s), columns) for lag_s in _LAGS_OF_POWER_S)
    return drift_s if error_with < (1.0 - thresholds.SMALLEST_GAIN) * error_without else 0.0


def _fitted_drift(run: Signals, columns: Array, stretch: Index) -> tuple[float, float]:
    """Drift of the clock of power and its standard error, clustered by stretch, shape (n,), both in
    s.

    The best of a few drifts, then Gauss-Newton on lag and drift together with the coefficients.
    """
    passed = _passed(run)

    def late(lag_s: float, drift_s: float) -> Array:
        """The columns on a clock that is late by a lag and a drift."""
        motion_s = run.time_s - lag_s - drift_s * passed
        return np.column_stack([np.interp(motion_s, run.time_s, column) for column in columns.T])

    def squared_error(lag_and_drift_s: tuple[float, float]) -> float:
        design = late(*lag_and_drift_s)
        residual = run.observed - design @ _least_squares(design, run.observed)
        return float(residual @ residual)

    # From a few lags and drifts, as Gauss-Newton finds only the nearest minimum.
    starts = []
    for drift_s in np.arange(-_LONGEST_DRIFT_S, _LONGEST_DRIFT_S + 1e-9, _COARSE_DRIFT_S).tolist():
        starts.append((0.0, drift_s))
        if drift_s != 0.0:
            starts.append((-drift_s / 2.0, drift_s))  # right in the middle of the run
    lag_s, drift_s = min(starts, key=squared_error)
    error_s = np.inf
    for _ in range(_ITERATIONS):
        late_columns = late(lag_s, drift_s)
        predicted = late_columns @ _least_squares(late_columns, run.observed)
        # Derivatives of the prediction by lag and drift are two more columns: their weights are the
        # steps.
        by_lag = -np.gradient(predicted, run.time_s)
        by_drift = by_lag * passed
        design = np.column_stack([late_columns, by_lag, by_drift])
        weights = _least_squares(design, run.observed)
        residual = run.observed - design @ weights
        lag_s += float(weights[-2])
        drift_s += float(weights[-1])
        error_s = float(standard_errors(design, residual, stretch)[-1])
    return drift_s, error_s
