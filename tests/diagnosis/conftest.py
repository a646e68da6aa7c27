"""Recordings for the tests: a plain one to spoil, and drives of a known robot through the project's own kernel."""

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from homeward import Robot, load_robot
from homeward.diagnosis import Analysis, Recording, analyse
from homeward.synthetic import STEP_S, record

Drive = Callable[..., list[Recording]]


@pytest.fixture
def table() -> pd.DataFrame:
    """A valid recording of 600 samples at 10 Hz."""
    rng = np.random.default_rng(0)
    time_s = np.arange(600) / 10.0
    speed = 0.5 + 0.4 * np.sin(time_s / 5.0)
    return pd.DataFrame({
        "time_s": time_s,
        "speed_mps": speed,
        "grade_rad": 0.05 * np.sin(time_s / 11.0),
        "power_w": 80.0 + 100.0 * speed + rng.normal(size=600),
    })  # fmt: skip


@pytest.fixture
def csv(tmp_path: Path) -> Callable[[pd.DataFrame], Path]:
    """Write a table as a CSV file."""

    def write(table: pd.DataFrame) -> Path:
        path = tmp_path / "run.csv"
        table.to_csv(path, index=False)
        return path

    return write


@pytest.fixture(scope="session")
def husky() -> Robot:
    return load_robot("husky")


@pytest.fixture(scope="session")
def drive() -> Drive:
    """Noisy recordings of a robot that may differ from what the diagnosis is told, the first minutes of each drive."""

    def recordings(robot: Robot, runs: int = 3, minutes: float = 8.0, **changes: object) -> list[Recording]:
        robot = dataclasses.replace(robot, **changes)  # type: ignore[arg-type]
        tables = [record(robot, seed).iloc[: round(60.0 * minutes / STEP_S)] for seed in range(runs)]
        return [
            Recording(f"run{i}.csv", str(i), {str(name): table[name].to_numpy(dtype=float) for name in table})
            for i, table in enumerate(tables)
        ]

    return recordings


@pytest.fixture(scope="session")
def short_drive(drive: Drive) -> Drive:
    """As `drive`, four runs of two minutes, which are too short for the clock of power to be searched for a drift."""
    return functools.partial(drive, runs=4, minutes=2.0)


@pytest.fixture(scope="session")
def scrubbing(short_drive: Drive, husky: Robot) -> Analysis:
    """What is said of a robot whose turning its file does not know, for all tests that ask something of it."""
    return analyse(short_drive(husky, effects={"turning": {"scrub": 0.3}}), husky)


@pytest.fixture(scope="session")
def faultless(short_drive: Drive, husky: Robot) -> Analysis:
    """What is said of a robot that is as its file says."""
    return analyse(short_drive(husky), husky)
