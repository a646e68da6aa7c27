"""From recordings of named groups to a comparison of power at rest or, driving, of mean residuals
and parameters."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.tell.words import why_open
from homeward.diagnosis.thresholds import COLLINEAR
from homeward.groups.comparison import (
    Comparison,
    Difference,
    Level,
    Quantity,
    compare,
    comparison_of,
)
from homeward.groups.standing import StandingRun, mean_interval, standing_run
from homeward.layout.notation import interval, number
from homeward.logs.channels import Array
from homeward.logs.recordings import Recording, RecordingError

_AT_REST = {"W": Quantity("P_anc, idle part", "W"), "A": Quantity("current at rest", "A")}
# of runs that may not be at rest
_MEANS = {"W": Quantity("mean power", "W"), "A": Quantity("mean current", "A")}


def compare_standing(recordings: Sequence[Recording], labels: Sequence[str]) -> Comparison:
    """Compare the power of a robot at standstill between groups of runs; of one group it gives the
    level alone.

    Raises:
        RecordingError: A run is too short, or some runs have power and others motor current only.
    """
    runs = [standing_run(recording) for recording in recordings]
    if len({run.unit for run in runs}) > 1:
        raise RecordingError(
            "some recordings hold power and others motor current only; compare one kind"
        )
    quantity = _AT_REST[runs[0].unit]
    if any(run.unsteady for run in runs):
        quantity = _MEANS[runs[0].unit]
    values = {quantity: np.array([run.mean for run in runs])}
    levels, differences = compare(labels, values)
    levels = _with_interval_of_single_runs(levels, runs, labels)
    remarks = []
    single = ", ".join(level.group for level in levels if level.runs == 1)
    if single:
        remarks.append(
            f"{single}: one run, so the interval is of it alone; the spread between runs is unknown"
        )
    remarks += _of_runs(runs, labels)
    remarks += _confounded(recordings, runs, labels, differences)
    return comparison_of("standing", recordings, labels, values, levels, differences, remarks)


def _with_interval_of_single_runs(
    levels: Sequence[Level], runs: Sequence[StandingRun], labels: Sequence[str]
) -> list[Level]:
    """The levels, those of groups of one run with the interval within it."""
    within_run = {label: run.ci95 for label, run in zip(labels, runs, strict=True)}
    return [
        replace(level, ci95=within_run[level.group]) if level.runs == 1 else level
        for level in levels
    ]


def compare_driving(
    analysis: Analysis, recordings: Sequence[Recording], labels: Sequence[str]
) -> Comparison:
    """Compare mean residuals, parameters and named effects between groups of recordings.

    The diagnosis is of all runs together. Each run gives its mean residual of that model, which
    needs no parameter to be identifiable. Each run is then fitted by itself, linearised around the
    model and without bounds, so that groups that differ only in how they were driven scatter about
    the same values.
    """
    evidence = analysis.evidence
    remarks = [
        f"{finding.recording}: excluded, {finding.text}"
        for finding in analysis.findings
        if finding.refused
    ]
    if evidence is None:
        return comparison_of("driving", recordings, labels, {}, [], [], remarks)
    of_usable_runs = mean_residual_of_runs(evidence) | parameters_of_runs(evidence)
    values = {
        quantity: _by_recording(by_run, evidence, recordings)
        for quantity, by_run in of_usable_runs.items()
    }
    levels, differences = compare(labels, values)
    changing = ", ".join(_contributions(evidence, steady=False))
    if changing:
        remarks.append(
            f"{changing}: counted in the mean residual, since what changes may be what the groups differ in"
        )
    for estimate in evidence.estimates:
        if estimate.status != "fitted":
            mixed = ", ".join(estimate.mixed_with)
            confounded = f"; confounded with a difference in {mixed}" if mixed else ""
            remarks.append(
                f"{estimate.group.symbol}: not compared, {why_open(estimate)}{confounded}"
            )
    if analysis.diagnosis.verdict == "unknown_physics" or evidence.remaining is not None:
        remarks.append(
            "no known effect explains the residual: it may be confounded with a difference between groups"
        )
    return comparison_of("driving", recordings, labels, values, levels, differences, remarks)


def _by_recording(by_run: Array, evidence: Evidence, recordings: Sequence[Recording]) -> Array:
    """Values of the usable runs, shape (runs,), in the order of the recordings, shape
    (recordings,), NaN of others."""
    index_of = {name: index for index, name in enumerate(evidence.runs.names)}
    index = np.array([index_of.get(recording.name, -1) for recording in recordings])
    return np.where(index >= 0, by_run[index], np.nan)


def mean_residual_of_runs(evidence: Evidence) -> dict[Quantity, Array]:
    """Mean of observed less predicted by the model of all runs, W or A, shape (runs,)."""
    runs = evidence.runs
    summed = np.bincount(runs.run, _unexplained(evidence) * runs.duration_s)
    return {Quantity("mean residual", runs.unit): summed / np.bincount(runs.run, runs.duration_s)}


def parameters_of_runs(evidence: Evidence) -> dict[Quantity, Array]:
    """Estimate by each run alone of each parameter that all runs together identify, and of each
    steady named effect.

    Parameters are in their own units, effects relative to their size in all runs together. Each
    array has shape (runs,), NaN where it is not identifiable from the run.
    """
    effects = _contributions(evidence, steady=True)
    fit = evidence.model.groups
    columns = np.column_stack([fit.jacobian, *effects.values()])
    residual = _unexplained(evidence)
    in_run = [evidence.runs.run == run for run in range(len(evidence.runs.signals))]
    # (runs, columns)
    steps = np.array([_steps(columns[windows], residual[windows]) for windows in in_run])
    relative = np.ones(len(effects))
    units = np.append(fit.parameters.scale * fit.parameters.to_group, relative)
    of_all_runs = np.append(fit.theta * fit.parameters.to_group, relative)
    values = of_all_runs + units * steps
    of_groups = values[:, : len(fit.theta)].T
    of_effects = values[:, len(fit.theta) :].T
    estimated: dict[Quantity, Array] = {}
    for estimate, by_run in zip(evidence.estimates, of_groups, strict=True):
        if estimate.status == "fitted":
            estimated[Quantity(estimate.group.symbol, estimate.group.unit)] = by_run
    for name, by_run in zip(effects, of_effects, strict=True):
        estimated[Quantity(f"{name}, relative", "1")] = by_run
    return estimated


def _unexplained(evidence: Evidence) -> Array:
    """Observed less predicted by the refit and the steady named effects, fitted together, W or A,
    shape (windows,).

    What an effect that changes adds is left in: the change may be the difference between the
    groups.
    """
    return sum(_contributions(evidence, steady=False).values(), evidence.residual)


def _contributions(evidence: Evidence, steady: bool) -> dict[str, Array]:
    """What each named effect adds to the prediction, those of one size in all runs or those that
    change."""
    contributions: dict[str, Array] = {}
    if evidence.corrected is None:
        return contributions
    for term, added in zip(
        evidence.corrected.model.terms, evidence.corrected.contribution, strict=True
    ):
        is_steady = term.axis == "steady"
        if is_steady == steady:
            name = term.effect.replace("_", " ")
            contributions[name] = contributions.get(name, 0.0) + added
    return contributions


def _steps(columns: Array, residual: Array) -> Array:
    """Least-squares step of each column in one run, shape (columns,), NaN where it is confounded
    with the others.

    A step is that of the column's part that is orthogonal to the others (Frisch & Waugh,
    Econometrica 1, 1933).
    """
    steps = np.full(columns.shape[1], np.nan)
    for index, column in enumerate(columns.T):
        remaining = np.delete(columns, index, axis=1)
        orthogonal = column - remaining @ np.linalg.lstsq(remaining, column, rcond=None)[0]
        if orthogonal @ orthogonal > COLLINEAR * (column @ column):
            steps[index] = orthogonal @ residual / (orthogonal @ orthogonal)
    return steps


def _of_runs(runs: Sequence[StandingRun], labels: Sequence[str]) -> list[str]:
    """Remarks on runs of which it is doubtful that the robot stood, or whose power drifts."""
    remarks = []
    variation = {
        label: run.variation for label, run in zip(labels, runs, strict=True) if run.unsteady
    }
    if variation:
        remarks.append(
            f"{', '.join(variation)}: the power varies by {100 * max(variation.values()):.0f} % of its mean (standard "
            "deviation of means over 0.5 s), more than is typical at standstill; if it drives, this is its mean power "
            "and no P_anc"
        )
    changes = [run.change for run in runs]
    if len(runs) > 2:
        low, high = mean_interval(changes)
        if low > 0.0 or high < 0.0:
            remarks.append(
                f"from the first to the last third of a run the power changes by {number(float(np.mean(changes)))} "
                f"{runs[0].unit} (95 %: {interval((low, high))}): compare runs of equal length and start"
            )
    return remarks


def _confounded(
    recordings: Sequence[Recording],
    runs: Sequence[StandingRun],
    labels: Sequence[str],
    differences: Sequence[Difference],
) -> list[str]:
    """Confounders of named differences: battery voltage, and the order of recording."""
    named_pairs = {_pair(difference) for difference in differences if difference.named}
    if not named_pairs:
        return []
    remarks = []
    _, of_voltage = compare(
        labels, {Quantity("voltage", "V"): np.array([run.voltage_v for run in runs])}
    )
    voltages = [
        f"{difference.group} and {difference.minus} ({number(abs(difference.value))} V)"
        for difference in of_voltage
        if difference.named and _pair(difference) in named_pairs
    ]
    if voltages:
        remarks.append(f"the battery voltage differs too between {', '.join(voltages)}")
    # A drift, such as a battery that empties, looks like a difference of groups that were recorded
    # one after the other.
    starts_s = np.array([recording.channels["time_s"][0] for recording in recordings])
    labels_in_time = np.array(labels)[np.argsort(starts_s)]
    stretches = 1 + np.count_nonzero(labels_in_time[1:] != labels_in_time[:-1])
    if np.ptp(starts_s) == 0.0:
        remarks.append(
            "the recordings do not give the order of the runs: a trend over them cannot be excluded"
        )
    elif stretches == len({*labels}):
        remarks.append(
            "each group was recorded in one stretch: what changed between the stretches is confounded with the group; "
            "interleave the runs"
        )
    return remarks


def _pair(difference: Difference) -> frozenset[str]:
    """Both groups, whichever comes first."""
    return frozenset((difference.group, difference.minus))
