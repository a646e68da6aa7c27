"""Which runs were driven on the same ground: runs grouped by what straight driving and each effect cost in each.

The model that explains all runs together is scaled to each run, part by part, and runs whose sizes lie together are one
group; what no part explains counts too, since ground that gives way is never the same twice. How many groups there are
is chosen by BIC over mixtures of Gaussians; no label is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.mixture import GaussianMixture

from homeward.diagnosis.evidence import Analysis
from homeward.diagnosis.fit.fitted import bounded
from homeward.diagnosis.read.channels import Array

_MOST_GROUPS = 6
_STARTS = 20
_PRIOR = 0.02  # of all windows: what a run has to say against what all runs say
_SMALLEST_SPREAD = 0.05  # of the spread over all runs, squared: groups tighter than this are chance


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
