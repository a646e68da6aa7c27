"""Which parameter values fit the recordings best? Least squares on the groups that recordings can
identify.

Window means are fitted without a robust loss, which would ignore the peaks, where the energy is.
Intervals come from a sandwich estimator clustered by block, valid under autocorrelated and
heteroscedastic residuals.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from homeward.diagnosis.fit.parameter_groups import Parameters, derivatives, parameters
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array, Mask
from homeward.physics import Robot

_ITERATIONS = 12  # most Gauss-Newton steps: a fit ends where the error no longer falls; chosen
# of a column's norm; chosen: keeps only what is unidentifiable at its assumed value
_WEAK_PRIOR = 1e-5


@dataclass(frozen=True)
class Refit:
    """A fit, linearised at theta so that it can be repeated on a part of the windows."""

    parameters: Parameters
    theta: Array  # (groups,)
    predicted: Array  # (windows,)
    jacobian: Array  # (windows, groups), per unit of `scale`; 0 for groups that are held
    held: Mask  # (groups,): those kept at the robot file's values

    @property
    def robot(self) -> Robot:
        """The robot with the fitted parameters."""
        return self.parameters.robot(self.theta)

    @property
    def groups(self) -> Refit:
        """The fit of the groups; a model with effects has the same property."""
        return self

    @property
    def beside(self) -> Array:
        """Derivative by anything but the groups: none here, shape (windows, 0)."""
        return np.empty((len(self.predicted), 0))

    @property
    def at_bound(self) -> Mask:
        """Groups at a physical bound, shape (groups,); a power or drag of zero is a regular
        value."""
        margin = 1e-9 * self.parameters.scale
        at_high = self.theta >= self.parameters.high - margin
        at_low = (self.theta <= self.parameters.low + margin) & (self.parameters.low > 0.0)
        return np.asarray(at_high | at_low)

    def freedom(self) -> tuple[Array, Array]:
        """Least and largest physical step from theta, in units of `scale`, each of shape
        (groups,)."""
        down = (self.parameters.low - self.theta) / self.parameters.scale
        up = (self.parameters.high - self.theta) / self.parameters.scale
        return down - 1e-12, up + 1e-12  # a solver needs some room between them

    def moved(self, step: Array) -> Array:
        """Theta after a step in units of `scale`, within its bounds; groups that are held keep
        theirs to the digit."""
        moved = self.theta + ~self.held * step * self.parameters.scale
        return np.clip(moved, self.parameters.low, self.parameters.high)

    def step(self, jacobian: Array, residual: Array) -> Array:
        """Least-squares step of theta in units of `scale`, shape (groups,), within the bounds, for
        these windows."""
        # QR reduces the problem to a few rows, whatever the length of the recording.
        triangle = np.asarray(np.linalg.qr(np.column_stack([jacobian, residual]), mode="r"))
        largest_norm = max(float(np.linalg.norm(jacobian, axis=0).max(initial=0.0)), 1e-12)
        prior_weight = _WEAK_PRIOR * largest_norm
        step_to_start = (self.parameters.start - self.theta) / self.parameters.scale
        matrix = np.vstack([triangle[:, :-1], prior_weight * np.eye(len(step_to_start))])
        target = np.concatenate([triangle[:, -1], prior_weight * step_to_start])
        return np.asarray(lsq_linear(matrix, target, self.freedom(), method="bvls").x)

    def fitted_to(self, chosen: Mask, observed: Array) -> Refit:
        """The same fitted to the chosen windows only, linearised at this fit."""
        step = self.step(self.jacobian[chosen], (observed - self.predicted)[chosen])
        return dataclasses.replace(
            self, theta=self.moved(step), predicted=self.predicted + self.jacobian @ step
        )

    def refitted(self, chosen: Mask, runs: Runs) -> Refit:
        """As `fitted_to`: without effects the model is almost linear."""
        return self.fitted_to(chosen, runs.observed)

    def replayed(self, runs: Runs) -> Array:
        """Prediction by a replay with these parameters, shape (windows,)."""
        return self.parameters.predict(runs, self.theta)


def refit(runs: Runs, robot: Robot) -> Refit:
    """Fit the groups to all windows within physical bounds, by Gauss-Newton through the replay."""
    problem = parameters(runs, robot)
    return _fit(problem, runs, np.zeros(len(problem.groups), np.bool_))


def holding(fit: Refit, runs: Runs, held: Mask) -> Refit:
    """The same fit with some groups, shape (groups,), held at the robot file's values."""
    return _fit(fit.parameters, runs, held)


def _fit(problem: Parameters, runs: Runs, held: Mask) -> Refit:
    """Gauss-Newton steps until the error no longer falls; groups that are held, shape (groups,),
    keep their values."""

    def linearised(theta: Array) -> Refit:
        predicted = problem.predict(runs, theta)
        columns = derivatives(
            problem, theta, predicted, lambda moved: problem.predict(runs, moved), held
        )
        return Refit(problem, theta, predicted, jacobian=np.column_stack(columns), held=held)

    fit = linearised(np.clip(problem.start, problem.low, problem.high))
    residual = runs.observed - fit.predicted
    for _ in range(_ITERATIONS - 1):
        stepped = linearised(fit.moved(fit.step(fit.jacobian, residual)))
        residual_after = runs.observed - stepped.predicted
        if float(residual_after @ residual_after) >= float(residual @ residual) * (1.0 - 1e-10):
            break
        fit = stepped
        residual = residual_after
    return fit
