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
        low, high, margin = self.parameters.low, self.parameters.high, 1e-9 * self.parameters.scale
        return np.asarray((self.theta >= high - margin) | ((self.theta <= low + margin) & (low > 0.0)))

    def freedom(self) -> tuple[Array, Array]:
        """Least and largest physical step from theta, in units of `scale`, each of shape (groups,)."""
        low, high = ((end - self.theta) / self.parameters.scale for end in (self.parameters.low, self.parameters.high))
        return low - 1e-12, high + 1e-12

    def moved(self, step: Array) -> Array:
        """Theta after a step in units of `scale`, within its bounds; groups that are held keep theirs to the digit."""
        moved = self.theta + ~self.held * step * self.parameters.scale
        return np.clip(moved, self.parameters.low, self.parameters.high)

    def step(self, jacobian: Array, residual: Array) -> Array:
        """Least-squares step of theta in units of `scale`, shape (groups,), within the bounds, for these windows."""
        # QR reduces the problem to a few rows, whatever the length of the recording.
        triangle = np.asarray(np.linalg.qr(np.column_stack([jacobian, residual]), mode="r"))
        weak = _WEAK_PRIOR * max(float(np.linalg.norm(jacobian, axis=0).max(initial=0.0)), 1e-12)
        start = (self.parameters.start - self.theta) / self.parameters.scale
        matrix = np.vstack([triangle[:, :-1], weak * np.eye(len(start))])
        target = np.concatenate([triangle[:, -1], weak * start])
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
    theta = np.clip(problem.start, problem.low, problem.high)
    best, least = None, np.inf
    for _ in range(_ITERATIONS):
        predicted = problem.predict(runs, theta)
        columns = derivatives(problem, theta, predicted, lambda moved: problem.predict(runs, moved), held)
        jacobian = np.column_stack(columns)
        residual = runs.observed - predicted
        error = float(residual @ residual)
        if best is not None and error >= least * (1.0 - 1e-10):
            break
        best, least = Refit(problem, theta, predicted, jacobian, held), error
        theta = best.moved(best.step(jacobian, residual))
    assert best is not None
    return best


def estimates(model: Fitted, runs: Runs, block: Index) -> list[Estimate]:
    """Value and interval of each group, or why there is none; blocks, shape (windows,), count as independent."""
    fit, beside = model.groups, model.beside
    problem, jacobian = fit.parameters, fit.jacobian
    moving = excited(fit, runs)
    errors = np.full(len(problem.groups), np.inf)
    columns = np.column_stack([jacobian[:, moving], beside])
    errors[moving] = standard_errors(columns, runs.observed - fit.predicted, block)[: int(moving.sum())]
    errors *= problem.scale
    degrees_of_freedom = max(int(block.max()) + 1 - int(moving.sum()), 1)
    errors = np.hypot(errors, thresholds.GAIN_ERROR * np.abs(fit.theta))
    errors[ROLLING] = np.hypot(errors[ROLLING], runs.tilt_error_rad * abs(fit.theta[MASS]))
    widths = float(student.ppf(0.975, degrees_of_freedom)) * errors
    wide = float(student.ppf(1.0 - 0.025 / len(problem.groups), degrees_of_freedom)) * errors
    result = []
    for j, group in enumerate(problem.groups):
        assumed = problem.start[j] * problem.to_group[j]
        known = assumed if runs.unit == "W" or (problem.current_known and group.name != "rest_current") else None
        status, mixed = _status(fit, j, moving)
        fitted, width = fit.theta[j] * problem.to_group[j], widths[j] * problem.to_group[j]
        if status == "fitted" and (
            width > max(abs(assumed), abs(fitted))
            or reliability(_RESTS_ON.get(group.name, ""), runs) < thresholds.NEARLY_ALL
        ):
            status = "too uncertain"
        elif status == "fitted" and fit.at_bound[j]:
            status = "at bound"
        if status != "fitted":
            result.append(Estimate(group, known, None, None, status, mixed_with=mixed))
            continue
        interval = (max(float(fitted - width), 0.0), float(fitted + width))
        off = known is not None and abs(fitted - known) > wide[j] * problem.to_group[j]
        result.append(Estimate(group, known, float(fitted), interval, "fitted", off=bool(off)))
    return result


def _status(fit: Refit, number: int, excited: Mask) -> tuple[Status, tuple[str, ...]]:
    """Whether a group can be fitted; a confounded one with those whose columns make up most of its own."""
    if not excited[number]:
        return "not excited", ()
    column = fit.jacobian[:, number]
    others = np.flatnonzero(excited & (np.arange(len(excited)) != number))
    if not len(others):
        return "fitted", ()
    beside = fit.jacobian[:, others]
    weights = np.linalg.lstsq(beside, column, rcond=None)[0]
    own_part = column - beside @ weights
    if own_part @ own_part >= thresholds.COLLINEAR * (column @ column):
        return "fitted", ()
    projection = np.abs(weights) * np.linalg.norm(beside, axis=0)
    largest = others[projection >= thresholds.HALF * projection.max()]
    return "confounded", tuple(fit.parameters.groups[index].symbol for index in largest)


def standard_errors(jacobian: Array, residual: Array, block: Index) -> Array:
    """Standard errors of the parameters, shape (parameters,), from their `covariance`."""
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance(jacobian, residual, block)), 0.0)))


def covariance(jacobian: Array, residual: Array, block: Index) -> Array:
    """Covariance, (parameters, parameters), by the sandwich estimator clustered by block (Liang & Zeger, 1986)."""
    count, blocks = jacobian.shape[1], int(block.max()) + 1
    if count == 0:
        return np.zeros((0, 0))
    bread = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12)
    scores, n = per_block(jacobian * residual[:, None], block), len(residual)
    small_sample = blocks / max(blocks - 1, 1) * (n - 1) / max(n - count, 1)
    return np.asarray(small_sample * bread @ (scores.T @ scores) @ bread)
