"""Robots of the plants: presets, and three whose numbers are round figures typical of their class, not of a product."""

from __future__ import annotations

import dataclasses

import numpy as np

from homeward.physics import Robot, load_robot

FLEET: dict[str, Robot] = {
    **{name: load_robot(name) for name in ("rusti_computer", "husky", "jackal")},
    "van": Robot(
        name="van", description="Electric delivery van, 400 V.",
        mass_kg=1500.0, rolling_resistance=0.011, drag_ns2_per_m2=0.55, track_m=1.5,
        rated_energy_j=1.3e8, nominal_voltage_v=400.0, motor_loss=0.09, friction_loss=0.05,
        min_speed_mps=0.5, max_speed_mps=17.0,
        sensing_idle_w=30.0, sensing_j_per_sample=2.0, max_sensing_hz=30.0, communication_w=10.0, controller_w=350.0,
    ),
    "courier": Robot(
        name="courier", description="Sidewalk delivery robot on pneumatic tyres, 48 V.",
        mass_kg=42.0, rolling_resistance=0.02, drag_ns2_per_m2=0.2, track_m=0.5,
        rated_energy_j=4.3e6, nominal_voltage_v=48.0, motor_loss=0.12, friction_loss=0.1,
        min_speed_mps=0.1, max_speed_mps=2.5,
        sensing_idle_w=6.0, sensing_j_per_sample=0.3, max_sensing_hz=30.0, communication_w=3.0, controller_w=14.0,
    ),
    "porter": Robot(
        name="porter", description="Indoor transport robot with cameras, 24 V.",
        mass_kg=60.0, rolling_resistance=0.035, drag_ns2_per_m2=0.25, track_m=0.45,
        rated_energy_j=2.6e6, nominal_voltage_v=24.0, motor_loss=0.15, friction_loss=0.2,
        min_speed_mps=0.05, max_speed_mps=1.5,
        sensing_idle_w=4.0, sensing_j_per_sample=0.25, max_sensing_hz=30.0, communication_w=2.0, controller_w=16.0,
    ),
}  # fmt: skip
"""The nominal files, which are all that the tool gets to know of a robot."""


def off_nominal(robot: Robot, rng: np.random.Generator, share: float) -> Robot:
    """The robot that really drives: groups that a refit can tell apart are up to `share` away from the file."""
    factor = dict(zip(_REFITTABLE, rng.uniform(1.0 - share, 1.0 + share, len(_REFITTABLE)), strict=True))
    return _scaled(robot, factor)


def misset(robot: Robot, rng: np.random.Generator) -> Robot:
    """The robot of a file that is wrong: one to three of the refittable groups are 10 to 50 % away from it.

    One of them matters on every drive; the others may be of no weight, as the drag of a slow robot is.
    """
    more = rng.choice(_REFITTABLE, rng.integers(0, 3), replace=False)
    chosen = sorted({str(rng.choice(("mass_kg", "rolling_resistance", "controller_w"))), *map(str, more)})
    away = rng.uniform(0.1, 0.5, len(chosen)) * rng.choice((-1.0, 1.0), len(chosen))
    return _scaled(robot, {name: 1.0 + change for name, change in zip(chosen, away, strict=True)})


_REFITTABLE = ("mass_kg", "rolling_resistance", "drag_ns2_per_m2", "controller_w", "sensing_j_per_sample",
               "computer_j_per_sample")  # fmt: skip


def _scaled(robot: Robot, factor: dict[str, float]) -> Robot:
    return dataclasses.replace(robot, **{name: getattr(robot, name) * value for name, value in factor.items()})
