"""The table `[uncertainty]` of corrected.toml: what the recordings leave open of the robot, from what was held out."""

from __future__ import annotations

import numpy as np

from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.explain.uncertainty import Joint, spread
from homeward.diagnosis.fit.folds import correlation_windows
from homeward.diagnosis.fit.parameter_groups import GROUPS
from homeward.diagnosis.read.channels import Array
from homeward.diagnosis.read.noise import white_noise
from homeward.physics.uncertainty import Uncertainty

_IDS = {group.symbol: group.name for group in GROUPS["W"]}
_NORMAL = 1.96
_MOST_INSTRUMENT = 0.5
_FEWEST_STANDING = 50  # samples that tell the noise of power


def uncertainty_of(analysis: Analysis) -> Uncertainty | None:
    """How sure the robot is that a diagnosis hands over; None of motor currents, which are no energy.

    What nothing explains is the rest that the handed-over file leaves of windows that it was not fitted to. Where one
    run alone was recorded, how runs differ is not known and left out.
    """
    evidence, handed = analysis.evidence, analysis.diagnosis.file
    if evidence is None or handed is None or evidence.runs.unit != "W":
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
    fitted, covariance = _fitted(evidence, handed.holds)
    count = len(runs.signals)
    return Uncertainty(
        source=f"diagnose.py, {count} run{'s' if count > 1 else ''}, what was held out by {evidence.held_out_by}",
        fitted=fitted,
        covariance=covariance,
        between_runs=None if rest.deviation is None else _round(rest.deviation / mean_w),
        unexplained=_round(rest.rest / mean_w),
        unexplained_m=_round(0.5 * rest.correlation_s * mean_mps),
        instruments=_instruments(evidence, mean_w),
    )


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
    graded = [run.error["grade_rad"] for run in runs.signals if "grade_rad" in run.error]
    if graded:
        found["grade_noise"] = float(np.median(graded))
    if "soc" in runs.context:
        steps = [
            np.abs(np.diff(run.context["soc"][np.isfinite(run.context["soc"])]))
            for run in runs.signals if "soc" in run.context
        ]  # fmt: skip
        moved = np.concatenate([one[one > 0.0] for one in steps]) if steps else np.empty(0)
        if len(moved):
            found["soc_step"] = float(moved.min())
    return tuple((name, _round(min(value, _MOST_INSTRUMENT))) for name, value in found.items())


def _round(value: float) -> float:
    return float(f"{value:.6g}")
