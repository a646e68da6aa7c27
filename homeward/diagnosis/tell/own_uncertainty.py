"""The table `[uncertainty]` of corrected.toml: what the recordings leave open of the robot, from what was held out."""

from __future__ import annotations

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.explain.uncertainty import Joint, Spread, spread
from homeward.diagnosis.fit.folds import correlation_windows
from homeward.diagnosis.fit.parameter_groups import GROUPS
from homeward.diagnosis.fit.replay import Runs, wheels_mps
from homeward.diagnosis.read.channels import Array
from homeward.diagnosis.read.noise import white_noise
from homeward.diagnosis.read.signals import usual_step_s
from homeward.physics.uncertainty import Uncertainty

_IDS = {group.symbol: group.name for groups in GROUPS.values() for group in groups}
_NORMAL = 1.96
_COVERED = 0.95  # below the upper end of a 90 % interval
_MOST_INSTRUMENT = 0.5
_STAYS = 0.5  # share of the samples with the charge of the one before, above which it is shown in steps
_FEWEST_STANDING = 50  # samples that tell the noise of power


def uncertainty_of(analysis: Analysis) -> Uncertainty | None:
    """How sure the robot is that a diagnosis hands over; of motor currents, of their charge, which is no energy.

    What nothing explains is the rest that the handed-over file leaves of windows that it was not fitted to. Where one
    run alone was recorded, how runs differ is not known and left out.
    """
    evidence, handed = analysis.evidence, analysis.diagnosis.file
    if evidence is None or handed is None:
        return None
    runs = evidence.runs
    predicted = evidence.predictions.get("file", evidence.predictions.get("nominal"))
    mean_w = float(np.average(np.abs(runs.observed), weights=runs.duration_s))
    if predicted is None or mean_w <= 0.0:
        return None
    left = runs.observed - predicted
    memory = correlation_windows(left, runs.run)
    rest = spread(left, runs, memory)
    # Integrated over both sides, an exponential correlation of length L makes 2 L.
    mean_mps = float(np.average(np.abs(runs.context["speed_mps"]), weights=runs.duration_s))
    if runs.unit == "A":  # of the wheels, which also take charge on the spot
        mean_mps = float(np.mean(np.concatenate([wheels_mps(run, analysis.robot) for run in runs.signals])))
    fitted, covariance = _fitted(evidence, handed.holds)
    count = len(runs.signals)
    return Uncertainty(
        source=f"diagnose.py, {count} run{'s' if count > 1 else ''}, what was held out by {evidence.held_out_by}",
        fitted=fitted,
        covariance=covariance,
        between_runs=_between_runs(left, runs, rest, mean_w),
        unexplained=_round(rest.rest / mean_w),
        unexplained_m=_round(0.5 * rest.correlation_s * mean_mps),
        instruments=_instruments(evidence, mean_w) if runs.unit == "W" else (),
        of="energy" if runs.unit == "W" else "charge",
        rest_current_a=_rest_current_a(evidence),
    )


def _rest_current_a(evidence: Evidence) -> float:
    for one in evidence.estimates:
        if one.group.name == "rest_current":
            return _round(max(one.fitted or one.assumed or 0.0, 0.0))
    return 0.0


def _between_runs(left: Array, runs: Runs, rest: Spread, mean_w: float) -> float | None:
    """Standard deviation between runs, a share, with which the interval of one more run is as wide as it should be.

    Of n runs that is their spread by Student's t with n - 1 degrees of freedom, for the mean of all is not known either
    (Whitmore, The American Statistician 40, 1986); what nothing explains within a run is a part of it.
    """
    count = np.bincount(runs.run)
    if len(count) < 2:
        return None
    by_run = np.bincount(runs.run, left) / count
    freedom = len(count) - 1
    wider = float(student.ppf(_COVERED, freedom)) * np.sqrt(1.0 + 1.0 / len(count)) / norm.ppf(_COVERED)
    within = float(np.mean(rest.rest**2 * correlation_windows(left, runs.run) / count))
    return _round(float(np.sqrt(max((wider * np.std(by_run, ddof=1)) ** 2 - within, 0.0))) / mean_w)


def _fitted(evidence: Evidence, holds: str) -> tuple[tuple[str, ...], tuple[tuple[float, ...], ...]]:
    """Names and covariance, as shares, of what the file holds of the fit, and of the battery's capacity."""
    names: list[str] = []
    matrix = np.zeros((0, 0))
    if holds != "nominal":
        names, matrix = _shares(evidence.joint, effects=holds == "corrected")
    capacity = evidence.capacity
    if capacity is not None:
        sd = (capacity.ci95[1] - capacity.ci95[0]) / (2.0 * _NORMAL * capacity.fitted_j)
        names = [*names, "capacity"]
        matrix = np.pad(matrix, (0, 1))
        matrix[-1, -1] = sd**2
    rows = tuple(tuple(_round(value) for value in row) for row in matrix.tolist())
    return tuple(names), rows


def _shares(joint: Joint, effects: bool) -> tuple[list[str], Array]:
    kept = [
        index for index, (name, value) in enumerate(zip(joint.names, joint.values.tolist(), strict=True))
        if value != 0.0 and (name in _IDS or effects)
    ]  # fmt: skip
    values = joint.values[kept]
    names = [_IDS.get(joint.names[index], joint.names[index].replace(" ", ".")) for index in kept]
    return names, joint.covariance[np.ix_(kept, kept)] / np.outer(values, values)


def _instruments(evidence: Evidence, mean_w: float) -> tuple[tuple[str, float], ...]:
    """Noise of the instruments, as far as the recordings show it; that of power where the robot stood."""
    runs, found = evidence.runs, dict[str, float]()
    stood = [run.observed[run.speed_mps == 0.0] for run in runs.signals]
    parts = [white_noise(one) for one in stood if len(one) >= _FEWEST_STANDING]
    if parts:
        found["power_noise"] = float(np.median(parts)) / mean_w
        found["reading_s"] = float(np.median([usual_step_s(run.time_s) for run in runs.signals]))
    graded = [run.error["grade_rad"] for run in runs.signals if "grade_rad" in run.error]
    if graded:
        found["grade_noise"] = float(np.median(graded))
    charges = [run.context["soc"][np.isfinite(run.context["soc"])] for run in runs.signals if "soc" in run.context]
    steps = np.concatenate([np.abs(np.diff(one)) for one in charges]) if charges else np.empty(0)
    if steps.any():
        stays = float(np.mean(steps == 0.0)) > _STAYS
        found["soc_step"] = float(steps[steps > 0.0].min()) if stays else 0.0
        found["soc_noise"] = 0.0 if stays else float(np.median([white_noise(one) for one in charges]))
    return tuple(
        (name, _round(value if name == "reading_s" else min(value, _MOST_INSTRUMENT))) for name, value in found.items()
    )


def _round(value: float) -> float:
    return float(f"{value:.6g}")
