"""Windows without a replay behind them, residuals, a drive over hills, and recordings with another
power."""

import dataclasses
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from homeward.diagnosis import Recording
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import WINDOW_S
from homeward.diagnosis.result import FileNumber, Value
from homeward.logs.channels import Array
from homeward.physics import Robot
from homeward.physics.log_replay import replay


def ends(number: Value | FileNumber) -> tuple[float, float]:
    """The ends of the interval of a number that the recordings limit."""
    assert number.ci95 is not None
    return number.ci95


def windows(count: int, runs: int = 1, observed: Array | float = 100.0, **context: Array) -> Runs:
    """Runs `0.csv`, `1.csv`, ... of so many windows each; channels and power have shape (runs *
    count,)."""
    signals: Any = [SimpleNamespace(name=f"{run}.csv") for run in range(runs)]
    time_s = np.tile((np.arange(count) + 0.5) * WINDOW_S, runs)
    power_w = np.broadcast_to(np.asarray(observed, np.float64), len(time_s))
    run = np.repeat(np.arange(runs), count)
    return Runs(signals, (), "W", run, time_s, np.full(len(time_s), WINDOW_S), power_w, context)


def autoregressive(phi: float, count: int, seed: int = 0) -> Array:
    """A residual that keeps this share of itself from window to window; its increments have a
    variance of 1."""
    return np.asarray(
        lfilter([1.0], [1.0, -phi], np.random.default_rng(seed).standard_normal(count))
    )


def with_power(
    runs: list[Recording], power_w: Callable[[Mapping[str, Array]], Array]
) -> list[Recording]:
    """The runs with another power, a function of their channels."""
    return [
        dataclasses.replace(run, channels={**run.channels, "power_w": power_w(run.channels)})
        for run in runs
    ]


def over_hills(robot: Robot, seed: int) -> Recording:
    """Ten minutes over hills at a speed that changes every 15 s, with 2 % of noise, at 1 Hz."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, 600.0, 1.0)
    speed_mps = np.repeat(rng.choice([0.0, 0.4, 0.6, 0.8, 1.0], 40), 15)
    way_m = np.cumsum(speed_mps)
    grade_rad = 0.04 * np.sin(way_m / 25.0) + 0.02 * np.cos(way_m / 8.0 + 1.0)
    channels = {"time_s": time_s, "speed_mps": speed_mps, "grade_rad": grade_rad}
    power_w = replay(robot, time_s, speed_mps, grade_rad=grade_rad).power_w
    channels["power_w"] = power_w * (1.0 + 0.02 * rng.normal(size=len(time_s)))
    return Recording(f"run{seed}.csv", str(seed), channels)
