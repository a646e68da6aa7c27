"""Bounded least squares on few columns and many windows, through the columns' products.

Once the products of columns are summed, a fit costs microseconds, whatever the length of the recordings.
"""

import numpy as np
from scipy.optimize import lsq_linear

from homeward.diagnosis.read.channels import Array

_RIDGE = 1e-9  # of a column's norm: keeps collinear columns from blowing up


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
