"""Bounded least squares on few columns and many windows, fold by fold, through the columns' products.

Every product of two columns is summed once per fold. After that a fit of any subset of the columns, to any subset of
the folds, costs microseconds, whatever the length of the recordings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from homeward.diagnosis.signals import Array

_RIDGE = 1e-9  # of a column's norm: keeps collinear columns from blowing up


@dataclass(frozen=True)
class Products:
    """Sums of products of columns, shape (folds, columns, columns); the last column is the target."""

    gram: Array

    @property
    def target(self) -> int:
        """Index of the target."""
        return int(self.gram.shape[1]) - 1

    def fit(self, chosen: NDArray[np.intp], low: Array, high: Array, folds: NDArray[np.bool_] | None = None) -> Array:
        """Coefficients of the chosen columns within bounds, fitted to the given folds (all by default)."""
        gram = self.gram.sum(axis=0) if folds is None else self.gram[folds].sum(axis=0)
        return bounded(gram[np.ix_(chosen, chosen)], gram[chosen, self.target], low, high)

    def squared_error(self, chosen: NDArray[np.intp], weights: Array, fold: int | None = None) -> float:
        """Sum of squared errors of these coefficients on one fold, or on all."""
        gram = self.gram.sum(axis=0) if fold is None else self.gram[fold]
        explained = 2.0 * weights @ gram[chosen, self.target] - weights @ gram[np.ix_(chosen, chosen)] @ weights
        return max(float(gram[self.target, self.target] - explained), 0.0)

    def held_out(self, chosen: NDArray[np.intp], low: Array, high: Array) -> Array:
        """Sum of squared errors on each fold by coefficients fitted to the others, shape (folds,)."""
        folds = len(self.gram)
        errors = np.empty(folds)
        for one in range(folds):
            weights = self.fit(chosen, low, high, np.arange(folds) != one)
            errors[one] = self.squared_error(chosen, weights, one)
        return errors


def products(columns: Array, target: Array, fold: NDArray[np.intp]) -> Products:
    """Sum the products of columns and target over each fold.

    Args:
        columns: Shape (windows, columns).
        target: Shape (windows,).
        fold: Fold of each window from 0, shape (windows,).
    """
    everything = np.column_stack([columns, target])
    return Products(np.array([everything[fold == one].T @ everything[fold == one] for one in range(fold.max() + 1)]))


def bounded(gram: Array, moment: Array, low: Array, high: Array) -> Array:
    """Minimise x' gram x / 2 - moment' x within bounds.

    >>> bounded(np.eye(2), np.array([2.0, -1.0]), np.zeros(2), np.full(2, np.inf))
    array([2., 0.])
    """
    if len(moment) == 0:
        return np.zeros(0)
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    size[size == 0.0] = 1.0
    scaled = gram / np.outer(size, size) + _RIDGE * np.eye(len(moment))
    solution = np.linalg.solve(scaled, moment / size) / size
    if (solution < low).any() or (solution > high).any():
        values, vectors = np.linalg.eigh(scaled)
        root = np.sqrt(np.maximum(values, _RIDGE))
        matrix, target = root[:, None] * vectors.T, (vectors.T @ (moment / size)) / root
        found = lsq_linear(matrix, target, (low * size - 1e-12, high * size + 1e-12), method="bvls")
        solution = np.clip(found.x / size, low, high)
    return np.asarray(solution + 0.0)
