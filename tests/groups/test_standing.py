"""What a standing robot draws: which logs count, how files without names or times are read, and intervals."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from homeward.datasets import DATASETS, fetch
from homeward.diagnosis import Recording, RecordingError, load_columns, read_recording
from homeward.groups.standing import mean_interval, standing_run, stands

Array = NDArray[np.float64]

METER = """
header = ["index", "volt", "milliamp"]
sample_hz = 10.0
[columns]
voltage_v = "volt"
current_a = { column = "milliamp", factor = 1e-3 }
"""


def noise(rng: np.random.Generator, count: int, phi: float) -> Array:
    """Autoregressive noise of standard deviation 1."""
    drawn: Array = lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], rng.standard_normal(count + 1000))[1000:]
    return drawn


def standing(power_w: Array, name: str = "run.csv", step_s: float = 0.5, **channels: Array) -> Recording:
    """A recording of a robot that stands."""
    time_s = step_s * np.arange(len(power_w), dtype=np.float64)
    return Recording(
        name, name, {"time_s": time_s, "speed_mps": np.zeros(len(power_w)), "power_w": power_w, **channels}
    )


def test_only_recorded_zero_motion_is_standing() -> None:
    power_w = 10.0 + noise(np.random.default_rng(0), 100, 0.0)
    assert stands(standing(power_w))
    unknown = dict(standing(power_w).channels) | {"speed_mps": np.full(100, np.nan)}
    assert not stands(Recording("run.csv", "", unknown))
    assert not stands(Recording("run.csv", "", {"time_s": np.arange(100.0), "power_w": power_w}))
    encoder_step = np.where(np.arange(100) < 99, 0.0, 0.0118)
    assert stands(Recording("run.csv", "", dict(standing(power_w).channels) | {"speed_mps": encoder_step}))
    creeping = np.where(np.arange(100) < 99, 0.0, 0.05)
    assert not stands(Recording("run.csv", "", dict(standing(power_w).channels) | {"speed_mps": creeping}))
    wheels = {"wheel_left_mps": np.full(100, -0.2), "wheel_right_mps": np.full(100, 0.2)}
    turning = {name: values for name, values in standing(power_w).channels.items() if name != "speed_mps"} | wheels
    assert not stands(Recording("run.csv", "", turning))
    assert not stands(standing(power_w, yaw_rate_radps=np.full(100, 0.3)))


def test_a_missing_speed_is_refused_unless_said_to_stand(
    table: pd.DataFrame, csv: Callable[[pd.DataFrame], Path]
) -> None:
    path = csv(table.drop(columns="speed_mps"))
    with pytest.raises(RecordingError, match=r"no motion channel .*; say --standing if the robot stood"):
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
        means = [standing_run(standing(level + noise(rng, 200, 0.9))).mean for level in rng.normal(10.0, 1.0, 3)]
        low, high = mean_interval(means)
        covered += low <= 10.0 <= high
    assert 0.92 <= covered / 300 <= 0.98


def test_a_drift_widens_the_interval_and_is_told() -> None:
    rng = np.random.default_rng(3)
    steady, drifting = (
        standing_run(standing(10.0 + noise(rng, 300, 0.5) + slope * np.linspace(0.0, 1.0, 300))) for slope in (0.0, 8.0)
    )
    assert drifting.ci95[1] - drifting.ci95[0] > 5.0 * (steady.ci95[1] - steady.ci95[0])
    assert drifting.change == pytest.approx(8.0 * 2.0 / 3.0, abs=0.5) and abs(steady.change) < 0.5


def test_unusable_standing_runs() -> None:
    for power_w, step_s in ((np.full(100, 7.0), 0.5), (7.0 + np.arange(10.0), 0.5), (7.0 + np.arange(30.0), 0.05)):
        with pytest.raises(RecordingError):
            standing_run(standing(power_w, step_s=step_s))


def test_files_without_names_or_times(tmp_path: Path) -> None:
    (tmp_path / "meter.toml").write_text(METER)
    lines = [f"{i},12.0,{500 + i % 3}" for i in range(200)]
    lines[20], lines[50], lines[51] = "20,12.0", "50,12.0,abc", "51,12.0,500,7,8"
    run = tmp_path / "DATA.TXT"
    run.write_text("\n".join(lines))
    recording = read_recording(run, tmp_path / "meter.toml", standing=True)
    assert len(recording) == 197 and recording.notes == ("3 broken lines are left out",)
    assert recording.channels["time_s"][[0, 20, -1]] == pytest.approx([0.0, 2.1, 19.9])  # a lost line keeps its time
    assert recording.channels["current_a"][0] == pytest.approx(0.5)
    run.write_text("\n".join(lines[:60] + ["rubbish"] * 60))
    with pytest.raises(RecordingError, match="63 of 120 lines do not hold the 3 numbers"):
        read_recording(run, tmp_path / "meter.toml", standing=True)
    run.write_bytes(bytes(range(256)) * 20)
    with pytest.raises(RecordingError, match="lines do not hold"):
        read_recording(run, tmp_path / "meter.toml", standing=True)


def clock(tmp_path: Path, stamps: list[str]) -> Recording:
    (tmp_path / "clock.toml").write_text(
        '[columns]\ntime_s = { column = "stamp", whole_seconds = true }\npower_w = "power"\n'
    )
    (tmp_path / "run.csv").write_text("stamp,power\n" + "".join(f"{s},{7 + i % 2}\n" for i, s in enumerate(stamps)))
    return read_recording(tmp_path / "run.csv", tmp_path / "clock.toml", standing=True)


def test_whole_seconds_are_spread(tmp_path: Path) -> None:
    seconds = ["23:59:58"] * 3 + ["23:59:59"] * 10 + ["00:00:00"] * 10 + ["00:00:01"] * 4
    time_s = clock(tmp_path, seconds).channels["time_s"]
    np.testing.assert_allclose(np.diff(time_s), 0.1, rtol=1e-9)
    assert time_s[3] == 86399.0 and time_s[13] == 86400.0
    assert clock(tmp_path, [str(i // 5) for i in range(30)]).duration_s == pytest.approx(29 / 5)
    for stamps, said in (
        (["1"] * 20, "change less than twice"),
        (["3", "2", "1"], "go back"),
        (["a"] * 9, "is not a number"),
    ):
        with pytest.raises(RecordingError, match=f"run.csv: .*{said}"):
            clock(tmp_path, stamps)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[columns]\npower_w = "p"', "or with sample_hz instead of it"),
        ('sample_hz = 5\n[columns]\ntime_s = "t"\npower_w = "p"', "or with sample_hz instead of it"),
        ('sample_hz = "5"\n[columns]\npower_w = "p"', "is not a finite number"),
        ('sample_hz = -5\n[columns]\npower_w = "p"', "is not between"),
        ('sample_hz = 5\nheader = ["p", "p"]\n[columns]\npower_w = "p"', "not a list of different names"),
        ('[columns]\ntime_s = "t"\npower_w = { column = "p", whole_seconds = true }', "is for time_s only"),
        ('[columns]\ntime_s = { column = "t", whole_seconds = true, factor = 2.0 }', "is not understood"),
    ],
)
def test_wrong_mappings(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(RecordingError, match=said):
        load_columns(tmp_path / "map.toml")


def test_power_meters_of_the_data_sets(data_folder: Path) -> None:
    baseline = read_recording(fetch("turtlebot3_tactics", "baseline")[0], "turtlebot3_tactics")
    assert stands(baseline) and standing_run(baseline).mean == pytest.approx(9.78, abs=0.01)
    path = fetch("ase_rover", "before_intervention")[0]
    with pytest.raises(RecordingError, match="--standing"):
        read_recording(path, DATASETS["ase_rover"].columns)
    assert standing_run(read_recording(path, "ase_rover", standing=True)).mean == pytest.approx(6.59, abs=0.01)
