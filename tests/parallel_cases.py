"""Tasks, training settings and recordings for tests of what runs in several processes or on a
cluster."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward import load_robot
from homeward.agents.learning.settings import PPOSettings

TASKS = {f"seed {seed}": seed for seed in range(6)}
SETTINGS = PPOSettings(start="scratch", n_envs=8, n_steps=8, batch_size=32, epochs=1, hidden=8)
STEPS = 10 * SETTINGS.rollout
"""The first updates teach the value alone."""


def draws(seed: int) -> NDArray[np.float64]:
    """Numbers of a seed."""
    return np.random.default_rng(seed).normal(size=4)


def draws_slowly(seed: int, folder: Path, wait_s: float) -> NDArray[np.float64]:
    """The same, leaving a file in the name of the process and its parent at the beginning and one
    at the end."""
    for when in ("begun", "ended"):
        (folder / f"{when}-{seed}-{os.getpid()}-{os.getppid()}").touch()
        time.sleep(wait_s if when == "begun" else 0.0)
    return draws(seed)


def fails(seed: int) -> int:
    """Fail with an exception that cannot be pickled, at one seed."""
    if seed == 3:

        class LocalError(ValueError):
            def __init__(self, one: int, two: int) -> None:
                super().__init__(f"{one} and\n{two}")

        raise LocalError(1, 2)
    return seed


def assert_equal(one: dict[str, Any], other: dict[str, Any]) -> None:
    """The same names in the same order, with the same arrays."""
    assert list(one) == list(other)
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


def write_recording(path: Path, payload: float, seed: int = 0) -> None:
    """Two minutes of a robot that draws power by the formula of a heavier one, at 2 Hz."""
    rng = np.random.default_rng(seed)
    robot = load_robot("rusti")
    speed_mps = np.repeat(rng.uniform(0.2, 1.0, 24), 10)
    force_n = robot.rolling_resistance * (robot.mass_kg + payload) * 9.81
    power_w = 0.6 + force_n * speed_mps / ((1.0 - robot.motor_loss) * (1.0 - robot.friction_loss))
    power_w += rng.normal(0.0, 0.05, len(power_w))
    rows = np.column_stack(
        (0.5 * np.arange(len(power_w)), speed_mps, np.zeros(len(power_w)), power_w)
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, rows, delimiter=",", header="time_s,speed_mps,grade_rad,power_w", comments="")


def policies(folder: Path) -> dict[str, bytes]:
    """Contents of all trained policies by their paths in a folder."""
    files = sorted(folder.rglob("seed_*/policy.safetensors"))
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}
