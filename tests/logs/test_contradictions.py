"""What two channels measure twice is compared, each from its own samples."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from homeward.logs import RecordingError, read_recording
from homeward.logs.contradictions import measured_twice

T = np.arange(600) / 5.0
SPEED, VOLTAGE, CURRENT = (
    0.5 + 0.4 * np.sin(T / 8.0),
    25.0 + np.sin(T / 18.0),
    4.0 + np.sin(T / 8.0),
)
BASE = {"time_s": T, "speed_mps": SPEED, "voltage_v": VOLTAGE, "current_a": CURRENT}


def test_samples_in_rows_of_their_own_are_compared_as_well() -> None:
    odd = np.arange(600) % 2 == 1
    channels = {
        **BASE,
        "speed_mps": np.where(odd, SPEED, np.nan),
        "voltage_v": np.where(odd, VOLTAGE, np.nan),
    }
    channels |= {
        "distance_m": np.where(odd, np.nan, np.cumsum(SPEED) / 5.0),
        "power_w": VOLTAGE * CURRENT,
    }
    ratios = {pair.what: pair.ratio for pair in measured_twice(channels)}
    assert ratios["speed_mps"] == pytest.approx(1.0, abs=0.02) and ratios[
        "power_w"
    ] == pytest.approx(1.0, abs=0.02)


def test_the_reader_says_which_of_two_powers_it_uses(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    pd.DataFrame({**BASE, "power_w": 3.0 * VOLTAGE * CURRENT}).to_csv(path, index=False)
    assert any(
        "3 times voltage_v x current_a: power_w is used" in note
        for note in read_recording(path).notes
    )


def test_a_heading_in_degrees_is_known_by_the_turning_rate(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    pd.DataFrame({**BASE, "heading_rad": np.degrees(0.1 * T), "yaw_rate_radps": 0.1}).to_csv(
        path, index=False
    )
    with pytest.raises(RecordingError, match=r"heading_rad is 57\.3 times that of yaw_rate_radps"):
        read_recording(path)
