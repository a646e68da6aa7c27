"""A robot to advise, written from the equations alone: it drives, draws power, and says what it
reads."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from homeward.companion import Advice, Companion
from homeward.physics import Robot, load_robot
from homeward.physics.battery import charge_share
from homeward.physics.model import GRAVITY_MPS2

HUSKY = dataclasses.replace(load_robot("husky"), chemistry="flat", cells_in_series=0)
"""A Husky with a battery of constant voltage: what its chemistry does is tested with the
battery."""


class Driven:
    """Drives at 1 m/s on a plane, harder to roll and with less in its battery than its file
    says."""

    def __init__(
        self, robot: Robot = HUSKY, rolling: float = 1.0, health: float = 1.0, every_s: float = 1.0
    ) -> None:
        self.robot = robot
        self.rolling, self.health, self.every_s = rolling, health, every_s
        self.time_s, self.used_j, self.xy = 0.0, 0.0, np.zeros(2)

    @property
    def full_j(self) -> float:
        return self.health * self.robot.usable_energy_j

    @property
    def left_j(self) -> float:
        return self.full_j - self.used_j

    def power_w(self, speed_mps: float = 1.0) -> float:
        r = self.robot
        force_n = (
            self.rolling * r.rolling_resistance * r.mass_kg * GRAVITY_MPS2
            + r.drag_ns2_per_m2 * speed_mps**2
        )
        idle_w = r.sensing_idle_w + r.communication_w + r.controller_w
        return idle_w + force_n * speed_mps / ((1.0 - r.motor_loss) * (1.0 - r.friction_loss))

    def drive(
        self, companion: Companion, heading_rad: float, seconds: float, **other: Any
    ) -> Advice:
        """Drive on, and be advised; `other` replaces what is read, None silences it."""
        for _ in range(round(seconds / self.every_s)):
            self.time_s += self.every_s
            self.used_j += self.power_w() * self.every_s
            self.xy = self.xy + self.every_s * np.array([np.cos(heading_rad), np.sin(heading_rad)])
            advice = companion.update(self.time_s, **self.reads(heading_rad) | other)
        return advice

    def charge(self) -> float:
        """Share of the charge that is left, which gauges show."""
        return float(charge_share(self.robot.curve, self.left_j / self.full_j))

    def reads(self, heading_rad: float) -> dict[str, Any]:
        return {
            "speed_mps": 1.0, "power_w": self.power_w(), "soc": self.charge(), "grade_rad": 0.0,
            "heading_rad": heading_rad, "position": (float(self.xy[0]), float(self.xy[1])),
        }  # fmt: skip
