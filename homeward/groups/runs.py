"""From recordings of named groups to a comparison of power at rest or, driving, of mean residuals and parameters."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.tell.words import why_open
from homeward.diagnosis.thresholds import COLLINEAR
from homeward.groups.comparison import Comparison, Difference, Quantity, compare, comparison_of
from homeward.groups.standing import StandingRun, mean_interval, standing_run
from homeward.layout.notation import interval, number
from homeward.logs.channels import Array
from homeward.logs.recordings import Recording, RecordingError

_AT_REST = {"W": Quantity("P_anc, idle part", "W"), "A": Quantity("current at rest", "A")}


def compare_standing(recordings: Sequence[Recording], labels: Sequence[str]) -> Comparison:
    """Compare the power of a robot at standstill between groups of runs; of one group it gives the level alone.

    Raises:
        RecordingError: A run is too short, or some runs have power and others motor current only.
    """
    runs = [standing_run(recording) for recording in recordings]
    if len({run.unit for run in runs}) > 1:
        raise RecordingError("some recordings hold power and others motor current only; compare one kind")
    means = np.array([run.mean for run in runs])
    unit = runs[0].unit
    unsteady = any(run.unsteady for run in runs)
    quantity = Quantity("mean power" if unit == "W" else "mean current", unit) if unsteady else _AT_REST[unit]
    levels, differences = compare(labels, {quantity: means})
    alone = {label: run.ci95 for label, run in zip(labels, runs, strict=True)}
    levels = [replace(level, ci95=alone[level.group]) if level.runs == 1 else level for level in levels]
    remarks = [*_of_runs(runs, labels), *_confounded(recordings, runs, labels, differences)]
    if single := ", ".join(level.group for level in levels if level.runs == 1):
        remarks.insert(0, f"{single}: one run, so the interval is of it alone; the spread between runs is unknown")
    return comparison_of("standing", recordings, labels, {quantity: means}, levels, differences, remarks)


def compare_driving(analysis: Analysis, recordings: Sequence[Recording], labels: Sequence[str]) -> Comparison:
    """Compare mean residuals, parameters and named effects between groups of recordings.

    The diagnosis is of all runs together. Each run gives its mean residual of that model, which needs no parameter to
    be identifiable. Each run is then fitted by itself, linearised around the model and without bounds, so that groups
    that differ only in how they were driven scatter about the same values.
    """
    evidence = analysis.evidence
    remarks = [f"{finding.recording}: excluded, {finding.text}" for finding in analysis.findings if finding.refused]
    if evidence is None:
        return comparison_of("driving", recordings, labels, {}, [], [], remarks)
    used = {name: index for index, name in enumerate(evidence.runs.names)}
    where = np.array([used.get(recording.name, -1) for recording in recordings])
    of_used = mean_residual_of_runs(evidence) | parameters_of_runs(evidence)
    values = {quantity: np.where(where >= 0, by_run[where], np.nan) for quantity, by_run in of_used.items()}
    levels, differences = compare(labels, values)
    changing = ", ".join(_contributions(evidence, steady=False))
    if changing:
        remarks.append(f"{changing}: counted in the mean residual, since what changes may be what the groups differ in")
    for estimate in evidence.estimates:
        if estimate.status != "fitted":
            mixed = ", ".join(estimate.mixed_with)
            confounded = f"; confounded with a difference in {mixed}" if mixed else ""
            remarks.append(f"{estimate.group.symbol}: not compared, {why_open(estimate)}{confounded}")
    if analysis.diagnosis.verdict == "unknown_physics" or evidence.remaining is not None:
        remarks.append("no known effect explains the residual: it may be confounded with a difference between groups")
    return comparison_of("driving", recordings, labels, values, levels, differences, remarks)


def mean_residual_of_runs(evidence: Evidence) -> dict[Quantity, Array]:
    """Mean of observed less predicted by the model of all runs, W or A, shape (runs,)."""
    runs = evidence.runs
    summed = np.bincount(runs.run, _unexplained(evidence) * runs.duration_s)
    return {Quantity("mean residual", runs.unit): summed / np.bincount(runs.run, runs.duration_s)}


def parameters_of_runs(evidence: Evidence) -> dict[Quantity, Array]:
    """Estimate by each run alone of each parameter that all runs together identify, and of each steady named effect.

    Parameters are in their own units, effects relative to their size in all runs together. Each array has shape
    (runs,), NaN where it is not identifiable from the run.
    """
    runs, effects = evidence.runs, _contributions(evidence, steady=True)
    fit = (evidence.fitted if evidence.corrected is None else evidence.corrected).groups
    units = np.append(fit.parameters.scale * fit.parameters.to_group, np.ones(len(effects)))
    of_all_runs = np.append(fit.theta * fit.parameters.to_group, np.ones(len(effects)))
    columns, residual = np.column_stack([fit.jacobian, *effects.values()]), _unexplained(evidence)
    in_run = [runs.run == run for run in range(len(runs.signals))]
    values = of_all_runs + units * np.array([_steps(columns[windows], residual[windows]) for windows in in_run])
    parameters = {
        Quantity(estimate.group.symbol, estimate.group.unit): values[:, j]
        for j, estimate in enumerate(evidence.estimates)
        if estimate.status == "fitted"
    }
    first_effect = len(fit.theta)
    sizes = {Quantity(f"{name}, relative", "1"): values[:, first_effect + j] for j, name in enumerate(effects)}
    return parameters | sizes


def _unexplained(evidence: Evidence) -> Array:
    """Observed less predicted by the refit and the steady named effects, fitted together, W or A, shape (windows,).

    What an effect that changes adds is left in: the change may be the difference between the groups.
    """
    return sum(_contributions(evidence, steady=False).values(), evidence.residual)


def _contributions(evidence: Evidence, steady: bool) -> dict[str, Array]:
    """What each named effect adds to the prediction, those of one size in all runs or those that change."""
    contributions: dict[str, Array] = {}
    if evidence.corrected is not None:
        for term, added in zip(evidence.corrected.model.terms, evidence.corrected.contribution, strict=True):
            if (term.axis == "steady") == steady:
                name = term.effect.replace("_", " ")
                contributions[name] = contributions.get(name, 0.0) + added
    return contributions


def _steps(columns: Array, residual: Array) -> Array:
    """Least-squares step of each column in one run, shape (columns,), NaN where it is confounded with the others.

    A step is that of the column's part that is orthogonal to the others (Frisch & Waugh, Econometrica 1, 1933).
    """
    steps = np.full(columns.shape[1], np.nan)
    for j, column in enumerate(columns.T):
        remaining = np.delete(columns, j, axis=1)
        unexplained = column - remaining @ np.linalg.lstsq(remaining, column, rcond=None)[0]
        if unexplained @ unexplained > COLLINEAR * (column @ column):
            steps[j] = unexplained @ residual / (unexplained @ unexplained)
    return steps


def _of_runs(runs: Sequence[StandingRun], labels: Sequence[str]) -> list[str]:
    remarks = []
    unsteady = {label: run.variation for label, run in zip(labels, runs, strict=True) if run.unsteady}
    if unsteady:
        remarks.append(
            f"{', '.join(unsteady)}: the power varies by {100 * max(unsteady.values()):.0f} % of its mean (standard "
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
    named = {frozenset((difference.group, difference.minus)) for difference in differences if difference.named}
    if not named:
        return []
    remarks = []
    _, of_voltage = compare(labels, {Quantity("voltage", "V"): np.array([run.voltage_v for run in runs])})
    shared = [
        difference
        for difference in of_voltage
        if difference.named and frozenset((difference.group, difference.minus)) in named
    ]
    if shared:
        pairs = ", ".join(
            f"{difference.group} and {difference.minus} ({number(abs(difference.value))} V)" for difference in shared
        )
        remarks.append(f"the battery voltage differs too between {pairs}")
    starts = np.array([recording.channels["time_s"][0] for recording in recordings])
    in_time = np.array(labels)[np.argsort(starts)]
    if np.ptp(starts) == 0.0:
        remarks.append("the recordings do not give the order of the runs: a trend over them cannot be excluded")
    elif np.count_nonzero(in_time[1:] != in_time[:-1]) + 1 == len({*labels}):
        remarks.append(
            "each group was recorded in one stretch: what changed between the stretches is confounded with the group; "
            "interleave the runs"
        )
    return remarks
