"""From recordings of named groups to a comparison of power at rest, or of the parameters estimated from each run."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from homeward.diagnosis.evidence import Analysis, Evidence
from homeward.diagnosis.fit.refit import estimates, standard_errors
from homeward.diagnosis.tell.words import why_open
from homeward.groups import rules
from homeward.groups.comparison import Comparison, Difference, Quantity, compare, comparison_of
from homeward.groups.standing import StandingRun, mean_interval, standing_run
from homeward.layout.notation import interval, number
from homeward.logs.channels import Array, Index
from homeward.logs.recordings import Recording, RecordingError

_OPEN = ("not excited", "confounded")  # parameters that are left out: not identifiable from all runs together
_AT_REST = {"W": Quantity("P_anc, idle part", "W"), "A": Quantity("current at rest", "A")}


def compare_standing(recordings: Sequence[Recording], labels: Sequence[str]) -> Comparison:
    """Compare the power of a robot at standstill between groups of runs; of one group it gives the level alone.

    Raises:
        RecordingError: A run is too short, or some runs have power and others motor current only.
    """
    runs = [standing_run(one) for one in recordings]
    if len({run.unit for run in runs}) > 1:
        raise RecordingError("some recordings hold power and others motor current only; compare one kind")
    means = np.array([run.mean for run in runs])
    unit = runs[0].unit
    unsteady = any(run.unsteady for run in runs)
    quantity = Quantity("mean power" if unit == "W" else "mean current", unit) if unsteady else _AT_REST[unit]
    levels, differences = compare(labels, {quantity: means})
    alone = {label: run.ci95 for label, run in zip(labels, runs, strict=True)}
    levels = [replace(one, ci95=alone[one.group]) if one.runs == 1 else one for one in levels]
    remarks = [*_of_runs(runs, labels), *_confounded(recordings, runs, labels, differences)]
    if single := ", ".join(one.group for one in levels if one.runs == 1):
        remarks.insert(0, f"{single}: one run, so the interval is of it alone; the spread between runs is unknown")
    return comparison_of("standing", recordings, labels, {quantity: means}, levels, differences, remarks)


def compare_driving(analysis: Analysis, recordings: Sequence[Recording], labels: Sequence[str]) -> Comparison:
    """Compare parameters and named effects between groups of recordings.

    The diagnosis is of all runs together. Each run is then fitted by itself, linearised around it and without bounds,
    so that groups that differ only in how they were driven scatter about the same values.
    """
    evidence = analysis.evidence
    remarks = [f"{one.recording}: excluded, {one.text}" for one in analysis.findings if one.refused]
    if evidence is None:
        return comparison_of("driving", recordings, labels, {}, [], [], remarks)
    used = {name: index for index, name in enumerate(evidence.runs.names)}
    where = np.array([used.get(one.name, -1) for one in recordings])
    values = {name: np.where(where >= 0, one[where], np.nan) for name, one in values_of_runs(evidence).items()}
    levels, differences = compare(labels, values)
    estimated = estimates(evidence.fitted, evidence.runs, evidence.block)
    for one in (one for one in estimated if one.status in _OPEN):
        others = f"; confounded with a difference in {', '.join(one.mixed_with)}" if one.mixed_with else ""
        remarks.append(f"{one.group.symbol}: not compared, {why_open(one)}{others}")
    if analysis.diagnosis.verdict == "unknown_physics" or evidence.remaining is not None:
        remarks.append("no known effect explains the residual: it may be confounded with a difference between groups")
    return comparison_of("driving", recordings, labels, values, levels, differences, remarks)


def values_of_runs(evidence: Evidence) -> dict[Quantity, Array]:
    """Estimate by each run alone of each parameter that is identifiable from all runs, and of each named effect.

    Parameters are in their own units, effects relative to their size in all runs together. Each array has shape
    (runs,), NaN where it is not identifiable from the run.
    """
    runs, fit, effects = evidence.runs, evidence.fitted, _steady_effects(evidence)
    estimated = estimates(fit, runs, evidence.block)
    index = np.array([j for j, one in enumerate(estimated) if one.status not in _OPEN], dtype=np.intp)
    problem = fit.parameters
    per_step = (problem.scale * problem.to_group)[index]
    quantities = [Quantity(problem.groups[j].symbol, problem.groups[j].unit) for j in index]
    quantities += [Quantity(f"{name}, relative", "1") for name in effects]
    centres = np.append((fit.theta * problem.to_group)[index], np.zeros(len(effects)))
    per_step = np.append(per_step, np.ones(len(effects)))
    sizes = np.maximum(np.abs(centres / per_step), 1.0)
    table = np.column_stack([*fit.jacobian[:, index].T, *effects.values()])
    residual = runs.observed - fit.predicted
    steps = np.array([
        _steps(table[runs.run == run], residual[runs.run == run], evidence.block[runs.run == run], sizes)
        for run in range(len(runs.signals))
    ])  # fmt: skip
    return {one: centres[j] + steps[:, j] * per_step[j] for j, one in enumerate(quantities)}


def _steady_effects(evidence: Evidence) -> dict[str, Array]:
    """Contribution of each steady named effect; one with a schedule may be confounded with the groups."""
    found: dict[str, Array] = {}
    if evidence.corrected is not None:
        for term, added in zip(evidence.corrected.model.terms, evidence.corrected.contribution, strict=True):
            if term.axis == "steady":
                name = term.effect.replace("_", " ")
                found[name] = found.get(name, 0.0) + added
    return found


def _steps(columns: Array, residual: Array, block: Index, sizes: Array) -> Array:
    """Least-squares step of each column in one run, NaN where it is confounded or too uncertain, shape (columns,)."""
    steps = np.full(columns.shape[1], np.nan)
    total = np.einsum("ij,ij->j", columns, columns)
    moving = np.flatnonzero(total > 0.0)
    if len(moving) == 0 or len(residual) <= 2 * len(moving):
        return steps
    inverse = np.linalg.pinv(columns[:, moving].T @ columns[:, moving], rcond=1e-12)
    own = 1.0 / np.maximum(np.diag(inverse) * total[moving], 1e-12)
    found = inverse @ columns[:, moving].T @ residual
    number_of_block = np.unique(block, return_inverse=True)[1]
    errors = standard_errors(columns[:, moving], residual - columns[:, moving] @ found, number_of_block)
    clear = (own > rules.OWN_SHARE) & (errors < rules.TOO_UNCERTAIN * sizes[moving])
    steps[moving[clear]] = found[clear]
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
    recordings: Sequence[Recording], runs: Sequence[StandingRun], labels: Sequence[str], found: Sequence[Difference]
) -> list[str]:
    """Confounders of named differences: battery voltage, and the order of recording."""
    named = {frozenset((one.group, one.minus)) for one in found if one.named}
    if not named:
        return []
    remarks = []
    _, of_voltage = compare(labels, {Quantity("voltage", "V"): np.array([run.voltage_v for run in runs])})
    shared = [one for one in of_voltage if one.named and frozenset((one.group, one.minus)) in named]
    if shared:
        pairs = ", ".join(f"{one.group} and {one.minus} ({number(abs(one.value))} V)" for one in shared)
        remarks.append(f"the battery voltage differs too between {pairs}")
    starts = np.array([one.channels["time_s"][0] for one in recordings])
    in_time = np.array(labels)[np.argsort(starts)]
    if np.ptp(starts) == 0.0:
        remarks.append("the recordings do not give the order of the runs: a trend over them cannot be excluded")
    elif np.count_nonzero(in_time[1:] != in_time[:-1]) + 1 == len({*labels}):
        remarks.append(
            "each group was recorded in one stretch: what changed between the stretches is confounded with the group; "
            "interleave the runs"
        )
    return remarks
