"""Interface of a fitted model, and its linear refit with further regressors (columns)."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.bounded import bounded
from homeward.diagnosis.fit.parameter_groups import Parameters
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array, Mask


class Fitted(Protocol):
    """The refit or the corrected model: its prediction, its derivatives, and its fit to a part of
    the windows."""

    @property
    def parameters(self) -> Parameters: ...  # the groups and their bounds
    @property
    def groups(self) -> Refit: ...  # the fit of the groups, alone or together with effects
    @property
    # (windows, sizes), derivative of the prediction by the sizes of effects
    def beside(self) -> Array: ...
    @property
    def theta(self) -> Array: ...  # (groups,), values of the parameters
    @property
    def predicted(self) -> Array: ...  # (windows,)
    @property
    # (windows, columns), derivative of the prediction by the fitted numbers
    def jacobian(self) -> Array: ...

    def freedom(self) -> tuple[Array, Array]:
        """Least and largest physical step of each column of the Jacobian, each of shape
        (columns,)."""

    def fitted_to(self, chosen: Mask, observed: Array) -> Fitted:
        """The same fitted to the chosen windows only, linearised at this fit."""


def excited(fit: Fitted, runs: Runs, share: float | Array = thresholds.EXCITED) -> Mask:
    """Whether each parameter is excited: a plausible change of it changes the prediction by this
    share of the record, shape (columns,)."""
    norms = np.linalg.norm(fit.jacobian, axis=0)
    norm_of_record = max(float(np.linalg.norm(runs.observed)), 1e-12)
    return np.asarray(norms > share * norm_of_record)


def with_columns(fit: Fitted, training: Mask, observed: Array, regressors: Array) -> Array:
    """Prediction, (windows,), by a fit to the training windows with further, unbounded columns,
    (windows, columns)."""
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
