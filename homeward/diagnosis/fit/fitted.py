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
    norm_of_record = max(float(np.linalg.norm(runs.observed)), 1e-12)
    return np.asarray(norms > share * norm_of_record)


def with_columns(fit: Fitted, training: Mask, observed: Array, regressors: Array) -> Array:
    """Prediction, (windows,), by a fit to the training windows with further, unbounded columns, (windows, columns)."""
    columns = np.column_stack([fit.jacobian, regressors])
    residual = observed - fit.predicted
    low, high = fit.freedom()
    unbounded = np.full(regressors.shape[1], np.inf)
    training_columns = columns[training]
    weights = bounded(
        gram=training_columns.T @ training_columns,
        moment=training_columns.T @ residual[training],
        low=np.concatenate([low, -unbounded]),
        high=np.concatenate([high, unbounded]),
    )
    return np.asarray(fit.predicted + columns @ weights)


def bounded(gram: Array, moment: Array, low: Array | float = -np.inf, high: Array | float = np.inf) -> Array:
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
        # The same problem as least squares on as many rows as columns, by a square root of the Gram matrix.
        eigenvalues, eigenvectors = np.linalg.eigh(scaled_gram)
        root = np.sqrt(np.maximum(eigenvalues, RIDGE))
        matrix = root[:, None] * eigenvectors.T
        target = (eigenvectors.T @ scaled_moment) / root
        bounds = (low * norm - 1e-12, high * norm + 1e-12)
        least_squares = lsq_linear(matrix, target, bounds, method="bvls")
        solution = np.clip(least_squares.x / norm, low, high)
    return np.asarray(solution + 0.0)  # no negative zeros
