"""The identifiable groups of parameters, five at most, with their bounds and predictions.

From sampled speed, grade and power only five groups of the model are identifiable: the idle and the
per-sample part of P_anc, C_rr m / Gamma, c / Gamma and m / Gamma; from motor current the last three
over k, the thrust per ampere, and the current at rest. Losses are therefore held at the robot
file's values and the rest is fitted; they are lowered only where braking returns more than they
allow (`homeward.diagnosis.explain.joint_fit`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.replay import Runs, WithEffects, predict, thrust_n_per_a
from homeward.logs.channels import Array, Mask
from homeward.physics import Robot
from homeward.physics.model import rolling_force

AT_REST, ROLLING, DRAG, MASS = 0, -3, -2, -1
"""Indices of theta, of power and of motor current."""

_IDLE_PARTS = ("sensing_idle_w", "communication_w", "controller_w")
_SAMPLE_PARTS = ("sensing_j_per_sample", "computer_j_per_sample")


@dataclass(frozen=True)
class Group:
    """One identifiable group: its name, symbol and unit, and whether its column is computed from
    measured motion."""

    name: str
    symbol: str
    unit: str
    measured: bool


GROUPS = {
    "W": (
        Group("idle_power", "P_anc, idle part", "W", False),
        Group("sample_energy", "P_anc, per sample", "J", False),
        Group("rolling", "C_rr m / Gamma", "kg", True),
        Group("drag", "c / Gamma", "N s^2/m^2", True),
        Group("mass", "m / Gamma", "kg", True),
    ),
    "A": (
        Group("rest_current", "current at rest", "A", False),
        Group("rolling", "C_rr m / ((1 - eta3) k)", "kg A/N", True),
        Group("drag", "c / ((1 - eta3) k)", "A s^2/m^2", True),
        Group("mass", "m / ((1 - eta3) k)", "kg A/N", True),
    ),
}
"""By unit of what was observed."""


@dataclass(frozen=True)
class Parameters:
    """The fitted parameters of a problem: a vector theta, its conversion to a robot, and its
    physical bounds.

    theta is (idle power W, energy per sample J, C_rr m kg, c N s^2/m^2, m kg) or, of motor current,
    (current at rest A, C_rr m, c, m), with the losses (and the thrust per ampere) as assumed.
    Arrays have shape (groups,).
    """

    nominal: Robot
    groups: tuple[Group, ...]
    start: Array
    low: Array
    high: Array
    scale: Array  # a plausible change of each
    to_group: Array  # group value = theta * to_group
    current_known: bool  # False: motor current with an unknown thrust per ampere

    def robot(self, theta: Array) -> Robot:
        """The robot with these parameters."""
        *ancillary, rolling_kg, drag, mass_kg = theta.tolist()
        if len(ancillary) == 2:
            idle_w, sample_j = ancillary
            at_rest = _ancillary_changes(self.nominal, idle_w, sample_j)
        else:
            at_rest = {"rest_current_a": max(ancillary[0], 0.0)}
        return dataclasses.replace(
            self.nominal,
            mass_kg=mass_kg,
            rolling_resistance=float(np.clip(rolling_kg / mass_kg, 1e-9, 1.0)),
            drag_ns2_per_m2=drag,
            **at_rest,
        )

    def of_efficiency(self, efficiency: float) -> Parameters:
        """The same groups over another efficiency of the drive, which the file's losses share.

        Of power: what the groups are over Gamma, which recordings show, stays as the file has it.
        """
        nominal = self.nominal
        as_often = float(np.log(efficiency) / np.log(nominal.traction_efficiency))
        ratio = efficiency / nominal.traction_efficiency
        to_new = np.where([group.measured for group in self.groups], ratio, 1.0)
        return dataclasses.replace(
            self,
            nominal=dataclasses.replace(
                nominal,
                motor_loss=1.0 - (1.0 - nominal.motor_loss) ** as_often,
                friction_loss=1.0 - (1.0 - nominal.friction_loss) ** as_often,
            ),
            start=self.start * to_new,
            low=self.low * to_new,
            high=self.high * to_new,
            scale=self.scale * to_new,
            to_group=self.to_group / to_new,
        )

    def predict(self, runs: Runs, theta: Array, with_effects: WithEffects | None = None) -> Array:
        """Prediction of these parameters, shape (windows,), with effects if any are given."""
        robot = self.robot(theta)
        additions = with_effects or WithEffects()
        if additions.effects:
            robot = with_effects_of(robot, additions.effects)
        return predict(runs, robot, additions)


def with_effects_of(robot: Robot, effects: Mapping[str, Mapping[str, float]]) -> Robot:
    """The robot with these effects; where its file has no track width, that fitted with an
    effect."""
    track_m = next(
        (numbers["track_m"] for numbers in effects.values() if "track_m" in numbers), robot.track_m
    )
    added = dict(robot.effects)
    for effect, numbers in effects.items():
        added[effect] = {name: value for name, value in numbers.items() if name != "track_m"}
    return dataclasses.replace(robot, track_m=track_m, effects=added)


def with_ancillary(robot: Robot, idle_w: float, sample_j: float) -> Robot:
    """The robot with another idle ancillary power and energy per sample, shared out as before."""
    changes = _ancillary_changes(robot, idle_w, sample_j)
    return dataclasses.replace(robot, **changes) if changes else robot


def _idle_w(robot: Robot) -> float:
    return robot.sensing_idle_w + robot.communication_w + robot.controller_w


def _sample_j(robot: Robot) -> float:
    return robot.sensing_j_per_sample + robot.computer_j_per_sample


def _ancillary_changes(robot: Robot, idle_w: float, sample_j: float) -> dict[str, Any]:
    """Fields of the robot's file, with their values, that another idle power and energy per sample
    change."""
    file_idle_w = _idle_w(robot)
    file_sample_j = _sample_j(robot)
    if idle_w == file_idle_w and sample_j == file_sample_j:
        return {}
    # Of a file without any, all is the controller's and the sensors'.
    changes: dict[str, Any] = {"controller_w": idle_w, "sensing_j_per_sample": sample_j}
    if file_idle_w > 0.0:
        changes |= {name: getattr(robot, name) * idle_w / file_idle_w for name in _IDLE_PARTS}
    if file_sample_j > 0.0:
        changes |= {name: getattr(robot, name) * sample_j / file_sample_j for name in _SAMPLE_PARTS}
    return changes


class _Row(NamedTuple):
    """Numbers of one component of theta."""

    start: float
    low: float
    high: float
    scale: float  # a plausible change


def parameters(runs: Runs, robot: Robot) -> Parameters:
    """Groups, bounds and starting values for these runs and this robot."""
    largest = float(np.max(runs.observed))
    current_known = runs.unit == "W" or robot.traction_n_per_a > 0.0
    if not current_known:
        # An arbitrary thrust per ampere: the groups do not depend on it.
        any_n_per_a = float(rolling_force(robot)) / max(largest, 1e-9)
        robot = dataclasses.replace(robot, traction_n_per_a=any_n_per_a)
    # Recordings show forces over the efficiency of the drive or over the thrust per ampere.
    divisor = robot.traction_efficiency if runs.unit == "W" else thrust_n_per_a(robot)
    groups = GROUPS[runs.unit]
    rows = [*_rows_at_rest(runs, robot), *_rows_of_motion(runs, robot)]
    start, low, high, scale = np.array(rows).T
    return Parameters(
        nominal=robot,
        groups=groups,
        start=start,
        low=low,
        high=high,
        scale=scale,
        to_group=np.where([group.measured for group in groups], 1.0 / divisor, 1.0),
        current_known=current_known,
    )


def _rows_at_rest(runs: Runs, robot: Robot) -> list[_Row]:
    """Idle power, W, and energy per sample, J; of motor current the current at rest, A."""
    idle = _idle_w(robot) if runs.unit == "W" else robot.rest_current_a
    largest = max(float(np.max(runs.observed)), 2.0 * idle, 1e-6)
    row_of_idle = _Row(start=idle, low=0.0, high=largest, scale=idle or largest / 10)
    if runs.unit == "A":
        return [row_of_idle]
    sample_j = _sample_j(robot)
    fastest_hz = max(float(np.max(runs.sensing_hz, initial=0.0)), robot.max_sensing_hz)
    largest_j = max(largest / fastest_hz, 2.0 * sample_j)
    return [
        row_of_idle,
        _Row(start=sample_j, low=0.0, high=largest_j, scale=sample_j or largest_j / 10),
    ]


def _rows_of_motion(runs: Runs, robot: Robot) -> list[_Row]:
    """Rolling resistance C_rr m, kg, drag c, N s^2/m^2, and mass m, kg."""
    mass_kg = robot.mass_kg
    rolling_kg = robot.rolling_resistance * mass_kg
    drag = robot.drag_ns2_per_m2
    most_times = thresholds.MOST_TIMES
    highest_drag = most_times * drag or _highest_unknown_drag(runs, robot)
    return [
        _Row(start=rolling_kg, low=1e-3 * rolling_kg, high=mass_kg, scale=rolling_kg),
        _Row(start=drag, low=0.0, high=highest_drag, scale=drag or highest_drag / 100),
        _Row(start=mass_kg, low=mass_kg / most_times, high=mass_kg * most_times, scale=mass_kg),
    ]


def _highest_unknown_drag(runs: Runs, robot: Robot) -> float:
    """Drag, N s^2/m^2, that takes ten times the largest recorded power or current at the top
    speed."""
    top_speed_mps = max(float(np.max(np.abs(runs.context["speed_mps"]))), 1e-3)
    n_per_unit = (
        robot.traction_efficiency / top_speed_mps if runs.unit == "W" else thrust_n_per_a(robot)
    )
    force_n = float(np.max(runs.observed)) * n_per_unit
    return 10.0 * force_n / top_speed_mps**2


def derivatives(
    problem: Parameters,
    theta: Array,
    predicted: Array,
    predict: Callable[[Array], Array],
    held: Mask | None = None,
) -> list[Array]:
    """Derivative of `predict` by each group in units of `scale`, (windows,) each, by a finite
    difference at theta.

    `predicted`, shape (windows,), is its value at theta; groups that are `held`, shape (groups,),
    have none.
    """
    columns = []
    for index in range(len(theta)):
        if held is not None and held[index]:
            columns.append(np.zeros(len(predicted)))
            continue
        step = 1e-4 * problem.scale[index]
        # At a bound backwards: beyond it the parameter means nothing.
        if theta[index] + step > problem.high[index]:
            step = -step
        moved = theta.copy()
        moved[index] += step
        columns.append((predict(moved) - predicted) / (step / problem.scale[index]))
    return columns
