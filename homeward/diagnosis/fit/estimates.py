"""What the recordings show of each group: its value and interval, or why there is none."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import t as student

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.channel_errors import reliability
from homeward.diagnosis.fit.fitted import Fitted, excited
from homeward.diagnosis.fit.folds import per_block
from homeward.diagnosis.fit.parameter_groups import MASS, ROLLING, Group
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.autocorrelation import correlation_windows
from homeward.logs.channels import Array, Index, Mask

Status = Literal["fitted", "not excited", "confounded", "too uncertain", "attenuated", "at bound"]

_RESTS_ON = {"rolling": "speed_mps", "drag": "speed_mps", "mass": "grade_rad"}


@dataclass(frozen=True)
class Estimate:
    """Estimate of a group, in its unit; `fitted` and `ci95` are None where it is not
    identifiable."""

    group: Group
    assumed: float | None
    fitted: float | None
    ci95: tuple[float, float] | None
    status: Status
    mixed_with: tuple[str, ...] = ()
    off: bool = False  # significantly differs from the robot file, at 5 % over all groups together

    def confounded(self, mixed_with: tuple[str, ...]) -> Estimate:
        """The same where it is confounded with others, so that it has no value."""
        return dataclasses.replace(
            self, fitted=None, ci95=None, status="confounded", mixed_with=mixed_with, off=False
        )


def estimates(model: Fitted, runs: Runs, block: Index) -> list[Estimate]:
    """Value and interval of each group, or why there is none; blocks, shape (windows,), count as
    independent."""
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
    """Standard errors of theta, shape (groups,), with those of the instruments; infinite where it
    is not excited."""
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


def _estimate(
    fit: Refit, runs: Runs, number: int, is_excited: Mask, width: float, width_of_all: float
) -> Estimate:
    """Estimate of one group with an interval of this half width; `width_of_all` is that by which it
    counts as off."""
    problem = fit.parameters
    group = problem.groups[number]
    start = problem.start[number] * problem.to_group[number]
    fitted = fit.theta[number] * problem.to_group[number]
    in_file = runs.unit == "W" or (problem.current_known and group.name != "rest_current")
    assumed = start if in_file else None
    status, mixed_with = _status(fit, number, is_excited)
    if status == "fitted":
        # A regression on a channel that is partly noise is attenuated, beyond what its interval
        # says.
        channel = _RESTS_ON.get(group.name, "")
        if reliability(channel, runs) < thresholds.NEARLY_ALL:
            status = "attenuated"
        elif width > max(abs(start), abs(fitted)):
            status = "too uncertain"
        elif fit.at_bound[number]:
            status = "at bound"
    if status != "fitted":
        return Estimate(
            group, assumed, fitted=None, ci95=None, status=status, mixed_with=mixed_with
        )
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
    """Whether a group can be fitted; a confounded one with those whose columns make up most of its
    own."""
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
    """Covariance, (parameters, parameters), by the sandwich estimator clustered by block (Liang &
    Zeger, 1986)."""
    windows, columns = jacobian.shape
    if columns == 0:
        return np.zeros((0, 0))
    bread = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12)
    scores = per_block(jacobian * residual[:, None], block)
    meat = scores.T @ scores
    blocks = len(scores)
    small_sample = blocks / max(blocks - 1, 1) * (windows - 1) / max(windows - columns, 1)
    return np.asarray(small_sample * bread @ meat @ bread)


def lasting_covariance(jacobian: Array, residual: Array, run: Index) -> Array:
    """Covariance, (parameters, parameters), of errors that are alike in all windows and
    autocorrelated within a run, `run` of shape (windows,)."""
    freedom = max(len(residual) - int(np.linalg.matrix_rank(jacobian)), 1)
    square = float(residual @ residual) / freedom * correlation_windows(residual, run)
    return np.asarray(square * np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12))
