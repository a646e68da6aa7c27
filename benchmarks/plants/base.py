"""The paper's model as the plants drive by it, and how much of a hidden effect a refit of it would absorb."""

from __future__ import annotations

import numpy as np

from benchmarks.plants.drives import Array, Drive
from homeward.physics import Robot

GRAVITY_MPS2 = 9.80665


def force(robot: Robot, drive: Drive) -> Array:
    """Force at the wheels of Eq. 3, N, negative on steep descents; array of shape (n,)."""
    weight = robot.mass_kg * GRAVITY_MPS2
    slope = robot.rolling_resistance * np.cos(drive.grade_rad) + np.sin(drive.grade_rad)
    return np.asarray(weight * slope + robot.drag_ns2_per_m2 * drive.speed_mps**2)


def ancillary(robot: Robot, drive: Drive) -> Array:
    """Power of Eq. 5, with a computer that is off where nothing is sensed, W; array of shape (n,)."""
    rate = drive.sensing_hz
    always = robot.sensing_idle_w + robot.communication_w + robot.controller_w
    computer = np.where(rate > 0.0, robot.computer_w + robot.computer_j_per_sample * rate, 0.0)
    return np.asarray(always + robot.sensing_j_per_sample * rate + computer)


def drawn(robot: Robot, drive: Drive, force_n: Array) -> Array:
    """Power of Eq. 7 for a force at the wheels, which draws nothing where it is negative, W; array of shape (n,)."""
    efficiency = (1.0 - robot.motor_loss) * (1.0 - robot.friction_loss)
    return ancillary(robot, drive) + np.where(force_n > 0.0, force_n, 0.0) * drive.speed_mps / efficiency


def current(robot: Robot, drive: Drive, force_n: Array) -> Array:
    """Current of all motors for a force at the wheels, A; array of shape (n,)."""
    efficiency = (1.0 - robot.motor_loss) * (1.0 - robot.friction_loss)
    return np.where((force_n > 0.0) & (drive.speed_mps > 0.0), force_n, 0.0) / efficiency / robot.traction_n_per_a


def columns(robot: Robot, drive: Drive, torque: bool = False) -> Array:
    """What a refit explains with: idle, samples, C_rr m, c and m; only the last three of a torque; (n, 5 or 3)."""
    pulling = (force(robot, drive) > 0.0) * (drive.speed_mps > 0.0 if torque else drive.speed_mps)
    mechanical = [np.cos(drive.grade_rad) * pulling, drive.speed_mps**2 * pulling, np.sin(drive.grade_rad) * pulling]
    electrical = [] if torque else [np.ones_like(pulling), drive.sensing_hz]
    return np.stack([*electrical, *mechanical], axis=1)


def absorbed_share(effect: Array, columns: Array) -> float:
    """Share of a hidden effect that the best refit takes up, 0 to 1: one less the unexplained part of its square sum.

    Args:
        effect: What the effect adds to the observed quantity, shape (n,).
        columns: What a change of each parameter would add, shape (n, k).

    >>> rates = np.stack([np.ones(4), np.arange(4.0)], axis=1)
    >>> absorbed_share(np.full(4, 5.0), rates), round(absorbed_share(np.array([1.0, -1.0, -1.0, 1.0]), rates), 9)
    (1.0, 0.0)
    """
    size = np.abs(columns).max(axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    left = effect - scaled @ np.linalg.lstsq(scaled, effect)[0]
    return float(min(max(1.0 - left @ left / (effect @ effect), 0.0), 1.0))
