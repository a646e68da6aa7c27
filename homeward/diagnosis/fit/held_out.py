"""How well each model (an arm of the comparison) predicts held-out recordings: cross-validation and its errors."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm
from sklearn.ensemble import HistGradientBoostingRegressor

from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Arm
from homeward.logs.autocorrelation import independent_windows
from homeward.logs.channels import Array, Index, Mask

_DRAWS = 2000  # chosen: 50 of them lie beyond either end of a 95 % interval
_FEWEST_FOR_TREES = 60  # twice the smallest leaf: a split
_MOST_FOR_TREES = 20_000  # windows; chosen: bounds the time, of more a sample is drawn

_TREES, _RATE = 60, 0.2
"""Trees of the boosting and its learning rate, with half of the usual leaves. On the five real sets of docs/results.md,
150 at half the rate predict as well in 2.4 times the time, and a number by inner cross-validation 0 to 5 % worse."""


@dataclass(frozen=True)
class Gain:
    """Share of a squared held-out error that a model explains, with a bootstrap interval."""

    share: float
    ci95: tuple[float, float]


def held_out(predict: Callable[[Mask], Array], fold: Index) -> Array:
    """Cross-validated prediction, (windows,); `predict` takes the mask of the training windows, in the other folds."""
    predicted = np.empty(len(fold))
    for one in np.unique(fold):
        test = fold == one
        predicted[test] = predict(~test)[test]
    return predicted


def black_box(
    runs: Runs,
    nominal: Array,
    chosen: Mask,
    rng: np.random.Generator,
    channels: Collection[str] | None = None,
    beside: Sequence[Array] = (),
) -> Array:
    """Prediction for all windows, (windows,), by boosted trees fitted to the chosen ones (a random sample of very
    many).

    Features are the channels (all by default), `nominal`, the prediction of a fit, and those `beside`, (windows,) each.
    """
    used = [values for name, values in runs.context.items() if channels is None or name in channels]
    rows = np.flatnonzero(chosen)
    if len(rows) < _FEWEST_FOR_TREES:
        return nominal
    if len(rows) > _MOST_FOR_TREES:
        rows = np.sort(rng.choice(rows, _MOST_FOR_TREES, replace=False))
    known = (one for one in (*used, *beside) if np.isfinite(one[rows]).any())  # skip channels that these runs lack
    features = np.column_stack([nominal, *known])
    trees = HistGradientBoostingRegressor(
        max_iter=_TREES, learning_rate=_RATE, max_leaf_nodes=15, min_samples_leaf=30, early_stopping=False,
        random_state=int(rng.integers(2**31)),
    )  # fmt: skip
    trees.fit(features[rows], (runs.observed - nominal)[rows])
    return np.asarray(nominal + trees.predict(features))


def gain(observed: Array, before: Array, after: Array, block: Index, rng: np.random.Generator) -> Gain:
    """Share by which one prediction lowers another's squared held-out error, its interval by bootstrap over blocks.

    All have shape (windows,); `before` is the held-out prediction of the simpler model.
    """
    sums: Array = np.stack([np.bincount(block, (observed - one) ** 2) for one in (before, after)]).astype(np.float64)
    interval = bootstrap(sums, rng, lambda drawn: 1.0 - drawn[1] / np.maximum(drawn[0], 1e-300))
    return Gain(1.0 - float(sums[1].sum() / max(sums[0].sum(), 1e-300)), interval)


def delta_bic(observed: Array, before: Array, after: Array, run: Index, freedom: int = 1) -> float:
    """Reduction of BIC from `before` to `after`, held-out predictions, (windows,) each, by `freedom` more parameters.

    The likelihood is Gaussian, with the effective sample size of the residual.
    """
    without, with_it = (max(float(((observed - one) ** 2).sum()), 1e-300) for one in (before, after))
    independent = independent_windows(observed - after, run)
    return float(independent * np.log(without / with_it) - freedom * np.log(independent))


def bootstrap(sums: Array, rng: np.random.Generator, of: Callable[[Array], Array]) -> tuple[float, float]:
    """95 % interval of a function `of` sums over blocks, shape (sums, blocks), by block bootstrap."""
    chosen = rng.integers(sums.shape[1], size=(_DRAWS, sums.shape[1]))
    low, high = np.quantile(of(sums[:, chosen].sum(axis=2)), [0.025, 0.975])
    return float(low), float(high)


def range_accuracy_pct(predicted: Array, runs: Runs, fold: Index) -> float | None:
    """Mean accuracy of the range that a model estimates for each held-out trip, per cent.

    A model that predicts the energy of a trip 25 % too high estimates a range 20 % too short: 80 % accurate, the
    definition of the paper for its 66 to 91 %.
    """
    recorded_j, predicted_j = (np.bincount(fold, power * runs.duration_s) for power in (runs.observed, predicted))
    counted = (recorded_j > 0.0) & (predicted_j > 0.0)
    if runs.unit == "A" or not counted.any():
        return None
    off = np.abs(recorded_j[counted] / predicted_j[counted] - 1.0)
    return float(100.0 * np.mean(np.maximum(1.0 - off, 0.0)))


def score(predicted: Array, runs: Runs, block: Index, trip: Index, rng: np.random.Generator) -> Arm:
    """Errors of a held-out prediction, (windows,), those of energy by trip; intervals by block bootstrap."""
    error = predicted - runs.observed
    squared = error**2
    spread = runs.observed - runs.observed.mean()
    variance = float(spread @ spread)
    drawn_j, missed_j = (np.bincount(trip, power * runs.duration_s) for power in (runs.observed, error))
    counted = drawn_j > 0.0
    of_trips = runs.unit == "W" and counted.any()
    sums = np.stack([np.bincount(block, squared), np.bincount(block).astype(np.float64)])
    return Arm(
        float(np.sqrt(squared.mean())),
        1.0 - float(squared.sum()) / variance if variance > 0.0 else None,
        float(100.0 * np.mean(np.abs(missed_j[counted]) / drawn_j[counted])) if of_trips else None,
        bootstrap(sums, rng, lambda drawn: np.sqrt(drawn[0] / drawn[1])),
    )


def better(first: Array, second: Array, observed: Array, block: Index) -> float:
    """P-value of the hypothesis that `first` predicts no better than `second`: z-test of paired squared errors, summed
    over blocks."""
    difference = np.bincount(block, (second - observed) ** 2 - (first - observed) ** 2)
    spread = float(np.sqrt((difference**2).sum()))
    return float(norm.sf(difference.sum() / spread)) if spread > 0.0 else 1.0
