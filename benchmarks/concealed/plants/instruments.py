"""Instruments: noise at three levels, the channels of real logs, and common faults."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.random import Generator

from benchmarks.concealed.plants.chain import Work
from benchmarks.concealed.plants.effects import first_order
from benchmarks.concealed.plants.motion import Array
from benchmarks.concealed.plants.vehicles import typical_power_w


@dataclass(frozen=True)
class NoiseLevel:
    """Standard deviations of one sample."""

    power_share: float  # of the typical power
    voltage_share: float  # of the nominal voltage
    speed_share: float  # of the top speed, while moving
    grade_rad: float
    elevation_m: float
    yaw_rate_radps: float
    heading_rad: float
    temperature_c: float
    position_m: float
    charge_share: float


NOISES = {
    # INA226 with a good shunt (0.1 % class), 1000-line encoders, a tactical IMU, RTK
    "low": NoiseLevel(0.005, 0.0005, 0.002, 0.001, 0.01, 0.002, 0.005, 0.1, 0.02, 0.0005),
    # a Hall sensor (1 %) behind a motor's ripple, typical encoders, an industrial MEMS IMU,
    # differential GNSS
    "middle": NoiseLevel(0.02, 0.002, 0.007, 0.004, 0.05, 0.01, 0.02, 0.3, 0.2, 0.002),
    # a cheap Hall sensor, few-line encoders, a phone's IMU, plain GNSS with a barometer
    "high": NoiseLevel(0.06, 0.006, 0.02, 0.01, 0.15, 0.03, 0.05, 0.8, 1.0, 0.005),
}


@dataclass(frozen=True)
class Logging:
    """Columns of a log."""

    wheels: bool = False
    elevation: bool = False
    distance: bool = True
    charge: bool = True
    grade: bool = True


def record(work: Work, noise: NoiseLevel, logging: Logging, rng: Generator) -> pd.DataFrame:
    """Record a drive with its instruments, with the columns of a homeward recording."""
    run = work.run
    robot = work.vehicle.robot
    n = run.time_s.size

    def noisy(values: Array, deviation: float) -> Array:
        return np.asarray(values + deviation * rng.normal(size=n), dtype=np.float64)

    moving = run.speed_mps > 0.0
    speed = np.where(
        moving,
        noisy(run.speed_mps * work.odometer_gain, noise.speed_share * robot.max_speed_mps),
        0.0,
    )
    yaw = noisy(run.yaw_rate_radps, noise.yaw_rate_radps)
    frame = pd.DataFrame({"time_s": run.time_s})
    if logging.wheels:
        frame["wheel_left_mps"] = speed - 0.5 * robot.track_m * yaw
        frame["wheel_right_mps"] = speed + 0.5 * robot.track_m * yaw
    else:
        frame["speed_mps"] = speed
        frame["yaw_rate_radps"] = yaw
    if logging.grade and logging.elevation:
        frame["elevation_m"] = noisy(run.elevation_m, noise.elevation_m)
    elif logging.grade:
        frame["grade_rad"] = noisy(run.grade_rad, noise.grade_rad)
    if logging.distance:
        frame["distance_m"] = np.maximum.accumulate(run.distance_m)
    frame["heading_rad"] = np.mod(noisy(run.heading_rad, noise.heading_rad), 2.0 * np.pi)
    frame["sensing_hz"] = run.sensing_hz
    frame["temperature_c"] = noisy(run.temperature_c, noise.temperature_c)
    # indoors by lidar instead of satellites
    position_m = min(noise.position_m, 0.01 * work.vehicle.leg_m)
    frame["base_distance_m"] = np.maximum(noisy(run.base_distance_m, position_m), 0.0)
    power_w = read_power(work) + noise.power_share * typical_power_w(work.vehicle) * rng.normal(
        size=n
    )
    if work.read_by == "terminals":
        voltage_v = noisy(work.voltage_v, noise.voltage_share * robot.nominal_voltage_v)
        frame["voltage_v"] = voltage_v
        frame["current_a"] = power_w / work.voltage_v
    else:
        frame["power_w"] = power_w
    if logging.charge:
        frame["soc"] = np.clip(noisy(work.soc, noise.charge_share), 0.0, 1.0)
    return frame


def read_power(work: Work) -> Array:
    """Reading of the power meter before noise, W: the true power with the case's instrument
    effects."""
    seen_w = work.seen_w
    if work.read_smooth_s > 0.0:
        seen_w = first_order(seen_w, work.run.dt_s, work.read_smooth_s, float(seen_w[0]))
    late_w = np.interp(work.run.time_s - work.read_lag_s, work.run.time_s, seen_w)
    return np.asarray(late_w * work.read_gain + work.read_offset_w, dtype=np.float64)


# A common fault of instruments. Arguments: clean recording of a drive, the drive, severity in all
# drives of the case (0 to 1), and random numbers.
Fault = Callable[[pd.DataFrame, Work, float, Generator], pd.DataFrame]


def _elevation(frame: pd.DataFrame, elevation_m: Array) -> pd.DataFrame:
    return frame.drop(columns=["grade_rad", "elevation_m"], errors="ignore").assign(
        elevation_m=elevation_m
    )


def noisy_elevation(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """Elevation with 0.5 m of noise a sample instead of the grade (a barometer)."""
    return _elevation(frame, work.run.elevation_m + 0.5 * rng.normal(size=len(frame)))


def stepped_elevation(
    frame: pd.DataFrame, work: Work, level: float, rng: Generator
) -> pd.DataFrame:
    """Elevation in whole metres instead of the grade (GPS receivers)."""
    return _elevation(frame, np.round(work.run.elevation_m + rng.uniform(0.0, 1.0)))


def late_elevation(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """Elevation with a delay of 10 s instead of the grade (a filtered barometer)."""
    late_m = np.interp(work.run.time_s - 10.0, work.run.time_s, work.run.elevation_m)
    return _elevation(frame, late_m + 0.05 * rng.normal(size=len(frame)))


def noisy_grade(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """Grade with 0.7 degrees of noise a sample (a MEMS IMU on a shaking body)."""
    noisy_rad = work.run.grade_rad + np.radians(0.7) * rng.normal(size=len(frame))
    return frame.drop(columns="elevation_m", errors="ignore").assign(grade_rad=noisy_rad)


def pitched_imu(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """A constant pitch error of the IMU of 0.5 to 2 degrees, the same in all drives, due to its
    mounting."""
    pitch_rad = np.radians(0.5 + 1.5 * level)
    return frame.drop(columns="elevation_m", errors="ignore").assign(
        grade_rad=work.run.grade_rad + pitch_rad
    )


def no_grade(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """Hills without a channel that measures them."""
    return frame.drop(columns=["grade_rad", "elevation_m"], errors="ignore")


def noisy_speed(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """Speed with noise of 4 % of the top speed, also while standing (Doppler of a GNSS
    receiver)."""
    noisy_mps = work.run.speed_mps + 0.04 * work.vehicle.robot.max_speed_mps * rng.normal(
        size=len(frame)
    )
    wheels = [name for name in ("wheel_left_mps", "wheel_right_mps") if name in frame]
    if wheels:
        half = noisy_mps - frame[wheels].mean(axis=1)
        return frame.assign(**{name: frame[name] + half for name in wheels})
    return frame.assign(speed_mps=np.maximum(noisy_mps, 0.0))


def held_values(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """Every channel but the time refreshed only once in 0.5 to 2 s, each at its own times."""
    out = frame.copy()
    for name in out.columns.drop("time_s"):
        step = max(1, round(rng.uniform(0.5, 2.0) / work.run.dt_s))
        out[name] = frame[name].to_numpy()[np.arange(len(frame)) // step * step]
    return out


def drifting_clock(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """The power meter's clock drifts by 0.2 to 2 s over a run."""
    time = work.run.time_s
    at_s = time - rng.choice([-1.0, 1.0]) * (0.2 + 1.8 * level) * time / time[-1]
    power = [name for name in ("power_w", "voltage_v", "current_a") if name in frame]
    return frame.assign(**{name: np.interp(at_s, time, frame[name]) for name in power})


def charging(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """The log continues while the vehicle stands at its charger: constant current, then falling."""
    n = round(rng.uniform(60.0, 150.0) / work.run.dt_s)
    tail = pd.concat([frame.tail(1)] * n, ignore_index=True)
    since_s = np.arange(1, n + 1) * work.run.dt_s
    tail["time_s"] = frame["time_s"].iloc[-1] + since_s
    charge_w = (
        -0.8 * typical_power_w(work.vehicle) * np.minimum(1.0, np.exp(-(since_s - 40.0) / 60.0))
    )
    charge_w *= 1.0 + 0.01 * rng.normal(size=n)
    if "power_w" in frame:
        tail["power_w"] = charge_w
    else:
        tail["voltage_v"] = frame["voltage_v"].iloc[-1] * 1.02
        tail["current_a"] = charge_w / tail["voltage_v"]
    if "soc" in frame:
        gained = -np.cumsum(charge_w) * work.run.dt_s / work.vehicle.robot.rated_energy_j
        tail["soc"] = np.minimum(tail["soc"] + gained, 1.0)
    return pd.concat([frame, tail], ignore_index=True)


def wrong_sign(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """Power or current negative while discharging (as in ROS BatteryState)."""
    name = "power_w" if "power_w" in frame else "current_a"
    return frame.assign(**{name: -frame[name]})


def spikes(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """Single samples of power many times too large: disturbed bus messages."""
    name = "power_w" if "power_w" in frame else "current_a"
    hit = rng.random(len(frame)) < 0.002
    return frame.assign(
        **{name: frame[name].mask(hit, frame[name].abs().max() * rng.uniform(3.0, 20.0))}
    )


def gaps(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """Missing stretches of 2 to 30 s."""
    keep = np.ones(len(frame), dtype=bool)
    for _ in range(int(rng.integers(1, 4))):
        start = int(rng.integers(0, len(frame)))
        keep[start : start + round(rng.uniform(2.0, 30.0) / work.run.dt_s)] = False
    return frame[keep].reset_index(drop=True)


def resets(frame: pd.DataFrame, work: Work, level: float, rng: Generator) -> pd.DataFrame:
    """Restarted sensors: the odometer from 0, the power meter at 0 W for a second or two."""
    out = frame.copy()
    power = [name for name in ("power_w", "current_a") if name in frame]
    at = int(rng.integers(len(frame) // 4, 3 * len(frame) // 4))
    if "distance_m" in out:
        distance = frame["distance_m"].to_numpy()
        out["distance_m"] = np.where(np.arange(len(frame)) < at, distance, distance - distance[at])
    silent = slice(at, at + round(rng.uniform(1.0, 2.0) / work.run.dt_s))
    out.loc[silent, power] = 0.0
    return out


FAULTS: dict[str, Fault] = {
    fault.__name__: fault
    for fault in (
        noisy_elevation, stepped_elevation, late_elevation, noisy_grade, pitched_imu, no_grade, noisy_speed,
        held_values, drifting_clock, charging, wrong_sign, spikes, gaps, resets,
    )
}  # fmt: skip
"""Every common fault, with the function that applies it to a clean recording."""

NEEDS_ROOM = ("noisy_elevation", "stepped_elevation", "late_elevation")
"""Faults for vehicles with hills that are metres high."""
