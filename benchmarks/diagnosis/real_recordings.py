"""What the diagnosis says of real recordings: the Husky on four grounds, the same unlabelled, and the F1TENTH car.

`python benchmarks/diagnosis/real_recordings.py` prints tables; HOMEWARD_DATA names the folder of recordings, else they
are downloaded. The names of the folders are labels to check against and reach nothing else.

Unlabelled runs are grouped by ground. The model that explains all runs together is scaled to each run, part by part,
and runs whose sizes lie together are one group; what no part explains counts too, since ground that gives way is never
the same twice. How many groups there are is chosen by BIC over mixtures of Gaussians.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from sklearn.metrics import adjusted_rand_score
from sklearn.mixture import GaussianMixture

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.tables import span
from homeward import cli
from homeward.datasets import DatasetError, fetch
from homeward.diagnosis import Analysis, analyse
from homeward.diagnosis.fit.fitted import bounded
from homeward.logs.channels import Array

GROUNDS = ("FLOORING", "ASPHALT", "ICE", "SNOW")
_MOST_GROUPS = 6
_STARTS = 20
_PRIOR = 0.02  # of all windows: what a run has to say against what all runs say
_SMALLEST_SPREAD = 0.05  # of the spread over all runs, squared: groups tighter than this are chance


@dataclass(frozen=True)
class Args:
    """What the diagnosis leaves to chance."""

    seed: int = 0
    """Seed of placebos, intervals and groups."""


def main(args: Args) -> None:
    """Diagnose and print.

    Raises:
        DatasetError: The recordings cannot be had.
    """
    console = Console(width=170)
    runs = {ground: fetch("husky_borealtc", ground) for ground in GROUNDS}
    table = _table("Husky, motor current, held out by run")
    for ground in GROUNDS:
        _row(table, f"{ground}, {len(runs[ground])} runs", analyse(runs[ground], "husky", "husky_borealtc", args.seed))
    console.print(table)

    together = {path: ground for ground in sorted(GROUNDS) for path in runs[ground]}
    analysis = analyse(list(together), "husky", "husky_borealtc", args.seed)
    found = group_runs(analysis, args.seed)
    truth = {str(path): ground for path, ground in together.items()}
    table = Table("group", "runs by folder", *found.quantities, title="All Husky runs as one unlabelled set")
    for group in range(int(found.group.max()) + 1):
        mine = found.group == group
        folders = Counter(truth[name] for name, inside in zip(found.runs, mine, strict=True) if inside)
        means = (f"{value:.2f}" for value in found.sizes[mine].mean(axis=0))
        table.add_row(str(group), ", ".join(f"{count} {name}" for name, count in folders.most_common()), *means)
    console.print(table)
    coarse = {"ASPHALT": "hard", "FLOORING": "hard", "ICE": "ice", "SNOW": "snow"}
    score = adjusted_rand_score([coarse[truth[name]] for name in found.runs], found.group)
    console.print(f"adjusted Rand index against hard ground, ice and snow: {score:.2f} (1: the same, 0: chance)")

    table = _table("F1TENTH car, battery power, held out by block")
    _row(table, "DS5", analyse(fetch("f1tenth_frictionmaps", ""), "f1tenth", "f1tenth_frictionmaps", args.seed))
    console.print(table)


def _table(title: str) -> Table:
    return Table(
        "recordings", "verdict", "missing, with size (95 %)", "RMSE nominal", "refit", "corrected", "file",
        "black box", "R^2 corrected", "range accuracy, nominal / refit / corrected / file", "file holds",
        "what is left", title=title,
    )  # fmt: skip


def _row(table: Table, name: str, analysis: Analysis) -> None:
    diagnosis, evidence = analysis.diagnosis, analysis.evidence
    assert diagnosis.fit is not None and evidence is not None
    arms = diagnosis.fit.arms
    named = []
    for one in diagnosis.missing_physics:
        size, value = next(iter(one.parameters.items()))
        named.append(f"{one.effect}: {size} {span(value.value, value.ci95, '.3g')} {value.unit}")
    errors = [
        f"{arms[arm].rmse:.3g}" if arm in arms else "-"
        for arm in ("nominal", "refit", "corrected", "file", "black_box")
    ]
    r2 = arms["corrected"].r2 if "corrected" in arms else None
    accuracy = [evidence.range_accuracy_pct.get(arm) for arm in ("nominal", "refit", "corrected", "file")]
    shown = " / ".join("-" if one is None else f"{one:.0f} %" for one in accuracy)
    left = "-"
    if evidence.remains is not None:
        formula = evidence.remains.formula
        left = evidence.remains.location.condition
        left += f": {formula.text}, {formula.held_out_gain:.0%} of it" if formula is not None else ""
    fit = "-" if r2 is None else f"{r2:.2f}"
    holds = "-" if diagnosis.file is None else diagnosis.file.holds
    table.add_row(name, diagnosis.verdict, "\n".join(named), *errors, fit, shown, holds, left)


@dataclass(frozen=True)
class Grouping:
    """Runs by ground: `sizes` of shape (runs, quantities), relative to what all runs together say."""

    runs: tuple[str, ...]
    group: NDArray[np.intp]  # (runs,), 0 for the group that drives most easily
    quantities: tuple[str, ...]
    sizes: Array


def group_runs(analysis: Analysis, seed: int = 0) -> Grouping:
    """Group the runs of a diagnosis by the cost of straight driving and the sizes of the effects that were named.

    Args:
        analysis: A diagnosis that named at least one effect.
        seed: Seed of the mixture's starting points.

    Raises:
        ValueError: Nothing was named, so there is no model to compare runs by.
    """
    evidence = analysis.evidence
    if evidence is None or evidence.corrected is None:
        raise ValueError("no effect was named: there is no corrected model to group runs by")
    corrected, runs = evidence.corrected, evidence.runs
    steady = [index for index, term in enumerate(corrected.model.terms) if term.axis == "steady"]
    effects = [corrected.contribution[index] for index in steady]
    columns = np.column_stack([corrected.predicted - np.sum(corrected.contribution, axis=0), *effects])
    gram = columns.T @ columns * _PRIOR / len(runs.signals)
    sizes = []
    for run in range(len(runs.signals)):
        own, observed = columns[runs.run == run], runs.observed[runs.run == run]
        prior = gram @ np.ones(len(gram))
        size = bounded(own.T @ own + gram, own.T @ observed + prior, np.zeros(len(gram)), np.full(len(gram), 20.0))
        sizes.append([*size, float(np.std(observed - own @ size))])
    table = np.array(sizes)
    table[:, -1] /= table[:, -1].mean()
    effects_told = (corrected.model.terms[index].effect.replace("_", " ") for index in steady)
    names = ("straight driving", *effects_told, "unexplained")
    return Grouping(tuple(runs.names), _labels(table, seed), names, table)


def _labels(sizes: Array, seed: int) -> NDArray[np.intp]:
    """Group of each run, numbered by the first quantity."""
    points = (sizes - sizes.mean(axis=0)) / np.maximum(sizes.std(axis=0), 1e-9)
    start = int(np.random.default_rng(seed).integers(2**31))
    fits = [
        GaussianMixture(
            count, covariance_type="diag", reg_covar=_SMALLEST_SPREAD, n_init=_STARTS, random_state=start
        ).fit(points)
        for count in range(1, min(_MOST_GROUPS, len(points) // 3) + 1)
    ]
    best = min(fits, key=lambda fit: fit.bic(points))
    label = best.predict(points)
    order = np.argsort([float(np.median(sizes[label == one, 0])) if (label == one).any() else np.inf
                        for one in range(best.n_components)])  # fmt: skip
    numbered: NDArray[np.intp] = np.argsort(order)[label].astype(np.intp)
    return numbered


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (DatasetError,)))
