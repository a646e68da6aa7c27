"""What a standing robot draws: which logs count, how files without names or times are read, and
intervals."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from homeward.datasets import DATASETS, fetch
from homeward.diagnosis import Recording, RecordingError, read_recording
from homeward.groups.standing import mean_interval, standing_run, stands
from tests.groups.recorded import noise, standing

Array = NDArray[np.float64]


def test_only_recorded_zero_motion_is_standing() -> None:
    power_w = 10.0 + noise(np.random.default_rng(0), 100, 0.0)
    assert stands(standing(power_w))
    unknown = dict(standing(power_w).channels) | {"speed_mps": np.full(100, np.nan)}
    assert not stands(Recording("run.csv", "", unknown))
    assert not stands(Recording("run.csv", "", {"time_s": np.arange(100.0), "power_w": power_w}))
    encoder_step = np.where(np.arange(100) < 99, 0.0, 0.0118)
    assert stands(
        Recording("run.csv", "", dict(standing(power_w).channels) | {"speed_mps": encoder_step})
    )
    creeping = np.where(np.arange(100) < 99, 0.0, 0.05)
    assert not stands(
        Recording("run.csv", "", dict(standing(power_w).channels) | {"speed_mps": creeping})
    )
    wheels = {"wheel_left_mps": np.full(100, -0.2), "wheel_right_mps": np.full(100, 0.2)}
    turning = {
        name: values for name, values in standing(power_w).channels.items() if name != "speed_mps"
    } | wheels
    assert not stands(Recording("run.csv", "", turning))
    assert not stands(standing(power_w, yaw_rate_radps=np.full(100, 0.3)))


def test_a_missing_speed_is_refused_unless_said_to_stand(
    table: pd.DataFrame, csv: Callable[[pd.DataFrame], Path]
) -> None:
    path = csv(table.drop(columns="speed_mps"))
    with pytest.raises(
        RecordingError, match=r"no motion channel .*; say --standing if the robot stood"
    ):
        read_recording(path)
    assert stands(read_recording(path, standing=True))
    assert not stands(read_recording(csv(table), standing=True))  # a recorded speed is believed


@pytest.mark.parametrize(("phi", "count"), [(0.0, 300), (0.8, 300), (0.95, 300), (0.9, 60)])
def test_the_interval_of_one_run_covers_under_autocorrelation(phi: float, count: int) -> None:
    rng = np.random.default_rng(1)
    runs = [standing_run(standing(10.0 + noise(rng, count, phi))) for _ in range(300)]
    covered = np.mean([run.ci95[0] <= 10.0 <= run.ci95[1] for run in runs])
    assert 0.90 <= covered <= 0.985


def test_the_interval_of_several_runs_counts_their_spread() -> None:
    rng = np.random.default_rng(2)
    covered = 0
    for _ in range(300):
        means = [
            standing_run(standing(level + noise(rng, 200, 0.9))).mean
            for level in rng.normal(10.0, 1.0, 3)
        ]
        low, high = mean_interval(means)
        covered += low <= 10.0 <= high
    assert 0.92 <= covered / 300 <= 0.98


def test_a_drift_widens_the_interval_and_is_told() -> None:
    rng = np.random.default_rng(3)
    steady, drifting = (
        standing_run(standing(10.0 + noise(rng, 300, 0.5) + slope * np.linspace(0.0, 1.0, 300)))
        for slope in (0.0, 8.0)
    )
    assert drifting.ci95[1] - drifting.ci95[0] > 5.0 * (steady.ci95[1] - steady.ci95[0])
    assert drifting.change == pytest.approx(8.0 * 2.0 / 3.0, abs=0.5) and abs(steady.change) < 0.5


def test_unusable_standing_runs() -> None:
    for power_w, step_s in (
        (np.full(100, 7.0), 0.5),
        (7.0 + np.arange(10.0), 0.5),
        (7.0 + np.arange(30.0), 0.05),
    ):
        with pytest.raises(RecordingError):
            standing_run(standing(power_w, step_s=step_s))


def test_power_meters_of_the_data_sets(data_folder: Path) -> None:
    baseline = read_recording(fetch("turtlebot3_tactics", "baseline")[0], "turtlebot3_tactics")
    assert stands(baseline) and standing_run(baseline).mean == pytest.approx(9.78, abs=0.01)
    path = fetch("ase_rover", "before_intervention")[0]
    with pytest.raises(RecordingError, match="--standing"):
        read_recording(path, DATASETS["ase_rover"].columns)
    assert standing_run(read_recording(path, "ase_rover", standing=True)).mean == pytest.approx(
        6.59, abs=0.01
    )
