"""Regression of a recorded channel, such as a voltage or the state of charge, on what the runs say
of it."""

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.proof import DRAWS
from homeward.diagnosis.fit.estimates import standard_errors
from homeward.diagnosis.fit.folds import FOLDS, per_block
from homeward.diagnosis.fit.held_out import delta_bic, gain, held_out
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Proof
from homeward.logs.channels import Array, Index, Mask


class Reading:
    """Regression of a channel, where it is known, with fixed effects: a mean for each stretch
    without a gap.

    The energy drawn in a gap is unknown. Columns have shape (known windows, columns).
    """

    def __init__(self, values: Array, runs: Runs, block: Index) -> None:
        self.known = np.isfinite(values)
        no_gap = np.diff(runs.time_s) < thresholds.HALF_AGAIN * runs.duration_s[1:]
        follows = (np.diff(runs.run) == 0) & no_gap
        self.stretch = np.concatenate([[0], np.cumsum(~follows)])[self.known]
        self.run = runs.run[self.known]
        self.block = np.unique(block[self.known], return_inverse=True)[1]
        self.duration_s = runs.duration_s
        self.target = self.within(values)

    def within(self, values: Array) -> Array:
        """Within transformation of values of all windows, less the mean of their stretch, shape
        (known windows,)."""
        values = values[self.known]
        count = np.maximum(np.bincount(self.stretch), 1)
        mean = np.bincount(self.stretch, values) / count
        return np.asarray(values - mean[self.stretch])

    def summed(self, rate: Array) -> Array:
        """A rate of all windows integrated over time, to the middle of each window, shape (known
        windows,)."""
        amount = rate * self.duration_s
        to_the_middle = np.cumsum(amount) - 0.5 * amount
        return self.within(to_the_middle)

    def fit(self, columns: Array) -> tuple[Array, Array]:
        """Coefficients of columns and their standard errors, clustered by block, shape (columns,)
        each."""
        coefficients = least_squares(columns, self.target)
        return coefficients, standard_errors(
            columns, self.target - columns @ coefficients, self.block
        )

    def per_run(self, column: Array) -> Array:
        """A column of its own for each run, shape (known windows, runs)."""
        return np.asarray(column * (self.run[:, None] == np.unique(self.run)))

    def delta_bic(self, design: Array, rival: Array) -> float:
        """Reduction of BIC by the second of two designs."""
        predicted = _projected(self.target, design)
        predicted_by_rival = _projected(self.target, rival)
        more_columns = rival.shape[1] - design.shape[1]
        return delta_bic(self.target, predicted, predicted_by_rival, self.run, more_columns)

    def held_out(self, design: Array) -> Array:
        """Held-out prediction by a design, shape (known windows,)."""

        def predict(training: Mask) -> Array:
            return np.asarray(design @ least_squares(design[training], self.target[training]))

        return held_out(predict, self.block % FOLDS)

    def proof(
        self, base: Array, added: Array, rng: Generator, searched: Sequence[Array] = ()
    ) -> Proof | None:
        """Evidence that the added columns, best of those searched, explain the channel beside the
        base; None if weak."""
        predicted = self.held_out(base)
        predicted_with = self.held_out(np.column_stack([base, added]))
        gained = gain(self.target, predicted, predicted_with, self.block, rng)
        bic_gain = delta_bic(self.target, predicted, predicted_with, self.run, added.shape[1])
        if (
            bic_gain < thresholds.STRONG_BIC
            or gained.share < thresholds.SMALLEST_GAIN
            or gained.ci95[0] <= 0.0
        ):
            return None
        p_value = self._p_value(base, added, np.column_stack([added, *searched]), rng)
        if p_value > thresholds.FALSE_ALARM_RATE:
            return None
        return Proof(bic_gain, gained.share, p_value)

    def _p_value(self, base: Array, added: Array, searched: Array, rng: Generator) -> float:
        """P-value: how often, on random signs of blocks, some column searched explains as much as
        the best added."""
        residual = self.target - _projected(self.target, base)
        beside_base = searched - _projected(searched, base)
        # If the base is all there is, the sign of each block's sum is random (wild cluster
        # bootstrap).
        sums = per_block(beside_base * residual[:, None], self.block)
        spread = np.sqrt((sums**2).sum(axis=0))
        is_used = spread > 0.0
        sums = sums[:, is_used] / spread[is_used]
        recorded = float(np.abs(sums.sum(axis=0))[: added.shape[1]].max(initial=0.0))
        signs = rng.choice([-1.0, 1.0], (DRAWS, len(sums)))
        by_chance = np.abs(signs @ sums).max(axis=1, initial=0.0)
        as_large = np.sum(by_chance >= recorded)
        return float((1 + as_large) / (DRAWS + 1))


def _projected(target: Array, design: Array) -> Array:
    """Least-squares prediction of a target, or of several as columns, by a design, of the target's
    shape."""
    return np.asarray(design @ least_squares(design, target))


def least_squares(design: Array, target: Array) -> Array:
    """Coefficients of a design, shape (columns,) or, of several targets, (columns, targets)."""
    return np.asarray(np.linalg.lstsq(design, target, rcond=None)[0])
