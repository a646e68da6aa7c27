"""Quality of predictions: coverage, bias, error and proper scores by the share of the way left."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homeward.watch.predictions import Watched
from homeward.watch.scores import Scores, missing, scores_of

_BORDERS = (1.0, 0.75, 0.5, 0.25, 0.1, 0.0)
"""Borders of the rows: shares of a run's way left. Chosen: finer near home, where errors in metres decide."""


@dataclass(frozen=True)
class Row:
    """Predictions made while a share of the way was left.

    Attributes:
        most: Largest share of the way left.
        least: Smallest share.
        metres: Least and most of the way left, m.
        moments: Number of predictions.
        runs: Number of runs.
        covered: Share of values in the 90 % interval.
        bias: Sum of predictions over that of measured values, less 1.
        error: Median absolute error, relative to the measured value.
        width: Median of half the interval, relative to the prediction.
        crps: Sum of the continuous ranked probability scores over that of measured values; None without scoringrules.
        interval_score: The same of the score of the 90 % interval.
    """

    most: float
    least: float
    metres: tuple[float, float]
    moments: int
    runs: int
    covered: float
    bias: float
    error: float
    width: float
    crps: float | None
    interval_score: float | None


def rows_of(runs: Sequence[Watched]) -> list[Row]:
    """Rows by the way left, and one for all; rows without predictions are omitted."""
    left = np.concatenate([run.left_m for run in runs])
    share = np.concatenate([run.left_m / run.length_m for run in runs])
    number = np.concatenate([np.full(len(run.left_m), index) for index, run in enumerate(runs)])
    took = np.concatenate([run.took_j for run in runs])
    mean = np.concatenate([run.mean_j for run in runs])
    low = np.concatenate([run.low_j for run in runs])
    high = np.concatenate([run.high_j for run in runs])
    covered = np.concatenate([run.covered for run in runs])
    scores = None
    if missing() is None:
        crps, interval = zip(*map(scores_of, runs), strict=True)
        scores = Scores(np.concatenate(crps), np.concatenate(interval))
    rows = []
    for most, least in (*itertools.pairwise(_BORDERS), (1.0, 0.0)):
        within = (share <= most) & (share > least)
        if within.any():
            t, m = took[within], mean[within]
            size = np.maximum(np.abs(t), 1e-9)
            rows.append(Row(
                most, least, (float(left[within].min()), float(left[within].max())), int(within.sum()),
                len(np.unique(number[within])), float(covered[within].mean()), float(m.sum() / t.sum() - 1.0),
                float(np.median(np.abs(m - t) / size)),
                float(np.median(0.5 * (high - low)[within] / np.maximum(np.abs(m), 1e-9))),
                None if scores is None else float(scores.crps[within].sum() / t.sum()),
                None if scores is None else float(scores.interval[within].sum() / t.sum()),
            ))  # fmt: skip
    return rows
