"""A model fitted to recordings, with what it takes to ask what is left and what a further column would explain."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from homeward.diagnosis.fit.parameter_groups import Parameters
from homeward.diagnosis.fit.regression import bounded
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.channels import Array, Mask

if TYPE_CHECKING:
    from homeward.diagnosis.fit.refit import Refit


class Fitted(Protocol):
    """The refit, or the corrected model: what it predicts, how that depends on its numbers, its fit to a part."""

    @property
    def parameters(self) -> Parameters: ...  # the groups and their bounds
    @property
    def groups(self) -> Refit: ...  # the fit of the groups, alone or together with effects
    @property
    def beside(self) -> Array: ...  # (windows, sizes), derivative of the prediction by the sizes of effects
    @property
    def theta(self) -> Array: ...  # (5,), values of the parameters
    @property
    def predicted(self) -> Array: ...  # (windows,), for the windows it was fitted to
    @property
    def jacobian(self) -> Array: ...  # (windows, columns), derivative of the prediction by its numbers

    def freedom(self) -> tuple[Array, Array]:
        """Least and largest physical step of each column of the Jacobian, each of shape (columns,)."""

    def fitted_to(self, chosen: Mask, observed: Array) -> Fitted:
        """The same fitted to the chosen windows only, linearised at this fit."""


def excited(fit: Fitted, runs: Runs, share: float | Array = 1e-6) -> Mask:
    """Whether a plausible change of each number moves the prediction by this share, shape (columns,)."""
    norms = np.linalg.norm(fit.jacobian, axis=0)
    moving: Mask = norms > share * max(float(np.linalg.norm(runs.observed)), 1e-12)
    return moving


def with_columns(fit: Fitted, chosen: Mask, observed: Array, beside: Array) -> Array:
    """Prediction, (windows,), by a fit of a model to the chosen windows, with columns of any size beside it."""
    columns = np.column_stack([fit.jacobian, beside])
    low, high = fit.freedom()
    free = np.full(beside.shape[1], np.inf)
    part = columns[chosen]
    bounds = np.concatenate([low, -free]), np.concatenate([high, free])
    weights = bounded(part.T @ part, part.T @ (observed - fit.predicted)[chosen], *bounds)
    return np.asarray(fit.predicted + columns @ weights)
