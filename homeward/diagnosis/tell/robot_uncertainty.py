"""The table `[uncertainty]` of corrected.toml: uncertainty of the robot, from held-out errors."""

from typing import Literal

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.fit.parameter_groups import GROUPS
from homeward.diagnosis.fit.predictive import LOSSES
from homeward.diagnosis.fit.replay import wheels_mps
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

_OTHERS = {LOSSES, *(f"{effect.id} {parameter.name}" for effect in EFFECTS for parameter in effect.parameters)}
"""Numbers beside these that a file may hold, as a fit names them: the losses of the drive, and those of effects."""


def uncertainty_of(analysis: Analysis) -> Uncertainty | None:
    """Uncertainty of the robot in corrected.toml; of motor currents, that of their charge, which is no energy.

    The unexplained part is the residual of the file on windows that it was not fitted to. With one run, the spread
    between runs is unknown and left out.
    """
    evidence, file = analysis.evidence, analysis.diagnosis.file
    if evidence is None or file is None:
        return None
    runs = evidence.runs
    predicted = evidence.predictions.get("file", evidence.predictions.get("nominal"))
    mean_w = float(np.average(np.abs(runs.observed), weights=runs.duration_s))
    if predicted is None or mean_w <= 0.0:
        return None
    residual = runs.observed - predicted
    rest_w, rest_windows = within_runs(residual, runs.run)
    # Integrated over both sides, an exponential correlation of length L makes 2 L.
    mean_mps = float(np.average(np.abs(runs.context["speed_mps"]), weights=runs.duration_s))
    if runs.unit == "A":  # of the wheels, which also draw charge on the spot
        mean_mps = float(np.mean(np.concatenate([wheels_mps(run, analysis.robot) for run in runs.signals])))
    correlated_m = 0.5 * rest_windows * float(np.median(runs.duration_s)) * mean_mps
    fitted, covariance = _fitted(evidence, file.holds)
    fitted_to: FittedTo = "others" if evidence.held_out_by == "run" else "all"
    if file.holds == "nominal":
        fitted_to = "nothing"
    count = len(runs.signals)
    return Uncertainty(
        source=f"diagnose.py, {count} run{'s' if count > 1 else ''}, unexplained held out by {evidence.held_out_by}",
        fitted=fitted,
        covariance=covariance,
        between_runs=between_runs(residual, predicted, runs.run, fitted_to),
        unexplained=rounded(rest_w / mean_w),
        unexplained_m=rounded(correlated_m),
        instruments=_instruments(evidence, mean_w) if runs.unit == "W" else (),
        of="energy" if runs.unit == "W" else "charge",
    )


def within_runs(residual: Array, run: Index) -> tuple[float, float]:
    """Standard deviation of a file's residual about each run's mean, and its autocorrelation time, windows.

    The spread of the means is not included: that is `between_runs`.

    Args:
        residual: Residual of the file in each window, W or A, shape (windows,).
        run: Number of the run of each, shape (windows,).
    """
    about = residual - (np.bincount(run, residual) / np.bincount(run))[run]
    return float(np.sqrt(np.mean(about**2))), correlation_windows(about, run)


def between_runs(residual: Array, predicted: Array, run: Index, fitted_to: FittedTo) -> float | None:
    """Standard deviation between runs, a share, that gives a prediction interval of one more run its nominal coverage.

    It is the error of the energy of runs over its prediction by the file, widened by Student's t for their number. The
    error of a run predicted from the others includes the file's own; where the file was fitted to all runs, that is
    added (Whitmore, The American Statistician 40, 1986). The unexplained variance within runs is subtracted.

    Args:
        residual: Residual of the file in each window, W or A, shape (windows,).
        predicted: Its prediction of each.
        run: Number of the run of each.
        fitted_to: Which runs the file that predicts a run was fitted to.

    Returns:
        None of one run.
    """
    count = np.bincount(run)
    runs = len(count)
    if runs < 2:
        return None
    off, predicted_mean = (np.bincount(run, values) / count for values in (residual, predicted))
    freedom = runs if fitted_to == "nothing" else runs - 1
    variance = float(off @ off) * ((1.0 + 1.0 / runs) / freedom if fitted_to == "all" else 1.0 / runs)
    wider = float(student.ppf(_COVERED, freedom) / norm.ppf(_COVERED))
    rest, windows = within_runs(residual, run)
    within = rest**2 * windows * float(np.mean(1.0 / count))
    return rounded(float(np.sqrt(max(wider**2 * variance - within, 0.0) / np.mean(predicted_mean**2))))


def _fitted(evidence: Evidence, holds: str) -> tuple[tuple[str, ...], tuple[tuple[float, ...], ...]]:
    """Names and relative covariance of the fitted numbers in the file, and of the battery's capacity."""
    joint, values = evidence.joint, evidence.joint.values
    others = set() if holds == "refit" else _OTHERS  # levels of a schedule are in no file
    wanted = [holds != "nominal" and (name in _IDS or name in others) for name in joint.names]
    kept = np.flatnonzero(np.array(wanted, np.bool_) & (values != 0.0))
    names = [_IDS.get(joint.names[index], joint.names[index].replace(" ", ".")) for index in kept]
    matrix = joint.covariance[np.ix_(kept, kept)] / np.outer(values[kept], values[kept])
    capacity = evidence.capacity
    if capacity is not None and not capacity.asked:
        sd = (capacity.ci95[1] - capacity.ci95[0]) / (2.0 * thresholds.NORMAL_95 * capacity.fitted_j)
        names = [*names, "capacity"]
        matrix = np.pad(matrix, (0, 1))
        matrix[-1, -1] = sd**2
    rows = tuple(tuple(rounded(value) for value in row) for row in matrix.tolist())
    return tuple(names), rows


def _instruments(evidence: Evidence, mean_w: float) -> tuple[tuple[str, float], ...]:
    """Noise of the instruments, estimated from the recordings; that of power at standstill."""
    runs, found = evidence.runs, dict[str, float]()
    stood = [run.observed[run.speed_mps == 0.0] for run in runs.signals]
    noises_w = [white_noise(power_w) for power_w in stood if len(power_w) >= thresholds.FEWEST_SAMPLES]
    if noises_w:
        found["power_noise"] = float(np.median(noises_w)) / mean_w
        found["reading_s"] = float(np.median([median_step_s(run.time_s) for run in runs.signals]))
    if graded := [run.error["grade_rad"] for run in runs.signals if "grade_rad" in run.error]:
        found["grade_noise"] = float(np.median(graded))
    charges = [run.context["soc"][np.isfinite(run.context["soc"])] for run in runs.signals if "soc" in run.context]
    steps = np.concatenate([np.abs(np.diff(charge)) for charge in charges]) if charges else np.empty(0)
    if steps.any():
        stays = float(np.mean(steps == 0.0)) > thresholds.HALF
        found["soc_step"] = float(steps[steps > 0.0].min()) if stays else 0.0
        found["soc_noise"] = 0.0 if stays else float(np.median([white_noise(charge) for charge in charges]))
    most = {"reading_s": np.inf}
    return tuple(
        (name, rounded(min(one, most.get(name, physics_thresholds.MOST_ERROR)))) for name, one in found.items()
    )
