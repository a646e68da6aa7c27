"""How predictions fared: coverage, bias and error by what was left of the way."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from homeward.watch.predictions import Watched

_BORDERS = (1.0, 0.75, 0.5, 0.25, 0.1, 0.0)
"""Shares of a run's way that rows lie between. Chosen: finer near home, where errors in metres decide."""


@dataclass(frozen=True)
class Row:
    """Predictions made while so much of the way was left.

    Attributes:
        most: Share of the way that was left, at most.
        least: At least.
        metres: Least and most of the way that was left, m.
        moments: How many.
        runs: Of how many runs.
        covered: Share in the 90 % interval.
        bias: Sum of what was predicted over that of what it consumed, less 1.
        error: Median of the absolute error, as a share of what it consumed.
        width: Median of half the interval, as a share of what was predicted.
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


def rows_of(runs: Sequence[Watched]) -> list[Row]:
    """Rows by what was left, and one for all; those without a moment are left out."""
    left = np.concatenate([one.left_m for one in runs])
    share = np.concatenate([one.left_m / one.length_m for one in runs])
    number = np.concatenate([np.full(len(one.left_m), index) for index, one in enumerate(runs)])
    took, mean, low, high = (
        np.concatenate([getattr(one, name) for one in runs]) for name in ("took_j", "mean_j", "low_j", "high_j")
    )
    covered = np.concatenate([one.covered for one in runs])
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
            ))  # fmt: skip
    return rows
