"""Several tables of one run, as one file a topic is written, are one recording: on one clock, and
said."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from homeward.logs import RecordingError, read_recording
from homeward.logs.channels import Array

START_S = 1.76e9


def motion(start_s: float = START_S) -> tuple[Array, Array]:
    t = start_s + np.arange(0.0, 60.0, 0.1)
    return t, 0.5 + 0.3 * np.sin(0.2 * (t - t[0]))


def battery(start_s: float = START_S) -> tuple[Array, Array]:
    t = start_s + np.arange(0.05, 60.0, 0.5)
    return t, 3.0 + np.sin(0.2 * (t - t[0]))


def two_tables(folder: Path, motion_start_s: float, battery_start_s: float) -> str:
    t, speed = motion(motion_start_s)
    pd.DataFrame({"time_s": t, "speed_mps": speed}).to_csv(folder / "odom.csv", index=False)
    t, current = battery(battery_start_s)
    pd.DataFrame({"time_s": t, "voltage_v": 24.0, "current_a": current}).to_csv(
        folder / "bat.csv", index=False
    )
    return f"{folder}/odom.csv+{folder}/bat.csv"


def test_two_tables_on_one_clock_are_one_run(tmp_path: Path) -> None:
    recording = read_recording(two_tables(tmp_path, START_S, START_S))
    assert recording.name == f"{tmp_path}/odom.csv+bat.csv" and len(recording) == 120
    assert (
        "tables of one run are joined: speed_mps from odom.csv; voltage_v, current_a from bat.csv"
        in recording.notes
    )
    assert (
        "times of odom.csv and bat.csv overlap by 59.5 s: assumed to be of one clock"
        in recording.notes
    )
    since_s = recording.channels["time_s"] - START_S
    assert np.allclose(
        recording.channels["speed_mps"], 0.5 + 0.3 * np.sin(0.2 * since_s), atol=2e-3
    )


def test_tables_of_different_clocks_are_taken_to_start_together_or_refused(tmp_path: Path) -> None:
    recording = read_recording(two_tables(tmp_path, 0.0, 5000.0))
    assert any(
        "bat.csv is another: it is taken to start together with odom.csv" in note
        for note in recording.notes
    )
    with pytest.raises(
        RecordingError, match=r"not recorded at the same time: 5000\.05 s lie between their starts"
    ):
        read_recording(two_tables(tmp_path, START_S, START_S + 5000.0))
    with pytest.raises(
        RecordingError, match=r"speed_mps is in odom\.csv and in odom\.csv; name one"
    ):
        read_recording(f"{tmp_path}/odom.csv+{tmp_path}/odom.csv")
    with pytest.raises(RecordingError, match=r"no\.csv: no such file"):
        read_recording(f"{tmp_path}/odom.csv+{tmp_path}/no.csv")
    with pytest.raises(RecordingError, match=r"give RUN\+OTHER"):
        read_recording(tmp_path / "odom.csv")
    with pytest.raises(RecordingError, match=r"c\+\+/run\.csv: no such file"):
        read_recording(tmp_path / "c++" / "run.csv")


def test_a_robot_that_stood_needs_no_motion_in_any_of_its_tables(tmp_path: Path) -> None:
    t = np.arange(0.0, 60.0, 0.5)
    pd.DataFrame({"time_s": t, "voltage_v": 24.0}).to_csv(tmp_path / "a.csv", index=False)
    pd.DataFrame({"time_s": t, "current_a": 1.0 + np.sin(t)}).to_csv(
        tmp_path / "b.csv", index=False
    )
    both = f"{tmp_path}/a.csv+{tmp_path}/b.csv"
    assert not read_recording(both, standing=True).channels["speed_mps"].any()
    with pytest.raises(RecordingError, match="has no motion channel"):
        read_recording(both)


def test_one_file_a_topic_of_rostopic_echo(tmp_path: Path) -> None:
    t, speed = motion()
    field = "field.twist.twist.linear.x"
    pd.DataFrame({"%time": np.int64(t * 1e9), field: speed}).to_csv(
        tmp_path / "odom.csv", index=False
    )
    t, current = battery()
    table = {"%time": np.int64(t * 1e9), "field.voltage": 24.0, "field.current": -current}
    pd.DataFrame(table).to_csv(tmp_path / "bat.csv", index=False)
    mapping = tmp_path / "echo.toml"
    mapping.write_text(
        f'[columns]\ntime_s = "%time"\nspeed_mps = "{field}"\nvoltage_v = "field.voltage"\n'
        'current_a = { column = "field.current", factor = -1.0 }\n'
    )
    recording = read_recording(f"{tmp_path}/odom.csv+{tmp_path}/bat.csv", mapping)
    assert len(recording) == 120 and recording.channels["current_a"].min() > 1.9


def test_one_file_a_topic_of_ros2_topic_echo(tmp_path: Path) -> None:
    seconds = [divmod(round(at_s * 1e9), 10**9) for at_s in motion()[0]]
    pose, covariance = "0.0,0.0,0.0,0.0,0.0,0.0,1.0", ",".join(["0.0"] * 36)
    odometry = [
        f"{sec},{nanosec},odom,base_link,{pose},{covariance},{speed},0.0,0.0,0.0,0.0,0.1,{covariance}"
        for (sec, nanosec), speed in zip(seconds, motion()[1], strict=True)
    ]
    (tmp_path / "odom.csv").write_text("\n".join(odometry))
    seconds = [divmod(round(at_s * 1e9), 10**9) for at_s in battery()[0]]
    states = [
        f"{sec},{nanosec},,24.0,nan,{-current},nan,nan,nan,0.8,2,0,0,True,4.1,4.1,,place,serial"
        for (sec, nanosec), current in zip(seconds, battery()[1], strict=True)
    ]
    (tmp_path / "bat.csv").write_text("\n".join(states))
    both = f"{tmp_path}/odom.csv+{tmp_path}/bat.csv"
    with pytest.raises(
        RecordingError,
        match=r"has no line of names .* are ros2_echo_odometry and ros2_echo_battery",
    ):
        read_recording(both)
    recording = read_recording(both, "ros2_echo_odometry+ros2_echo_battery")
    assert len(recording) == 120 and {*recording.channels} >= {
        "speed_mps",
        "yaw_rate_radps",
        "current_a",
    }
    with pytest.raises(RecordingError, match="2 tables are joined by 3 mappings"):
        read_recording(both, "a.toml+b.toml+c.toml")
