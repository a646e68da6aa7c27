"""The table `[uncertainty]` of corrected.toml: uncertainty of the robot, from held-out errors."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.fit.parameter_groups import GROUPS
from homeward.diagnosis.fit.predictive import LOSSES
from homeward.diagnosis.fit.replay import Runs, wheels_mps
from homeward.diagnosis.read.noise import white_noise
from homeward.diagnosis.tell.corrected import rounded
from homeward.logs.autocorrelation import correlation_windows
from homeward.logs.channels import Array, Index
from homeward.logs.times import median_step_s
from homeward.physics import thresholds as physics_thresholds
from homeward.physics.effects import EFFECTS
from homeward.physics.uncertainty import Uncertainty

FittedTo = Literal["nothing", "others", "all"]

_IDS = {group.symbol: group.name for groups in GROUPS.values() for group in groups}
_COVERED = 0.95  # below the upper end of a 90 % interval

_NAMES_OF_EFFECTS = [
    f"{effect.id} {parameter.name}" for effect in EFFECTS for parameter in effect.parameters
]
_NAMES_BESIDE_GROUPS = {LOSSES, *_NAMES_OF_EFFECTS}
"""Numbers beside the groups that a file may hold, as a fit names them: losses of the drive, and
those of effects."""


def uncertainty_of(analysis: Analysis) -> Uncertainty | None:
    """Uncertainty of the robot in corrected.toml; of motor currents, that of their charge, which is
    no energy.

    The unexplained part is the residual of the file on windows that it was not fitted to. With one
    run, the spread between runs is unknown and left out.
    """
    evidence = analysis.evidence
    file = analysis.diagnosis.file
    if evidence is None or file is None:
        return None
    runs = evidence.runs
    predicted = evidence.predictions.get("file", evidence.predictions.get("nominal"))
    mean = float(np.average(np.abs(runs.observed), weights=runs.duration_s))  # W or A
    if predicted is None or mean <= 0.0:
        return None
    residual = runs.observed - predicted
    unexplained, correlation = within_runs(residual, runs.run)
    # Integrated over both sides, an exponential correlation of length L makes 2 L.
    correlation_s = 0.5 * correlation * float(np.median(runs.duration_s))
    fitted, covariance = _fitted(evidence, file.holds)
    fitted_to: FittedTo
    if file.holds == "nominal":
        fitted_to = "nothing"
    elif evidence.held_out_by == "run":
        fitted_to = "others"
    else:
        fitted_to = "all"
    count = len(runs.signals)
    counted = f"{count} runs" if count > 1 else "1 run"
    return Uncertainty(
        source=f"diagnose.py, {counted}, unexplained held out by {evidence.held_out_by}",
        fitted=fitted,
        covariance=covariance,
        between_runs=between_runs(residual, predicted, runs.run, fitted_to),
        unexplained=rounded(unexplained / mean),
        unexplained_m=rounded(correlation_s * _mean_speed_mps(analysis, runs)),
        instruments=_instruments(evidence, mean) if runs.unit == "W" else (),
        of="energy" if runs.unit == "W" else "charge",
    )


def _mean_speed_mps(analysis: Analysis, runs: Runs) -> float:
    """Mean speed of the robot or, of motor currents, of its wheels, which also draw charge on the
    spot."""
    if runs.unit == "A":
        return float(
            np.mean(np.concatenate([wheels_mps(run, analysis.robot) for run in runs.signals]))
        )
    return float(np.average(np.abs(runs.context["speed_mps"]), weights=runs.duration_s))


def within_runs(residual: Array, run: Index) -> tuple[float, float]:
    """Standard deviation of a file's residual about each run's mean, and its autocorrelation time,
    windows.

    The spread of the means is not included: that is `between_runs`.

    Args:
        residual: Residual of the file in each window, W or A, shape (windows,).
        run: Number of the run of each, shape (windows,).
    """
    mean_of_run = np.bincount(run, residual) / np.bincount(run)
    deviation = residual - mean_of_run[run]
    return float(np.sqrt(np.mean(deviation**2))), correlation_windows(deviation, run)


def between_runs(
    residual: Array, predicted: Array, run: Index, fitted_to: FittedTo
) -> float | None:
    """Standard deviation between runs, a share, that gives a prediction interval of one more run
    its nominal coverage.

    It is the error of the energy of runs over its prediction by the file, widened by Student's t
    for their number. The error of a run predicted from the others includes the file's own; where
    the file was fitted to all runs, that is added (Whitmore, The American Statistician 40, 1986).
    The unexplained variance within runs is subtracted.

    Args:
        residual: Residual of the file in each window, W or A, shape (windows,).
        predicted: Its prediction of each.
        run: Number of the run of each.
        fitted_to: Which runs the file that predicts a run was fitted to.

    Returns:
        None of one run.
    """
    windows_of_run = np.bincount(run)
    runs = len(windows_of_run)
    if runs < 2:
        return None
    mean_error = np.bincount(run, residual) / windows_of_run
    mean_predicted = np.bincount(run, predicted) / windows_of_run
    freedom = runs if fitted_to == "nothing" else runs - 1
    per_square = 1.0 / runs
    if fitted_to == "all":
        per_square = (1.0 + 1.0 / runs) / freedom
    variance = float(mean_error @ mean_error) * per_square
    widening = float(student.ppf(_COVERED, freedom) / norm.ppf(_COVERED))
    unexplained, correlation = within_runs(residual, run)
    # Of the mean of a run, whose windows are correlated.
    variance_within = unexplained**2 * correlation * float(np.mean(1.0 / windows_of_run))
    variance_between = max(widening**2 * variance - variance_within, 0.0)
    return rounded(float(np.sqrt(variance_between / np.mean(mean_predicted**2))))


def _fitted(
    evidence: Evidence, holds: str
) -> tuple[tuple[str, ...], tuple[tuple[float, ...], ...]]:
    """Names and relative covariance of the fitted numbers in the file, and of the battery's
    capacity."""
    joint = evidence.joint
    if holds == "nominal":
        names_in_file = set()
    elif holds == "refit":
        names_in_file = {*_IDS}
    else:
        names_in_file = {*_IDS, *_NAMES_BESIDE_GROUPS}  # levels of a schedule are in no file
    in_file = np.array([name in names_in_file for name in joint.names], np.bool_)
    numbers = np.flatnonzero(in_file & (joint.values != 0.0))
    names = [
        _IDS.get(joint.names[number], joint.names[number].replace(" ", ".")) for number in numbers
    ]
    values = joint.values[numbers]
    relative = joint.covariance[np.ix_(numbers, numbers)] / np.outer(values, values)
    capacity = evidence.capacity
    if capacity is not None and not capacity.asked:
        low_j, high_j = capacity.ci95
        relative_error = (high_j - low_j) / (2.0 * thresholds.NORMAL_95 * capacity.fitted_j)
        names.append("capacity")
        relative = np.pad(relative, (0, 1))
        relative[-1, -1] = relative_error**2
    rows = []
    for row in relative.tolist():
        rows.append(tuple(rounded(value) for value in row))
    return tuple(names), tuple(rows)


def _instruments(evidence: Evidence, mean_w: float) -> tuple[tuple[str, float], ...]:
    """Noise of the instruments, estimated from the recordings; that of power at standstill."""
    signals = evidence.runs.signals
    errors: dict[str, float] = {}
    at_rest_w = [run.observed[run.speed_mps == 0.0] for run in signals]
    noises_w = [
        white_noise(power_w) for power_w in at_rest_w if len(power_w) >= thresholds.FEWEST_SAMPLES
    ]
    if noises_w:
        errors["power_noise"] = _at_most_allowed(float(np.median(noises_w)) / mean_w)
        errors["reading_s"] = float(np.median([median_step_s(run.time_s) for run in signals]))
    grade_errors_rad = [run.error["grade_rad"] for run in signals if "grade_rad" in run.error]
    if grade_errors_rad:
        errors["grade_noise"] = _at_most_allowed(float(np.median(grade_errors_rad)))
    charges = [run.context["soc"] for run in signals if "soc" in run.context]
    errors |= _errors_of_charge([charge[np.isfinite(charge)] for charge in charges])
    return tuple((name, rounded(error)) for name, error in errors.items())


def _errors_of_charge(charges: Sequence[Array]) -> dict[str, float]:
    """Step or noise of a state of charge, from its readings in each run, shape (samples,); nothing
    if it never changes.

    A reading that stays the same from most samples to the next is a coarse one: it has steps, and
    its noise is hidden.
    """
    steps = np.concatenate([np.empty(0), *(np.abs(np.diff(charge)) for charge in charges)])
    if not steps.any():
        return {}
    if np.mean(steps == 0.0) > thresholds.HALF:
        smallest = float(steps[steps > 0.0].min())
        return {"soc_step": _at_most_allowed(smallest), "soc_noise": 0.0}
    noise = float(np.median([white_noise(charge) for charge in charges]))
    return {"soc_step": 0.0, "soc_noise": _at_most_allowed(noise)}


def _at_most_allowed(error: float) -> float:
    """An error, or the largest that a robot file may have."""
    return min(error, physics_thresholds.MOST_ERROR)
