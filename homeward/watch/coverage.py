"""Quality of predictions: coverage, bias, error and proper scores by the share of the way left."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward.watch.predictions import Array, Watched
from homeward.watch.scores import Scores, missing, scores_of

_BORDERS = (1.0, 0.75, 0.5, 0.25, 0.1, 0.0)
"""Borders of the rows: shares of a run's way left. Chosen: finer near home, where errors in metres
decide."""

_LEAST_J = 1e-9  # to which nothing is relative; chosen: no division by zero


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
        crps: Sum of the continuous ranked probability scores over that of measured values; None
            without scoringrules.
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
    share_left = np.concatenate([run.left_m / run.length_m for run in runs])
    moments = _Moments(
        left_m=np.concatenate([run.left_m for run in runs]),
        run=np.concatenate([np.full(len(run.left_m), index) for index, run in enumerate(runs)]),
        took_j=np.concatenate([run.took_j for run in runs]),
        mean_j=np.concatenate([run.mean_j for run in runs]),
        half_width_j=0.5 * np.concatenate([run.high_j - run.low_j for run in runs]),
        covered=np.concatenate([run.covered for run in runs]),
        scores=_scores_of_all(runs),
    )
    rows = []
    for most, least in (*itertools.pairwise(_BORDERS), (1.0, 0.0)):
        within = (share_left <= most) & (share_left > least)
        if within.any():
            rows.append(_row(most, least, moments, within))
    return rows


@dataclass(frozen=True)
class _Moments:
    """Predictions of all runs; arrays of shape (moments,)."""

    left_m: Array
    run: Array  # number of the run
    took_j: Array
    mean_j: Array
    half_width_j: Array
    covered: NDArray[np.bool_]
    scores: Scores | None


def _scores_of_all(runs: Sequence[Watched]) -> Scores | None:
    """Scores of the predictions of all runs; None where the package is missing."""
    if missing() is not None:
        return None
    scores = [scores_of(run) for run in runs]
    return Scores(
        crps=np.concatenate([of_run.crps for of_run in scores]),
        interval=np.concatenate([of_run.interval for of_run in scores]),
    )


def _row(most: float, least: float, moments: _Moments, within: NDArray[np.bool_]) -> Row:
    """The row of the moments within a range of the way left."""
    left_m = moments.left_m[within]
    took_j = moments.took_j[within]
    mean_j = moments.mean_j[within]
    error = np.abs(mean_j - took_j) / np.maximum(np.abs(took_j), _LEAST_J)
    width = moments.half_width_j[within] / np.maximum(np.abs(mean_j), _LEAST_J)
    crps = interval_score = None
    if moments.scores is not None:
        crps = float(moments.scores.crps[within].sum() / took_j.sum())
        interval_score = float(moments.scores.interval[within].sum() / took_j.sum())
    return Row(
        most=most,
        least=least,
        metres=(float(left_m.min()), float(left_m.max())),
        moments=int(within.sum()),
        runs=len(np.unique(moments.run[within])),
        covered=float(moments.covered[within].mean()),
        bias=float(mean_j.sum() / took_j.sum() - 1.0),
        error=float(np.median(error)),
        width=float(np.median(width)),
        crps=crps,
        interval_score=interval_score,
    )
