"""A plain recording for the tests, to spoil."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest


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
