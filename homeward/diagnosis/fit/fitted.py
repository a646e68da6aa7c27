"""A model fitted to recordings, with what it takes to ask what is left and what a further column would explain."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from homeward.diagnosis.fit.parameter_groups import Parameters
from homeward.diagnosis.fit.regression import bounded
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import Array
from homeward.physics import Robot

if TYPE_CHECKING:
    from homeward.diagnosis.fit.refit import Refit


class Fitted(Protocol):
    """The refit, or the corrected model: what it predicts, how that depends on its numbers, its fit to a part."""

    @property
    def parameters(self) -> Parameters:
        """The groups and their bounds."""

    @property
    def groups(self) -> Refit:
        """The fit of the groups, alone or together with effects."""

    @property
    def beside(self) -> Array:
        """Derivative of the prediction by the sizes of effects, shape (windows, sizes)."""

    @property
    def theta(self) -> Array:
        """Values of the parameters, shape (5,)."""

    @property
    def robot(self) -> Robot:
        """The robot with these parameters, without effects."""

    @property
    def predicted(self) -> Array:
        """Prediction for the windows it was fitted to, shape (windows,)."""

    @property
    def jacobian(self) -> Array:
        """Derivative of the prediction by its numbers, shape (windows, columns)."""

    def freedom(self) -> tuple[Array, Array]:
        """Least and largest physical step of each column of the Jacobian, each of shape (columns,)."""

    def on(self, chosen: NDArray[np.bool_], observed: Array) -> Array:
        """Prediction for all windows by a fit to the chosen ones only, shape (windows,)."""


def excited(fit: Fitted, runs: Runs, share: float | Array = 1e-6) -> NDArray[np.bool_]:
    """Whether a plausible change of each number moves the prediction by this share, shape (columns,)."""
    norms = np.linalg.norm(fit.jacobian, axis=0)
    moving: NDArray[np.bool_] = norms > share * max(float(np.linalg.norm(runs.observed)), 1e-12)
    return moving


def with_columns(fit: Fitted, chosen: NDArray[np.bool_], observed: Array, beside: Array) -> Array:
    """As its fit to the chosen windows, with further columns of any size and sign beside it.

    Args:
        fit: The model.
        chosen: Windows to fit to.
        observed: What was recorded, shape (windows,).
        beside: The columns, shape (windows, any number).
    """
    columns = np.column_stack([fit.jacobian, beside])
    low, high = fit.freedom()
    free = np.full(beside.shape[1], np.inf)
    part = columns[chosen]
    weights = bounded(
        part.T @ part,
        part.T @ (observed - fit.predicted)[chosen],
        np.concatenate([low, -free]),
        np.concatenate([high, free]),
    )
    predicted: Array = fit.predicted + columns @ weights
    return predicted
