"""Which parameter values fit the recordings best? Least squares on the groups that recordings can identify.

Window means are fitted without a robust loss, which would ignore the peaks, where the energy is. Intervals
come from a sandwich estimator clustered by block, valid under autocorrelated and heteroscedastic residuals.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import lsq_linear
from scipy.stats import t as student

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.channel_errors import reliability
from homeward.diagnosis.fit.fitted import Fitted, excited
from homeward.diagnosis.fit.folds import per_block
from homeward.diagnosis.fit.parameter_groups import MASS, ROLLING, Group, Parameters, derivatives, parameters
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array, Index, Mask
from homeward.physics import Robot

Status = Literal["fitted", "not excited", "confounded", "too uncertain", "at bound"]

_ITERATIONS = 12  # most Gauss-Newton steps: a fit ends where the error no longer falls; chosen
_WEAK_PRIOR = 1e-5  # of a column's norm; chosen: keeps only what is unidentifiable at its assumed value
_RESTS_ON = {"rolling": "speed_mps", "drag": "speed_mps", "mass": "grade_rad"}


@dataclass(frozen=True)
class Estimate:
    """Estimate of a group, in its unit; `fitted` and `ci95` are None where it is not identifiable."""

    group: Group
    assumed: float | None
    fitted: float | None
    ci95: tuple[float, float] | None
    status: Status
    mixed_with: tuple[str, ...] = ()
    off: bool = False  # significantly differs from the robot file, at 5 % over all groups together

    def confounded(self, mixed_with: tuple[str, ...]) -> Estimate:
        """The same where it is confounded with others, so that it has no value."""
        return dataclasses.replace(self, fitted=None, ci95=None, status="confounded", mixed_with=mixed_with, off=False)


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
        """Groups at a physical bound, shape (groups,); a power or drag of zero is a regular value."""
        margin = 1e-9 * self.parameters.scale
        at_high = self.theta >= self.parameters.high - margin
        at_low = (self.theta <= self.parameters.low + margin) & (self.parameters.low > 0.0)
        return np.asarray(at_high | at_low)

    def freedom(self) -> tuple[Array, Array]:
        """Least and largest physical step from theta, in units of `scale`, each of shape (groups,)."""
        down = (self.parameters.low - self.theta) / self.parameters.scale
        up = (self.parameters.high - self.theta) / self.parameters.scale
        return down - 1e-12, up + 1e-12  # a solver needs some room between them

    def moved(self, step: Array) -> Array:
        """Theta after a step in units of `scale`, within its bounds; groups that are held keep theirs to the digit."""
        moved = self.theta + ~self.held * step * self.parameters.scale
        return np.clip(moved, self.parameters.low, self.parameters.high)

    def step(self, jacobian: Array, residual: Array) -> Array:
        """Least-squares step of theta in units of `scale`, shape (groups,), within the bounds, for these windows."""
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
        return dataclasses.replace(self, theta=self.moved(step), predicted=self.predicted + self.jacobian @ step)

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
    """Gauss-Newton steps until the error no longer falls; groups that are held, shape (groups,), keep their values."""

    def linearised(theta: Array) -> Refit:
        predicted = problem.predict(runs, theta)
        columns = derivatives(problem, theta, predicted, lambda moved: problem.predict(runs, moved), held)
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


def estimates(model: Fitted, runs: Runs, block: Index) -> list[Estimate]:
    """Value and interval of each group, or why there is none; blocks, shape (windows,), count as independent."""
    problem = model.groups.parameters
    is_excited = excited(model.groups, runs)
    errors = _errors(model, runs, block, is_excited)
    degrees_of_freedom = max(int(block.max()) + 1 - int(is_excited.sum()), 1)
    # One interval covers with 95 %; all together, by which groups are off, at Bonferroni's level.
    quantile = float(student.ppf(0.975, degrees_of_freedom))
    quantile_of_all = float(student.ppf(1.0 - 0.025 / len(problem.groups), degrees_of_freedom))
    result = []
    for number in range(len(problem.groups)):
        to_group = problem.to_group[number]
        width = quantile * errors[number] * to_group
        width_of_all = quantile_of_all * errors[number] * to_group
        result.append(_estimate(model.groups, runs, number, is_excited, width, width_of_all))
    return result


def _errors(model: Fitted, runs: Runs, block: Index, is_excited: Mask) -> Array:
    """Standard errors of theta, shape (groups,), with those of the instruments; infinite where it is not excited."""
    fit = model.groups
    columns = np.column_stack([fit.jacobian[:, is_excited], model.beside])
    of_columns = standard_errors(columns, runs.observed - fit.predicted, block)
    errors = np.full(len(fit.theta), np.inf)
    errors[is_excited] = of_columns[: int(is_excited.sum())]
    errors *= fit.parameters.scale
    # A wrong gain of the power meter scales all parameters alike, which no residual shows.
    errors = np.hypot(errors, thresholds.GAIN_ERROR * np.abs(fit.theta))
    # A tilt of the slope sensor acts as rolling resistance does.
    errors[ROLLING] = np.hypot(errors[ROLLING], runs.tilt_error_rad * abs(fit.theta[MASS]))
    return np.asarray(errors)


def _estimate(fit: Refit, runs: Runs, number: int, is_excited: Mask, width: float, width_of_all: float) -> Estimate:
    """Estimate of one group with an interval of this half width; `width_of_all` is that by which it counts as off."""
    problem = fit.parameters
    group = problem.groups[number]
    start = problem.start[number] * problem.to_group[number]
    fitted = fit.theta[number] * problem.to_group[number]
    in_file = runs.unit == "W" or (problem.current_known and group.name != "rest_current")
    assumed = start if in_file else None
    status, mixed_with = _status(fit, number, is_excited)
    if status == "fitted":
        # A regression on a channel that is partly noise is attenuated, beyond what its interval says.
        channel = _RESTS_ON.get(group.name, "")
        if width > max(abs(start), abs(fitted)) or reliability(channel, runs) < thresholds.NEARLY_ALL:
            status = "too uncertain"
        elif fit.at_bound[number]:
            status = "at bound"
    if status != "fitted":
        return Estimate(group, assumed, fitted=None, ci95=None, status=status, mixed_with=mixed_with)
    is_off = assumed is not None and abs(fitted - assumed) > width_of_all
    return Estimate(
        group=group,
        assumed=assumed,
        fitted=float(fitted),
        ci95=(max(float(fitted - width), 0.0), float(fitted + width)),  # no group is negative
        status="fitted",
        off=bool(is_off),
    )


def _status(fit: Refit, number: int, excited: Mask) -> tuple[Status, tuple[str, ...]]:
    """Whether a group can be fitted; a confounded one with those whose columns make up most of its own."""
    if not excited[number]:
        return "not excited", ()
    column = fit.jacobian[:, number]
    rivals = np.flatnonzero(excited & (np.arange(len(excited)) != number))
    if not len(rivals):
        return "fitted", ()
    columns = fit.jacobian[:, rivals]
    weights = np.linalg.lstsq(columns, column, rcond=None)[0]
    unexplained = column - columns @ weights
    if unexplained @ unexplained >= thresholds.COLLINEAR * (column @ column):
        return "fitted", ()
    # Of several rivals those are named that add the most to the column.
    projections = np.abs(weights) * np.linalg.norm(columns, axis=0)
    largest = rivals[projections >= thresholds.HALF * projections.max()]
    return "confounded", tuple(fit.parameters.groups[index].symbol for index in largest)


def standard_errors(jacobian: Array, residual: Array, block: Index) -> Array:
    """Standard errors of the parameters, shape (parameters,), from their `covariance`."""
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance(jacobian, residual, block)), 0.0)))


def covariance(jacobian: Array, residual: Array, block: Index) -> Array:
    """Covariance, (parameters, parameters), by the sandwich estimator clustered by block (Liang & Zeger, 1986)."""
    windows, columns = jacobian.shape
    if columns == 0:
        return np.zeros((0, 0))
    bread = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12)
    scores = per_block(jacobian * residual[:, None], block)
    meat = scores.T @ scores
    blocks = len(scores)
    small_sample = blocks / max(blocks - 1, 1) * (windows - 1) / max(windows - columns, 1)
    return np.asarray(small_sample * bread @ meat @ bread)
