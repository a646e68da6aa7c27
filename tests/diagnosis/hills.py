"""Drives over hills, out and back from base, measured well, for the tests to spoil."""

import dataclasses
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from homeward import Robot, load_robot
from homeward.diagnosis import Recording
from homeward.physics import replay

Array = NDArray[np.float64]
Channels = dict[str, Array]
Spoil = Callable[[Channels, np.random.Generator], Channels]

STEP_S = 0.1
SAMPLES = 2500
ROBOTS = ("husky", "jackal")


def levels(
    rng: np.random.Generator, choices: tuple[float, ...], shortest_s: float, longest_s: float
) -> Array:
    values, start = np.empty(SAMPLES), 0
    while start < SAMPLES:
        length = int(rng.uniform(shortest_s, longest_s) / STEP_S)
        values[start : start + length] = rng.choice(choices)
        start += length
    return values


def drive(robot: Robot, seed: int) -> Channels:
    """Out and back over hills with stops and turns, measured well; power follows by the kernel."""
    rng = np.random.default_rng(seed)
    time_s: Array = STEP_S * np.arange(SAMPLES, dtype=np.float64)
    top = robot.max_speed_mps
    speed = (
        uniform_filter1d(levels(rng, (0.0, 0.3, 0.5, 0.7, 0.9), 4.0, 12.0), 15, mode="nearest")
        * top
    )
    speed[speed < 0.02 * top] = 0.0
    path_m = np.concatenate(([0.0], np.cumsum(speed[:-1] * STEP_S)))
    place_m = path_m[-1] / 2.0 - np.abs(path_m - path_m[-1] / 2.0)
    waves_m, phases = np.array([35.0, 60.0, 90.0]) * top, rng.uniform(0.0, 2.0 * np.pi, 3)
    angle = 2.0 * np.pi * place_m[:, None] / waves_m + phases
    grade = np.arctan(0.035 * np.cos(angle).sum(axis=1)) * np.where(
        path_m > path_m[-1] / 2.0, -1.0, 1.0
    )
    yaw_rate = levels(rng, (0.0, 0.0, 0.3, -0.3, 0.6), 3.0, 9.0) * (speed > 0.0)
    power_w = replay(robot, time_s, speed, grade_rad=grade, yaw_rate_radps=yaw_rate).power_w
    return {
        "time_s": time_s,
        "speed_mps": speed + 0.003 * top * rng.normal(size=SAMPLES) * (speed > 0.0),
        "yaw_rate_radps": yaw_rate,
        "grade_rad": grade + 0.002 * rng.normal(size=SAMPLES),
        "elevation_m": (0.035 * np.sin(angle) * waves_m / (2.0 * np.pi)).sum(axis=1)
        + 0.02 * rng.normal(size=SAMPLES),
        "base_distance_m": place_m,
        "power_w": power_w + 0.02 * power_w.mean() * rng.normal(size=SAMPLES),
    }


@cache
def drives(name: str, effect: str = "", size: float = 0.0) -> tuple[Channels, ...]:
    robot = load_robot(name)
    effects = {effect: {"scrub" if effect == "turning" else "mass_factor": size}} if effect else {}
    return tuple(
        drive(dataclasses.replace(robot, effects=effects), 100 + index) for index in range(3)
    )


def only(channels: Channels, *names: str) -> Channels:
    """Time, speed and power, and these."""
    return {
        name: channels[name]
        for name in ("time_s", "speed_mps", "yaw_rate_radps", "power_w", *names)
    }


def noisy(channels: Channels, name: str, size: float, rng: np.random.Generator) -> Channels:
    return {**channels, name: channels[name] + size * rng.normal(size=len(channels[name]))}


def held(channels: Channels, name: str, every: int) -> Channels:
    return {**channels, name: channels[name][np.arange(SAMPLES) // every * every]}


def late(channels: Channels, name: str, lag_s: float | Array) -> Channels:
    return {
        **channels,
        name: np.interp(channels["time_s"] - lag_s, channels["time_s"], channels[name]),
    }


def recordings(name: str, spoil: Spoil, effect: str = "", size: float = 0.0) -> list[Recording]:
    return [
        Recording(
            f"run{index}.csv", str(index), spoil(channels, np.random.default_rng([100, index]))
        )
        for index, channels in enumerate(drives(name, effect, size))
    ]
