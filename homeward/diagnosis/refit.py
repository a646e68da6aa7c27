"""The best the known physics can do: refit the groups of parameters that a recording can tell apart.

From sampled speed, grade and power only five groups of the model are identifiable: the idle and the per-sample part of
P_anc, C_rr m / Gamma, c / Gamma and m / Gamma; from motor current the last three over k, the thrust per ampere, and the
current at rest. Losses are therefore kept as the robot file has them and the rest is fitted.

Least squares on window means, not a robust loss: a median ignores the peaks, and the energy is in the peaks. Intervals
come from a sandwich estimator clustered by block, which holds under autocorrelated and uneven residuals.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.stats import t as student

from homeward.diagnosis.regression import bounded
from homeward.diagnosis.replay import Runs, predict, thrust_n_per_a
from homeward.diagnosis.signals import Array
from homeward.physics import Robot

Status = Literal["fitted", "not excited", "confounded", "too uncertain", "at bound"]

IDLE, SAMPLE, ROLLING, DRAG, MASS = range(5)
"""Indices of theta."""

_ITERATIONS = 12
_WEAK_PRIOR = 1e-5  # of a column's norm: keeps a parameter that the data leave open at its assumed value
_COLLINEAR = 1e-4  # a column of which less than this share is its own cannot be told apart from the others
_NOISE_ONLY = 0.2  # a column whose own part has less than this autocorrelation varies by measurement noise only


@dataclass(frozen=True)
class Group:
    """One identifiable group: its name, symbol and unit, and whether measured motion is behind its column."""

    name: str
    symbol: str
    unit: str
    measured: bool


@dataclass(frozen=True)
class Estimate:
    """What the recordings say about a group; `fitted` and `ci95` are None where they say nothing."""

    group: Group
    assumed: float | None
    fitted: float | None
    ci95: tuple[float, float] | None
    status: Status
    mixed_with: tuple[str, ...] = ()
    off: bool = False  # excludes what the robot file assumes, at 5 % over all groups together


@dataclass(frozen=True)
class WithEffects:
    """What a prediction adds to the robot: effects by id with their parameters, a wind, a lag of the instrument."""

    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    headwind_mps: Sequence[Array] | None = None  # an array per run
    lag_s: float = 0.0
    speed_factors: Sequence[float] | None = None  # true over recorded speed, a number per run


@dataclass(frozen=True)
class Parameters:
    """The fitted parameters of a problem: a vector theta, how it becomes a robot, and its physical bounds.

    theta is (idle power W or rest current A, energy per sample J, C_rr m kg, c N s^2/m^2, m kg), with the losses (and
    the thrust per ampere) as assumed. Per-sample energy has no influence on motor current.
    """

    nominal: Robot
    groups: tuple[Group, ...]
    start: Array
    low: Array
    high: Array
    scale: Array  # a plausible change of each
    to_group: Array  # group value = theta * to_group
    current_known: bool  # False: motor current without a known thrust per ampere

    def robot(self, theta: Array) -> Robot:
        """The robot with these parameters."""
        idle, sample, rolling, drag, mass = theta.tolist()
        robot = dataclasses.replace(
            self.nominal,
            mass_kg=mass,
            rolling_resistance=float(np.clip(rolling / mass, 1e-9, 1.0)),
            drag_ns2_per_m2=drag,
        )
        return robot if len(self.groups) == 4 else with_ancillary(robot, idle, sample)

    def predict(self, runs: Runs, theta: Array, with_effects: WithEffects | None = None) -> Array:
        """What these parameters predict, shape (windows,), with effects if any are given."""
        robot, extra = self.robot(theta), with_effects or WithEffects()
        if extra.effects:
            robot = with_effects_of(robot, extra.effects)
        rest_current_a = float(theta[0]) if runs.unit == "A" else 0.0
        return predict(runs, robot, rest_current_a, extra.headwind_mps, extra.lag_s, extra.speed_factors)

    def active(self) -> NDArray[np.intp]:
        """Indices of theta that the groups stand for."""
        return np.array([0, 2, 3, 4] if len(self.groups) == 4 else [0, 1, 2, 3, 4])


def with_effects_of(robot: Robot, effects: Mapping[str, Mapping[str, float]]) -> Robot:
    """The robot with these effects; where its file has no track, the one that turning was fitted with."""
    turning = dict(effects.get("turning", {}))
    track_m = turning.pop("track_m", robot.track_m)
    added = {**effects, "turning": turning} if turning else effects
    return dataclasses.replace(robot, track_m=track_m, effects={**robot.effects, **added})


def with_ancillary(robot: Robot, idle_w: float, sample_j: float) -> Robot:
    """The robot with another idle ancillary power and energy per sample, shared out as before."""
    idle = robot.sensing_idle_w + robot.communication_w + robot.controller_w
    sample = robot.sensing_j_per_sample + robot.computer_j_per_sample
    changes: dict[str, Any] = {}
    if idle > 0.0:
        for name in ("sensing_idle_w", "communication_w", "controller_w"):
            changes[name] = getattr(robot, name) * idle_w / idle
    else:
        changes["controller_w"] = idle_w
    if sample > 0.0:
        for name in ("sensing_j_per_sample", "computer_j_per_sample"):
            changes[name] = getattr(robot, name) * sample_j / sample
    else:
        changes["sensing_j_per_sample"] = sample_j
    return dataclasses.replace(robot, **changes)


def parameters(runs: Runs, robot: Robot) -> Parameters:
    """Groups, bounds and starting values for these runs and this robot."""
    most = float(np.max(runs.observed))
    top_speed = max(float(np.max(np.abs(runs.context["speed_mps"]))), 1e-3)
    gamma = robot.traction_efficiency
    known = runs.unit == "W" or robot.traction_n_per_a > 0.0
    if not known:  # any thrust per ampere will do: the groups do not depend on it
        robot = dataclasses.replace(
            robot, traction_n_per_a=robot.rolling_resistance * robot.mass_kg * 9.8 / max(most, 1e-9)
        )
    per = gamma if runs.unit == "W" else thrust_n_per_a(robot)
    idle = robot.sensing_idle_w + robot.communication_w + robot.controller_w if runs.unit == "W" else 0.0
    sample = robot.sensing_j_per_sample + robot.computer_j_per_sample
    fastest_hz = max(float(np.max(runs.context.get("sensing_hz", np.zeros(1)), initial=0.0)), robot.max_sensing_hz)
    # Drag that alone would take ten times all that was drawn is out of the question.
    most_force = most * (gamma / top_speed if runs.unit == "W" else per)
    most_drag = max(10.0 * most_force / top_speed**2, 2.0 * robot.drag_ns2_per_m2)
    most = max(most, 2.0 * idle, 1e-6)
    most_sample = max(most / fastest_hz, 2.0 * sample)
    rolling = robot.rolling_resistance * robot.mass_kg
    start = np.array([idle, sample, rolling, robot.drag_ns2_per_m2, robot.mass_kg])
    scale = np.array([
        idle or most / 10, sample or most_sample / 10, rolling, robot.drag_ns2_per_m2 or most_drag / 100, robot.mass_kg
    ])  # fmt: skip
    low = np.array([0.0, 0.0, 1e-3 * rolling, 0.0, robot.mass_kg / 5])
    high = np.array([most, most_sample, robot.mass_kg, most_drag, robot.mass_kg * 5])
    drive = 1.0 / per
    groups: tuple[Group, ...]
    if runs.unit == "W":
        groups = (
            Group("idle_power", "P_anc, idle part", "W", False),
            Group("sample_energy", "P_anc, per sample", "J", False),
            Group("rolling", "C_rr m / Gamma", "kg", True),
            Group("drag", "c / Gamma", "N s^2/m^2", True),
            Group("mass", "m / Gamma", "kg", True),
        )
        return Parameters(robot, groups, start, low, high, scale, np.array([1.0, 1.0, drive, drive, drive]), known)
    groups = (
        Group("rest_current", "current at rest", "A", False),
        Group("rolling", "C_rr m / ((1 - eta3) k)", "kg A/N", True),
        Group("drag", "c / ((1 - eta3) k)", "A s^2/m^2", True),
        Group("mass", "m / ((1 - eta3) k)", "kg A/N", True),
    )
    return Parameters(robot, groups, start, low, high, scale, np.array([1.0, drive, drive, drive]), known)


@dataclass(frozen=True)
class Refit:
    """A fit with what it takes to redo it on a part of the windows: at theta, predicted and its Jacobian."""

    parameters: Parameters
    theta: Array  # (5,)
    predicted: Array  # (windows,)
    jacobian: Array  # (windows, groups), per unit of `scale`
    at_bound: NDArray[np.bool_]  # (groups,)

    @property
    def robot(self) -> Robot:
        """The robot with the fitted parameters."""
        return self.parameters.robot(self.theta)

    def freedom(self) -> tuple[Array, Array]:
        """Least and largest step from theta that is physical, in units of `scale`, each of shape (groups,)."""
        problem = self.parameters
        active = problem.active()
        scale = problem.scale[active]
        return (problem.low - self.theta)[active] / scale - 1e-12, (problem.high - self.theta)[active] / scale + 1e-12

    def excited(self, runs: Runs, share: float = 1e-6) -> NDArray[np.bool_]:
        """Whether a plausible change of each group moves the prediction by this share, shape (groups,)."""
        norms = np.linalg.norm(self.jacobian, axis=0)
        excited: NDArray[np.bool_] = norms > share * max(float(np.linalg.norm(runs.observed)), 1e-12)
        return excited

    def moved(self, step: Array) -> Array:
        """Theta after a step in units of `scale`, within its bounds."""
        problem = self.parameters
        theta = self.theta.copy()
        active = problem.active()
        theta[active] += step * problem.scale[active]
        return np.clip(theta, problem.low, problem.high)

    def with_columns(self, chosen: NDArray[np.bool_], observed: Array, beside: Array) -> Array:
        """As `on`, with further columns of any size and sign beside the groups, shape (windows, columns)."""
        columns = np.column_stack([self.jacobian, beside])
        low, high = self.freedom()
        free = np.full(beside.shape[1], np.inf)
        part = columns[chosen]
        weights = bounded(
            part.T @ part,
            part.T @ (observed - self.predicted)[chosen],
            np.concatenate([low, -free]),
            np.concatenate([high, free]),
        )
        predicted: Array = self.predicted + columns @ weights
        return predicted

    def on(self, chosen: NDArray[np.bool_], observed: Array) -> Array:
        """Prediction for all windows by parameters fitted on the chosen ones only, shape (windows,)."""
        step, _ = _solve(self.parameters, self.theta, self.jacobian[chosen], (observed - self.predicted)[chosen])
        predicted: Array = self.predicted + self.jacobian @ step
        return predicted


def refit(runs: Runs, robot: Robot) -> Refit:
    """Fit the groups to all windows within physical bounds, by Gauss-Newton through the replay."""
    problem = parameters(runs, robot)
    theta = np.clip(problem.start, problem.low, problem.high)
    at_bound = np.zeros(len(problem.active()), dtype=bool)
    best: tuple[float, Refit] | None = None
    for _ in range(_ITERATIONS):
        predicted, jacobian = _linearised(problem, runs, theta)
        residual = runs.observed - predicted
        error = float(residual @ residual)
        if best is not None and error >= best[0] * (1.0 - 1e-10):
            break
        best = error, Refit(problem, theta, predicted, jacobian, at_bound)
        step, at_bound = _solve(problem, theta, jacobian, residual)
        theta = best[1].moved(step)
    assert best is not None
    return best[1]


def _linearised(problem: Parameters, runs: Runs, theta: Array) -> tuple[Array, Array]:
    predicted = problem.predict(runs, theta)
    columns = derivatives(problem, theta, predicted, lambda moved: problem.predict(runs, moved))
    return predicted, np.column_stack(columns)


def derivatives(problem: Parameters, theta: Array, predicted: Array, predict: Callable[[Array], Array]) -> list[Array]:
    """Derivative of a prediction by each group in units of `scale`, by a small step within the bounds.

    Args:
        problem: The fitted parameters.
        theta: Where to differentiate.
        predicted: What `predict` gives there, shape (windows,).
        predict: Prediction as a function of theta.
    """
    columns = []
    for index in problem.active():
        step = 1e-4 * problem.scale[index]
        if theta[index] + step > problem.high[index]:
            step = -step
        moved = theta.copy()
        moved[index] += step
        columns.append((predict(moved) - predicted) / (step / problem.scale[index]))
    return columns


def _solve(problem: Parameters, theta: Array, jacobian: Array, residual: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Step of theta in units of `scale`, within the bounds, and which bounds it ends at."""
    active = problem.active()
    scale = problem.scale[active]
    # Normal equations through a triangle: a few rows whatever the length of the recording.
    triangle = np.asarray(np.linalg.qr(np.column_stack([jacobian, residual]), mode="r"))
    weak = _WEAK_PRIOR * max(float(np.linalg.norm(jacobian, axis=0).max(initial=0.0)), 1e-12)
    start = (problem.start - theta)[active] / scale
    matrix = np.vstack([triangle[:, :-1], weak * np.eye(len(active))])
    target = np.concatenate([triangle[:, -1], weak * start])
    low = (problem.low - theta)[active] / scale - 1e-12
    high = (problem.high - theta)[active] / scale + 1e-12
    solution = lsq_linear(matrix, target, (low, high), method="bvls")
    return solution.x, solution.active_mask != 0


def estimates(fit: Refit, runs: Runs, block: NDArray[np.intp], beside: Array | None = None) -> list[Estimate]:
    """Value and interval of each group, or why there is none.

    Args:
        fit: The fit to all windows.
        runs: The windows it was fitted to.
        block: Block of each window, shape (windows,): residuals of different blocks count as independent.
        beside: Columns of effects that were fitted together with the groups, shape (windows, columns).
    """
    problem, jacobian = fit.parameters, fit.jacobian
    active = problem.active()
    excited = fit.excited(runs)
    errors = np.full(len(active), np.inf)
    columns = jacobian[:, excited] if beside is None else np.column_stack([jacobian[:, excited], beside])
    errors[excited] = standard_errors(columns, runs.observed - fit.predicted, block)[: int(excited.sum())]
    errors *= problem.scale[active]
    freedom = max(int(block.max()) + 1 - int(excited.sum()), 1)
    widths = float(student.ppf(0.975, freedom)) * errors
    wide = float(student.ppf(1.0 - 0.025 / len(active), freedom)) * errors
    result = []
    for j, (index, group) in enumerate(zip(active, problem.groups, strict=True)):
        assumed = problem.start[index] * problem.to_group[j]
        known = assumed if runs.unit == "W" or (problem.current_known and group.name != "rest_current") else None
        status, mixed = _status(fit, runs, j, excited)
        fitted, width = fit.theta[index] * problem.to_group[j], widths[j] * problem.to_group[j]
        if status == "fitted" and width > max(abs(assumed), abs(fitted)):
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


def _status(fit: Refit, runs: Runs, j: int, excited: NDArray[np.bool_]) -> tuple[Status, tuple[str, ...]]:
    if not excited[j]:
        return "not excited", ()
    others = np.flatnonzero(excited & (np.arange(len(excited)) != j))
    column = fit.jacobian[:, j]
    weights: Array = np.zeros(len(others))
    if len(others):
        weights = np.linalg.lstsq(fit.jacobian[:, others], column, rcond=None)[0].astype(np.float64)
    own = column - fit.jacobian[:, others] @ weights
    mixed = _share_named(fit, j, others, weights)
    if own @ own < _COLLINEAR * (column @ column):
        return "confounded", mixed
    same_run = runs.run[1:] == runs.run[:-1]
    if fit.parameters.groups[j].measured and same_run.any():
        lagged = float((own[1:] * own[:-1])[same_run].mean() / (own * own).mean())
        if lagged < _NOISE_ONLY and own @ own < 0.01 * (column @ column):
            return "confounded", mixed
    return "fitted", ()


def _share_named(fit: Refit, j: int, others: NDArray[np.intp], weights: Array) -> tuple[str, ...]:
    size = np.abs(weights) * np.linalg.norm(fit.jacobian[:, others], axis=0)
    largest = 0.2 * np.linalg.norm(fit.jacobian[:, j])
    return tuple(fit.parameters.groups[o].symbol for o, s in zip(others, size, strict=True) if s > largest)


def standard_errors(jacobian: Array, residual: Array, block: NDArray[np.intp]) -> Array:
    """Standard errors of the parameters by the sandwich estimator clustered by block (Liang & Zeger, 1986)."""
    count, blocks = jacobian.shape[1], int(block.max()) + 1
    if count == 0:
        return np.zeros(0)
    bread = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12)
    scores = np.zeros((blocks, count))
    np.add.at(scores, block, jacobian * residual[:, None])
    n = len(residual)
    small_sample = blocks / max(blocks - 1, 1) * (n - 1) / max(n - count, 1)
    covariance = small_sample * bread @ (scores.T @ scores) @ bread
    errors: Array = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return errors
