"""Bounded least squares on a Gram matrix: once it is summed, a fit takes microseconds however long
recordings are."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

from homeward.logs.channels import Array

RIDGE = 1e-9  # of a column's norm; chosen: bounds the weights of collinear columns only


def bounded(
    gram: Array, moment: Array, low: Array | float = -np.inf, high: Array | float = np.inf
) -> Array:
    """Minimise x' gram x / 2 - moment' x within bounds: x, shape (columns,).

    Without bounds also for several moments at once, shape (columns, moments).

    >>> bounded(np.eye(2), np.array([2.0, -1.0]), np.zeros(2), np.full(2, np.inf))
    array([2., 0.])
    """
    if len(moment) == 0:
        return np.zeros(0)
    # Columns are scaled to length one, so that the ridge and the rounding are alike for all.
    norm = np.sqrt(np.maximum(np.diag(gram), 0.0))
    norm[norm == 0.0] = 1.0
    scaled_gram = gram / np.outer(norm, norm) + RIDGE * np.eye(len(moment))
    scaled_moment = (moment.T / norm).T
    solution = (np.linalg.solve(scaled_gram, scaled_moment).T / norm).T
    if (solution < low).any() or (solution > high).any():
        # The same problem as least squares on as many rows as columns, by a square root of the Gram
        # matrix.
        eigenvalues, eigenvectors = np.linalg.eigh(scaled_gram)
        root = np.sqrt(np.maximum(eigenvalues, RIDGE))
        matrix = root[:, None] * eigenvectors.T
        target = (eigenvectors.T @ scaled_moment) / root
        bounds = (low * norm - 1e-12, high * norm + 1e-12)
        least_squares = lsq_linear(matrix, target, bounds, method="bvls")
        solution = np.clip(least_squares.x / norm, low, high)
    return np.asarray(solution + 0.0)  # no negative zeros
