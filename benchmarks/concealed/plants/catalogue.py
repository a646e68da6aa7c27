"""Plants with the catalogue's own formulas, for the coverage of intervals: the public replay with
known parameters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from benchmarks.concealed.plants.chain import Work
from benchmarks.concealed.plants.motion import Array, Motion
from benchmarks.concealed.plants.vehicles import (
    GRAVITY_MPS2,
    Plant,
    rolling_power_w,
    typical_power_w,
)
from homeward.physics import Robot, replay

Truth = Callable[[Plant, Generator], dict[str, float]]


def _rolling_n(vehicle: Plant) -> float:
    return vehicle.robot.rolling_resistance * vehicle.robot.mass_kg * GRAVITY_MPS2


TRUTHS: dict[str, Truth] = {
    "inertia": lambda vehicle, rng: {"mass_factor": rng.uniform(1.0, 1.6)},
    "viscous": lambda vehicle, rng: {
        "drag_ns_per_m": rng.uniform(0.5, 1.0) * _rolling_n(vehicle) / vehicle.robot.max_speed_mps
    },
    "turning": lambda vehicle, rng: {"scrub": rng.uniform(0.2, 0.6)},
    "hidden_grade": lambda vehicle, rng: {"slope": rng.uniform(0.2, 0.4) * vehicle.robot.rolling_resistance},
    "slip": lambda vehicle, rng: {"per_load": rng.uniform(0.3, 1.0)},
    "copper_loss": lambda vehicle, rng: {
        "w_per_n2": rng.uniform(0.1, 0.3) * rolling_power_w(vehicle) / _rolling_n(vehicle) ** 2
    },
    "no_load": lambda vehicle, rng: {"power_w": rng.uniform(0.3, 0.6) * rolling_power_w(vehicle)},
    "compute": lambda vehicle, rng: {
        "power_w": rng.uniform(0.25, 0.5) * typical_power_w(vehicle), "base_share": rng.uniform(0.4, 0.8)
    },
    "radio": lambda vehicle, rng: {
        # Robot files allow at most 10 kW/km^2, which a truck that stays near its base would need.
        "w_per_km2": min(rng.uniform(0.3, 0.6) * typical_power_w(vehicle) / (0.7e-3 * vehicle.leg_m) ** 2, 1e4)
    },
    "heater": lambda vehicle, rng: {
        "w_per_k": rng.uniform(0.03, 0.08) * typical_power_w(vehicle), "on_below_c": rng.uniform(2.0, 8.0)
    },
    "cooler": lambda vehicle, rng: {
        "w_per_k": rng.uniform(0.03, 0.08) * typical_power_w(vehicle), "on_above_c": rng.uniform(24.0, 30.0)
    },
    "intermittent_load": lambda vehicle, rng: {
        "power_w": rng.uniform(0.25, 0.5) * typical_power_w(vehicle), "period_s": rng.uniform(30.0, 80.0),
        "duty": rng.uniform(0.3, 0.6),
    },
    "breakaway": lambda vehicle, rng: {
        # as above
        "start_j": min(rng.uniform(3.0, 8.0) * _rolling_n(vehicle) * vehicle.robot.max_speed_mps, 1e5)
    },
    "cold_battery": lambda vehicle, rng: {"per_k": rng.uniform(0.005, 0.012), "warm_c": rng.uniform(15.0, 22.0)},
}  # fmt: skip
"""Effects that a replay can compute from recorded channels alone, and how their true parameters are
drawn."""


def replayed_w(robot: Robot, run: Motion) -> Array:
    """Power of the drive by the replay, W; shape (n,)."""
    power_w = replay(
        robot, run.time_s, run.speed_mps, grade_rad=run.grade_rad, yaw_rate_radps=run.yaw_rate_radps,
        temperature_c=run.temperature_c, sensing_hz=run.sensing_hz, base_distance_m=run.base_distance_m,
        direction=run.direction,
    ).power_w  # fmt: skip
    return np.asarray(power_w, dtype=np.float64)


def replayed(vehicle: Plant, truth: Robot, run: Motion) -> Work:
    """The drive by the replay, in the form that instruments record."""
    work = Work(run, vehicle, "gauge")
    work.power_w = work.chemical_w = work.seen_w = replayed_w(truth, run)
    work.soc = np.full(run.time_s.size, 0.95)
    return work
