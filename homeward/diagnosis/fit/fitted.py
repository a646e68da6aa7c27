"""Interface of a fitted model, and its linear refit with further regressors (columns).

These are fitted by bounded least squares on the Gram matrix: once it is summed, a fit takes microseconds, whatever the
length of the recordings.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy.optimize import lsq_linear

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.parameter_groups import Parameters
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array, Mask

if TYPE_CHECKING:
    from homeward.diagnosis.fit.refit import Refit

RIDGE = 1e-9  # of a column's norm; chosen: bounds the weights of collinear columns only


class Fitted(Protocol):
    """The refit or the corrected model: its prediction, its derivatives, and its fit to a part of the windows."""

    @property
    def parameters(self) -> Parameters: ...  # the groups and their bounds
    @property
    def groups(self) -> Refit: ...  # the fit of the groups, alone or together with effects
    @property
    def beside(self) -> Array: ...  # (windows, sizes), derivative of the prediction by the sizes of effects
    @property
    def theta(self) -> Array: ...  # (groups,), values of the parameters
    @property
    def predicted(self) -> Array: ...  # (windows,)
    @property
    def jacobian(self) -> Array: ...  # (windows, columns), derivative of the prediction by the fitted numbers

    def freedom(self) -> tuple[Array, Array]:
        """Least and largest physical step of each column of the Jacobian, each of shape (columns,)."""

    def fitted_to(self, chosen: Mask, observed: Array) -> Fitted:
        """The same fitted to the chosen windows only, linearised at this fit."""


def excited(fit: Fitted, runs: Runs, share: float | Array = thresholds.EXCITED) -> Mask:
    """Whether each parameter is excited: a plausible change of it changes the prediction by this share of the record,
    shape (columns,)."""
    norms = np.linalg.norm(fit.jacobian, axis=0)
    return np.asarray(norms > share * max(float(np.linalg.norm(runs.observed)), 1e-12))


def with_columns(fit: Fitted, chosen: Mask, observed: Array, beside: Array) -> Array:
    """Prediction, (windows,), by a fit to the chosen windows with further, unbounded columns, (windows, columns)."""
    columns = np.column_stack([fit.jacobian, beside])
    low, high = fit.freedom()
    free = np.full(beside.shape[1], np.inf)
    part = columns[chosen]
    bounds = np.concatenate([low, -free]), np.concatenate([high, free])
    weights = bounded(part.T @ part, part.T @ (observed - fit.predicted)[chosen], *bounds)
    return np.asarray(fit.predicted + columns @ weights)


def bounded(gram: Array, moment: Array, low: Array | float = -np.inf, high: Array | float = np.inf) -> Array:
    """Minimise x' gram x / 2 - moment' x within bounds: x, shape (columns,).

    Without bounds also for several moments at once, shape (columns, moments).

    >>> bounded(np.eye(2), np.array([2.0, -1.0]), np.zeros(2), np.full(2, np.inf))
    array([2., 0.])
    """
    if len(moment) == 0:
        return np.zeros(0)
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    size[size == 0.0] = 1.0
    scaled = gram / np.outer(size, size) + RIDGE * np.eye(len(moment))
    solution = (np.linalg.solve(scaled, (moment.T / size).T).T / size).T
    if (solution < low).any() or (solution > high).any():
        values, vectors = np.linalg.eigh(scaled)
        root = np.sqrt(np.maximum(values, RIDGE))
        matrix, target = root[:, None] * vectors.T, (vectors.T @ (moment / size)) / root
        found = lsq_linear(matrix, target, (low * size - 1e-12, high * size + 1e-12), method="bvls")
        solution = np.clip(found.x / size, low, high)
    return np.asarray(solution + 0.0)
