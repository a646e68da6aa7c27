"""The identifiable groups of parameters, five at most, with their bounds and predictions.

From sampled speed, grade and power only five groups of the model are identifiable: the idle and the per-sample part of
P_anc, C_rr m / Gamma, c / Gamma and m / Gamma; from motor current the last three over k, the thrust per ampere, and the
current at rest. Losses are therefore held at the robot file's values and the rest is fitted.
"""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

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
    """One identifiable group: its name, symbol and unit, and whether its column is computed from measured motion."""

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
    """The fitted parameters of a problem: a vector theta, its conversion to a robot, and its physical bounds.

    theta is (idle power W, energy per sample J, C_rr m kg, c N s^2/m^2, m kg) or, of motor current, (current at rest A,
    C_rr m, c, m), with the losses (and the thrust per ampere) as assumed. Arrays have shape (groups,).
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
        *ancillary, rolling, drag, mass = theta.tolist()
        resistance = float(np.clip(rolling / mass, 1e-9, 1.0))
        if len(ancillary) == 2:
            at_rest = _ancillary_changes(self.nominal, *ancillary)
        else:
            at_rest = {"rest_current_a": max(ancillary[0], 0.0)}
        return dataclasses.replace(
            self.nominal, mass_kg=mass, rolling_resistance=resistance, drag_ns2_per_m2=drag, **at_rest
        )

    def predict(self, runs: Runs, theta: Array, with_effects: WithEffects | None = None) -> Array:
        """Prediction of these parameters, shape (windows,), with effects if any are given."""
        robot, extra = self.robot(theta), with_effects or WithEffects()
        if extra.effects:
            robot = with_effects_of(robot, extra.effects)
        return predict(runs, robot, extra)


def with_effects_of(robot: Robot, effects: Mapping[str, Mapping[str, float]]) -> Robot:
    """The robot with these effects; where its file has no track width, that fitted with an effect."""
    track_m = next((numbers["track_m"] for numbers in effects.values() if "track_m" in numbers), robot.track_m)
    added = {
        effect: {name: value for name, value in numbers.items() if name != "track_m"}
        for effect, numbers in effects.items()
    }
    return dataclasses.replace(robot, track_m=track_m, effects={**robot.effects, **added})


def with_ancillary(robot: Robot, idle_w: float, sample_j: float) -> Robot:
    """The robot with another idle ancillary power and energy per sample, shared out as before."""
    changes = _ancillary_changes(robot, idle_w, sample_j)
    return dataclasses.replace(robot, **changes) if changes else robot


def _ancillary_changes(robot: Robot, idle_w: float, sample_j: float) -> dict[str, Any]:
    """What that changes in the robot's file."""
    idle = robot.sensing_idle_w + robot.communication_w + robot.controller_w
    sample = robot.sensing_j_per_sample + robot.computer_j_per_sample
    if idle_w == idle and sample_j == sample:
        return {}
    changes: dict[str, Any] = {"controller_w": idle_w, "sensing_j_per_sample": sample_j}
    if idle > 0.0:
        changes |= {name: getattr(robot, name) * idle_w / idle for name in _IDLE_PARTS}
    if sample > 0.0:
        changes |= {name: getattr(robot, name) * sample_j / sample for name in _SAMPLE_PARTS}
    return changes


def parameters(runs: Runs, robot: Robot) -> Parameters:
    """Groups, bounds and starting values for these runs and this robot."""
    most = float(np.max(runs.observed))
    top_speed = max(float(np.max(np.abs(runs.context["speed_mps"]))), 1e-3)
    gamma = robot.traction_efficiency
    known = runs.unit == "W" or robot.traction_n_per_a > 0.0
    if not known:  # an arbitrary thrust per ampere: the groups do not depend on it
        robot = dataclasses.replace(robot, traction_n_per_a=float(rolling_force(robot)) / max(most, 1e-9))
    per = gamma if runs.unit == "W" else thrust_n_per_a(robot)
    idle = (
        robot.sensing_idle_w + robot.communication_w + robot.controller_w if runs.unit == "W" else robot.rest_current_a
    )
    sample = robot.sensing_j_per_sample + robot.computer_j_per_sample
    fastest_hz = max(float(np.max(runs.sensing_hz, initial=0.0)), robot.max_sensing_hz)
    # An unknown drag is bounded by ten times the largest recorded power.
    most_force = most * (gamma / top_speed if runs.unit == "W" else per)
    most_drag = thresholds.MOST_TIMES * robot.drag_ns2_per_m2 or 10.0 * most_force / top_speed**2
    most = max(most, 2.0 * idle, 1e-6)
    most_sample = max(most / fastest_hz, 2.0 * sample)
    rolling, drag, mass = robot.rolling_resistance * robot.mass_kg, robot.drag_ns2_per_m2, robot.mass_kg
    ancillary = [(idle, 0.0, most, idle or most / 10), (sample, 0.0, most_sample, sample or most_sample / 10)]
    start, low, high, scale = np.array([
        *(ancillary if runs.unit == "W" else ancillary[:1]),
        (rolling, 1e-3 * rolling, mass, rolling),
        (drag, 0.0, most_drag, drag or most_drag / 100),
        (mass, mass / thresholds.MOST_TIMES, mass * thresholds.MOST_TIMES, mass),
    ]).T  # fmt: skip
    groups = GROUPS[runs.unit]
    to_group = np.where([group.measured for group in groups], 1.0 / per, 1.0)
    return Parameters(robot, groups, start, low, high, scale, to_group, known)


def derivatives(
    problem: Parameters,
    theta: Array,
    predicted: Array,
    predict: Callable[[Array], Array],
    held: Mask | None = None,
) -> list[Array]:
    """Derivative of `predict` by each group in units of `scale`, (windows,) each, by a finite difference at theta.

    `predicted`, shape (windows,), is its value at theta; groups that are `held`, shape (groups,), have none.
    """
    columns = []
    for index in range(len(theta)):
        if held is not None and held[index]:
            columns.append(np.zeros(len(predicted)))
            continue
        step = 1e-4 * problem.scale[index]
        if theta[index] + step > problem.high[index]:
            step = -step
        moved = theta.copy()
        moved[index] += step
        columns.append((predict(moved) - predicted) / (step / problem.scale[index]))
    return columns
