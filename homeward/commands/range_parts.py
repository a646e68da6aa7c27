"""Range and energy per metre by cause, of a robot that drives and stands in turn."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from homeward import Robot
from homeward.physics import below_cutoff, d_max, model, replay

_CYCLES = 100
"""Cycles of driving and standing in the mission of a robot with effects. Chosen: a cycle then takes
1 % of the battery."""


@dataclass(frozen=True)
class Mission:
    """A robot and its drive: slope in rad, duty cycle and sensing rate in Hz."""

    robot: Robot
    grade_rad: float
    duty: float
    sensing_hz: float

    def range_m(self, speed_mps: float) -> float:
        """Range, m."""
        return float(d_max(self.robot, speed_mps, self.grade_rad, self.duty, self.sensing_hz))

    def parts_j_per_m(self, speed_mps: float) -> dict[str, float]:
        """Energy that a metre consumes by part, J/m; zero parts are omitted."""
        if self.robot.active_effects:
            parts = self._parts_by_the_kernel(speed_mps)
        else:
            parts = self._parts_of_the_paper(speed_mps)
        return {name: part for name, part in parts.items() if part != 0.0}

    def below_cutoff_j(self, speed_mps: float) -> float:
        """Energy of a charge that stays in the battery below its cut-off, J."""
        return float(
            below_cutoff(self.robot, speed_mps, self.grade_rad, self.duty, self.sensing_hz)
        )

    def _parts_of_the_paper(self, speed_mps: float) -> dict[str, float]:
        """The terms of Eq. 7; where the slope drives the robot without power, forces consume
        nothing."""
        robot = self.robot
        per_m = 1.0 / (speed_mps * self.duty)
        per_n = 0.0
        if float(model.traction_force(robot, speed_mps, self.grade_rad)) > 0.0:
            per_n = 1.0 / robot.traction_efficiency
        return {
            "rolling": model.rolling_force(robot, math.cos(self.grade_rad)) * per_n,
            "drag": model.drag_force(robot, speed_mps) * per_n,
            "grade": model.grade_force(robot, math.sin(self.grade_rad)) * per_n,
            "sensing": model.sensing_power(robot, self.sensing_hz) * per_m,
            "communication": robot.communication_w * per_m,
            "controller": robot.controller_w * per_m,
            "computer": float(model.computer_power(robot, self.sensing_hz)) * per_m,
        }

    def _parts_by_the_kernel(self, speed_mps: float) -> dict[str, float]:
        """The energy by cause of a mission as long as the range, in many drives and stops."""
        whole = dataclasses.replace(self, robot=self.robot.without_cutoff())
        # what a battery that is cut off at once does not drive, the same without a cut-off does
        range_m = self.range_m(speed_mps) or whole.range_m(speed_mps)
        lasts_s = min(range_m, 1e9) / (speed_mps * self.duty)
        cycle_s = lasts_s / _CYCLES
        # Each cycle drives and stands; the stop is split in two, because the last sample holds as
        # long as the one before.
        phases = [0.0]
        if self.duty < 1.0:
            phases += [self.duty, 0.5 + 0.5 * self.duty]
        starts = np.add.outer(np.arange(float(_CYCLES)), np.array(phases)) * cycle_s
        speeds = np.where(np.arange(len(phases)) == 0, speed_mps, 0.0)
        driven = replay(
            self.robot, starts.ravel(), np.tile(speeds, _CYCLES), grade_rad=self.grade_rad, accel_mps2=0.0,
            sensing_hz=self.sensing_hz, direction=1.0,
        )  # fmt: skip
        way_m = lasts_s * speed_mps * self.duty
        return {name: joules / way_m for name, joules in driven.energy_j.items()}
