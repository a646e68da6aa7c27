"""The robot: what it consumes, and what its instruments record of a drive.

It equals the preset `husky`, with a battery that has an internal resistance. What that loses is seen
in the voltage only, as the power is measured at the terminals.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.random import Generator

from benchmarks.concealed.fixed_way.drive import Drive
from benchmarks.concealed.fixed_way.noise import Array, drift

GRAVITY_MPS2 = 9.80665  # standard gravity (CGPM 1901)
# Of the preset `husky`, where each has its source.
MASS_KG = 50.0
ROLLING_RESISTANCE = 0.14
DRAG_NS2_PER_M2 = 0.13
MOTOR_LOSS = 0.047
FRICTION_LOSS = 0.271
EFFICIENCY = (1 - MOTOR_LOSS) * (1 - FRICTION_LOSS)
STANDBY_W = 8.0 + 2.0 + 50.0  # lidar, radio, controller
J_PER_SAMPLE = 0.7
RATED_ENERGY_J = 1728000.0

SENSING_HZ = 20.0  # chosen: below the 25 or 50 Hz of the lidar, and the same all the time
RESISTANCE_OHM = 0.02  # chosen: two sealed lead-acid batteries of 10 mOhm in series
EMPTY_V = 23.2  # chosen: rest voltage of 12 cells of lead acid, about 1.93 V each
FULL_ABOVE_EMPTY_V = 2.4  # chosen: about 2.13 V a cell when full
START_SOC = (0.92, 0.98)  # chosen: a drive starts after charging

# Noise of the instruments, all chosen: good shunts, encoders and an industrial IMU.
VOLTAGE_NOISE_V = 0.006
CURRENT_NOISE_SHARE = 0.01
CURRENT_NOISE_A = 0.01
SPEED_SCALE_SHARE = 0.002  # error of the wheel radius, the same throughout a drive
SPEED_NOISE_SHARE = 0.01
SPEED_NOISE_MPS = 0.002
GRADE_OFFSET_RAD = 0.001  # the same throughout a drive
GRADE_NOISE_RAD = 0.004
GRADE_DRIFT_RAD = 0.0015
GRADE_DRIFT_S = 5.0
TEMPERATURE_DRIFT_C = 0.15
TEMPERATURE_DRIFT_S = 60.0
HEADING_DRIFT_RAD = 0.01
HEADING_DRIFT_S = 20.0
YAW_RATE_NOISE_RADPS = 0.008
BASE_DISTANCE_DRIFT_M = 0.25
BASE_DISTANCE_DRIFT_S = 10.0


@dataclass(frozen=True)
class Hidden:
    """What is hidden in one drive, each a number or of shape (n,); 0 where nothing is."""

    surface_share: Array | float = 0.0  # additional rolling resistance
    viscous_ns_per_m: Array | float = 0.0  # additional force by speed
    force_n: Array | float = 0.0  # additional force
    drive_share: Array | float = 0.0  # additional power of the drive
    payload_kg: Array | float = 0.0
    load_w: Array | float = 0.0

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the fields that are not 0 throughout."""
        names = [field.name for field in dataclasses.fields(self)]
        return tuple(name for name in names if np.any(getattr(self, name)))

    def without(self, names: Collection[str]) -> Hidden:
        """The same with fields of these names 0."""
        return dataclasses.replace(self, **dict.fromkeys(names, 0.0))


def power_w(drive: Drive, hidden: Hidden) -> Array:
    """Power at the battery's terminals, W, shape (n,).

    The paper's model with additional forces; braking gives no energy back, and acceleration takes
    none.
    """
    speed_mps = drive.speed_mps
    mass_kg = MASS_KG + hidden.payload_kg
    resistance = ROLLING_RESISTANCE * (1 + hidden.surface_share)
    rolling_n = resistance * mass_kg * GRAVITY_MPS2 * np.cos(drive.grade_rad)
    climbing_n = mass_kg * GRAVITY_MPS2 * np.sin(drive.grade_rad)
    air_drag_n = DRAG_NS2_PER_M2 * speed_mps * speed_mps
    force_n = rolling_n + climbing_n + air_drag_n
    force_n = force_n + hidden.viscous_ns_per_m * speed_mps + hidden.force_n
    drive_w = np.maximum(force_n, 0.0) * speed_mps / EFFICIENCY * (1 + hidden.drive_share)
    total_w = STANDBY_W + J_PER_SAMPLE * SENSING_HZ + drive_w + hidden.load_w
    return np.asarray(total_w, dtype=np.float64)


def energy_j(drives: Sequence[Drive], hidden: Sequence[Hidden]) -> float:
    """Energy of all drives, J."""
    total_j = 0.0
    for drive, hidden_in_drive in zip(drives, hidden, strict=True):
        total_j += float(power_w(drive, hidden_in_drive).sum()) * drive.dt_s
    return total_j


def record(drive: Drive, hidden: Hidden, temperature_c: float, rng: Generator) -> pd.DataFrame:
    """Record a drive with its instruments, with the columns of a recording.

    Args:
        drive: True motion.
        hidden: What is hidden in it.
        temperature_c: Mean temperature of the air, °C.
        rng: Random numbers.
    """
    count = len(drive.time_s)
    speed_mps = drive.speed_mps
    voltage_v, current_a = _battery(power_w(drive, hidden), drive.dt_s, rng)
    scale = 1 + rng.normal(0, SPEED_SCALE_SHARE)
    noisy_mps = speed_mps * scale * (1 + rng.normal(0, SPEED_NOISE_SHARE, count))
    noisy_mps = noisy_mps + rng.normal(0, SPEED_NOISE_MPS, count)
    grade_rad = _noisy_grade(drive, rng)
    temperature_drift_c = drift(rng, count, drive.dt_s, TEMPERATURE_DRIFT_S, TEMPERATURE_DRIFT_C)
    heading_drift_rad = drift(rng, count, drive.dt_s, HEADING_DRIFT_S, HEADING_DRIFT_RAD)
    heading_rad = drive.heading_rad + heading_drift_rad
    yaw_rate_radps = drive.yaw_rate_radps + rng.normal(0, YAW_RATE_NOISE_RADPS, count)
    base_drift_m = drift(rng, count, drive.dt_s, BASE_DISTANCE_DRIFT_S, BASE_DISTANCE_DRIFT_M)
    return pd.DataFrame(
        {
            "time_s": np.round(drive.time_s, 3),
            "speed_mps": np.round(np.where(speed_mps > 0, noisy_mps, 0.0), 4),
            "yaw_rate_radps": np.round(yaw_rate_radps, 4),
            "grade_rad": np.round(grade_rad, 4),
            "distance_m": np.round(np.cumsum(speed_mps * scale) * drive.dt_s, 3),
            "base_distance_m": np.round(np.clip(drive.place_m + base_drift_m, 0, None), 2),
            "heading_rad": np.round((heading_rad + np.pi) % (2 * np.pi) - np.pi, 4),
            "sensing_hz": np.full(count, SENSING_HZ),
            "temperature_c": np.round(temperature_c + temperature_drift_c, 1),
            "voltage_v": voltage_v,
            "current_a": current_a,
        }
    )


def _battery(true_w: Array, dt_s: float, rng: Generator) -> tuple[Array, Array]:
    """Recorded voltage, V, and current, A, shape (n,) each."""
    start_soc = rng.uniform(*START_SOC)
    soc = start_soc - np.cumsum(true_w) * dt_s / RATED_ENERGY_J
    rest_v = EMPTY_V + FULL_ABOVE_EMPTY_V * soc
    # the higher solution of V (rest_v - V) / R = P
    voltage_v = 0.5 * (rest_v + np.sqrt(rest_v**2 - 4 * RESISTANCE_OHM * true_w))
    current_a = true_w / voltage_v
    noisy_v = voltage_v + rng.normal(0, VOLTAGE_NOISE_V, len(true_w))
    noisy_a = current_a * (1 + rng.normal(0, CURRENT_NOISE_SHARE, len(true_w)))
    noisy_a = noisy_a + rng.normal(0, CURRENT_NOISE_A, len(true_w))
    return np.round(noisy_v, 3), np.round(noisy_a, 3)


def _noisy_grade(drive: Drive, rng: Generator) -> Array:
    count = len(drive.time_s)
    offset_rad = rng.normal(0, GRADE_OFFSET_RAD)
    noise_rad = rng.normal(0, GRADE_NOISE_RAD, count)
    drift_rad = drift(rng, count, drive.dt_s, GRADE_DRIFT_S, GRADE_DRIFT_RAD)
    return np.asarray(drive.grade_rad + offset_rad + noise_rad + drift_rad, dtype=np.float64)
