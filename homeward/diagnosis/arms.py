"""Arms of the comparison: how well each model predicts recordings it has not seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from homeward.diagnosis.refit import Refit
from homeward.diagnosis.replay import Runs
from homeward.diagnosis.signals import Array

_DRAWS = 2000


@dataclass(frozen=True)
class Arm:
    """Held-out errors of one model; `energy_error_pct` is None where only current was recorded.

    `energy_error_pct` is the mean over held-out trips of |predicted - recorded| trip energy over the recorded one.
    """

    rmse: float
    r2: float | None
    energy_error_pct: float | None
    rmse_ci95: tuple[float, float]


def held_out(fit: Refit, runs: Runs, fold: NDArray[np.intp]) -> Array:
    """Prediction of each window by the refit to the other folds, shape (windows,)."""
    predicted = np.empty_like(runs.observed)
    for one in np.unique(fold):
        test = fold == one
        predicted[test] = fit.on(~test, runs.observed)[test]
    return predicted


def score(
    predicted: Array,
    runs: Runs,
    block: NDArray[np.intp],
    fold: NDArray[np.intp],
    held_out_by: Literal["run", "block"],
    seed: int = 0,
) -> Arm:
    """Errors of a prediction; intervals by bootstrap over blocks."""
    error = predicted - runs.observed
    squared = error**2
    spread = runs.observed - runs.observed.mean()
    variance = float(spread @ spread)
    trip = runs.run if held_out_by == "run" else fold
    return Arm(
        float(np.sqrt(squared.mean())),
        1.0 - float(squared.sum()) / variance if variance > 0.0 else None,
        _trip_energy_error_pct(error, runs, trip) if runs.unit == "W" else None,
        _rmse_interval(squared, block, seed),
    )


def _trip_energy_error_pct(error_w: Array, runs: Runs, trip: NDArray[np.intp]) -> float | None:
    drawn_j = np.bincount(trip, runs.observed * runs.duration_s)
    missed_j = np.bincount(trip, error_w * runs.duration_s)
    counted = drawn_j > 0.0
    return float(100.0 * np.mean(np.abs(missed_j[counted]) / drawn_j[counted])) if counted.any() else None


def _rmse_interval(squared: Array, block: NDArray[np.intp], seed: int) -> tuple[float, float]:
    sums, counts = np.bincount(block, squared), np.bincount(block).astype(np.float64)
    chosen = np.random.default_rng(seed).integers(len(sums), size=(_DRAWS, len(sums)))
    draws = np.sqrt(sums[chosen].sum(axis=1) / counts[chosen].sum(axis=1))
    low, high = np.quantile(draws, [0.025, 0.975])
    return float(low), float(high)


def better(first: Array, second: Array, observed: Array, block: NDArray[np.intp]) -> float:
    """P-value of the hypothesis that `first` predicts no better than `second`, by paired squared errors over blocks."""
    difference = np.bincount(block, (second - observed) ** 2 - (first - observed) ** 2)
    spread = float(np.sqrt((difference**2).sum()))
    return float(norm.sf(difference.sum() / spread)) if spread > 0.0 else 1.0
