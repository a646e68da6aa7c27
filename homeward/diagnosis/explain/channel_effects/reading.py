"""Regression of a recorded channel, such as a voltage or the state of charge, on what the runs say of it."""

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.proof import DRAWS
from homeward.diagnosis.fit.folds import FOLDS, per_block
from homeward.diagnosis.fit.held_out import delta_bic, gain, held_out
from homeward.diagnosis.fit.refit import standard_errors
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Proof
from homeward.logs.channels import Array, Index


class Reading:
    """Regression of a channel, where it is known, with fixed effects: a mean for each stretch without a gap.

    The energy drawn in a gap is unknown. Columns have shape (known windows, columns).
    """

    def __init__(self, values: Array, runs: Runs, block: Index) -> None:
        self.known = np.isfinite(values)
        follows = (np.diff(runs.run) == 0) & (np.diff(runs.time_s) < thresholds.HALF_AGAIN * runs.duration_s[1:])
        self.stretch = np.concatenate([[0], np.cumsum(~follows)])[self.known]
        self.run = runs.run[self.known]
        self.block = np.unique(block[self.known], return_inverse=True)[1]
        self.duration_s = runs.duration_s
        self.target = self.within(values)

    def within(self, values: Array) -> Array:
        """Within transformation of values of all windows, less the mean of their stretch, shape (known windows,)."""
        values = values[self.known]
        count = np.maximum(np.bincount(self.stretch), 1)
        return np.asarray(values - (np.bincount(self.stretch, values) / count)[self.stretch])

    def summed(self, rate: Array) -> Array:
        """A rate of all windows integrated over time, to the middle of each window, shape (known windows,)."""
        amount = rate * self.duration_s
        return self.within(np.cumsum(amount) - 0.5 * amount)

    def fit(self, columns: Array) -> tuple[Array, Array]:
        """Coefficients of columns and their standard errors, clustered by block, shape (columns,) each."""
        coefficients = least_squares(columns, self.target)
        return coefficients, standard_errors(columns, self.target - columns @ coefficients, self.block)

    def per_run(self, column: Array) -> Array:
        """A column of its own for each run, shape (known windows, runs)."""
        return np.asarray(column * (self.run[:, None] == np.unique(self.run)))

    def delta_bic(self, first: Array, second: Array) -> float:
        """Reduction of BIC by the second of two designs."""
        before = first @ least_squares(first, self.target)
        after = second @ least_squares(second, self.target)
        return delta_bic(self.target, before, after, self.run, second.shape[1] - first.shape[1])

    def held_out(self, design: Array) -> Array:
        """Held-out prediction by a design, shape (known windows,)."""
        return held_out(lambda chosen: design @ least_squares(design[chosen], self.target[chosen]), self.block % FOLDS)

    def proof(self, base: Array, added: Array, rng: Generator, tried: Sequence[Array] = ()) -> Proof | None:
        """Evidence that the added columns, best of those tried, explain the channel beside the base; None if weak."""
        before = self.held_out(base)
        after = self.held_out(np.column_stack([base, added]))
        gained = gain(self.target, before, after, self.block, rng)
        bic_gain = delta_bic(self.target, before, after, self.run, added.shape[1])
        if bic_gain < thresholds.STRONG_BIC or gained.share < thresholds.SMALLEST_GAIN or gained.ci95[0] <= 0.0:
            return None
        p_value = self._p_value(base, added, np.column_stack([added, *tried]), rng)
        return None if p_value > thresholds.FALSE_ALARM_RATE else Proof(bic_gain, gained.share, p_value)

    def _p_value(self, base: Array, added: Array, tried: Array, rng: Generator) -> float:
        """P-value: how often, on random signs of blocks, some column tried explains as much as the best added."""
        residual = self.target - base @ least_squares(base, self.target)
        own = tried - base @ least_squares(base, tried)
        sums = per_block(own * residual[:, None], self.block)
        spread = np.sqrt((sums**2).sum(axis=0))
        sums = sums[:, spread > 0.0] / spread[spread > 0.0]
        signs = rng.choice([-1.0, 1.0], (DRAWS, len(sums)))
        reached = float(np.abs(sums.sum(axis=0))[: added.shape[1]].max(initial=0.0))
        by_chance = np.abs(signs @ sums).max(axis=1, initial=0.0)
        return float((1 + np.sum(by_chance >= reached)) / (DRAWS + 1))


def least_squares(design: Array, target: Array) -> Array:
    """Coefficients of a design, shape (columns,) or, of several targets, (columns, targets)."""
    return np.asarray(np.linalg.lstsq(design, target, rcond=None)[0])
