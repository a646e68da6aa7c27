"""Recordings are read whole or refused in one line that says what is wrong, where, and what to
do."""

import gzip
import io
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from homeward.diagnosis import RecordingError, load_columns, read_recording
from tests.logs.refused import Write, refusal

finite = st.floats(-60.0, 60.0, allow_subnormal=False)


@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    speed=st.lists(finite, min_size=2, max_size=30),
    kind=st.sampled_from([".csv", ".csv.gz", ".parquet"]),
    step=st.floats(0.01, 5.0),
)
def test_every_format_gives_back_what_was_written(
    tmp_path: Path, speed: list[float], kind: str, step: float
) -> None:
    table = pd.DataFrame(
        {"time_s": np.arange(len(speed)) * step, "speed_mps": speed, "power_w": np.abs(speed)}
    )
    path = tmp_path / f"run{kind}"
    table.to_parquet(path) if kind == ".parquet" else table.to_csv(path, index=False)
    channels = read_recording(path).channels
    for name in table:
        np.testing.assert_allclose(channels[str(name)], table[name], rtol=1e-12)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(junk=st.binary(max_size=300), kind=st.sampled_from([".csv", ".csv.gz", ".parquet"]))
def test_junk_never_raises_anything_else(tmp_path: Path, junk: bytes, kind: str) -> None:
    path = tmp_path / f"junk{kind}"
    path.write_bytes(junk)
    assert refusal(path).startswith(str(path))


def test_missing_values_and_columns_in_any_order_are_read(table: pd.DataFrame, csv: Write) -> None:
    table.loc[5, "power_w"] = np.nan
    recording = read_recording(csv(table[table.columns[::-1]].assign(note=1.0)))
    assert np.isnan(recording.channels["power_w"][5]) and len(recording) == 600
    assert "note" not in recording.channels


def test_no_file_folder_and_unknown_kind(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "none.csv")
    assert "is a folder" in refusal(tmp_path)
    (tmp_path / "run.doc").write_text("x")
    assert ".parquet" in refusal(tmp_path / "run.doc")


def test_empty_and_header_only(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("")
    assert "is empty" in refusal(path)
    path.write_text("time_s,speed_mps,power_w\n")
    assert "0 samples" in refusal(path)


@pytest.mark.parametrize("kind", ["csv.gz", "parquet"])
@pytest.mark.parametrize("share", [0.1, 0.6, 0.98])
def test_cut_files(table: pd.DataFrame, tmp_path: Path, kind: str, share: float) -> None:
    path = tmp_path / f"run.{kind}"
    table.to_parquet(path) if kind == "parquet" else table.to_csv(path, index=False)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    assert "is not a whole" in refusal(path)


def test_time_must_increase(table: pd.DataFrame, csv: Write) -> None:
    table.loc[100, "time_s"] = 3.0
    assert "time_s goes back in row 101" in refusal(csv(table))
    table.loc[100, "time_s"] = 9.9
    assert "time_s repeats in row 101" in refusal(csv(table))
    table.loc[100, "time_s"] = np.nan
    assert "time_s in row 101 is missing" in refusal(csv(table))


@pytest.mark.parametrize(
    ("factor", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")]
)
def test_time_in_another_unit(table: pd.DataFrame, csv: Write, factor: float, unit: str) -> None:
    table["time_s"] *= factor
    assert f"looks like {unit}" in refusal(csv(table))


def test_pipes_and_devices_are_not_read(tmp_path: Path) -> None:
    for name in ("run.csv", "run.parquet", "run.bag", "run.mcap"):
        os.mkfifo(tmp_path / name)
        assert "is a pipe or device" in refusal(tmp_path / name)
    assert "run.mcap is a pipe or device" in refusal(tmp_path)  # of a folder, the file is named
    (tmp_path / "null.csv").symlink_to("/dev/zero")
    assert "is a pipe or device" in refusal(tmp_path / "null.csv")
    os.mkfifo(tmp_path / "map.toml")
    with pytest.raises(RecordingError, match="neither a file"):
        load_columns(tmp_path / "map.toml")


def test_standard_input(table: pd.DataFrame, monkeypatch: pytest.MonkeyPatch) -> None:
    for content in (table.to_csv(index=False).encode(), gzip.compress(table.to_csv(index=False).encode()),
                    table.to_parquet()):  # fmt: skip
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(content)))
        recording = read_recording("-")
        assert (recording.name, len(recording)) == ("standard input", 600)
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"a,b\n1,2\n")))
    assert refusal(Path("-")).startswith("standard input: has no column time_s")


def test_a_parquet_file_of_too_many_rows(
    tmp_path: Path, table: pd.DataFrame, monkeypatch: pytest.MonkeyPatch
) -> None:
    table.to_parquet(tmp_path / "run.parquet")
    monkeypatch.setattr("homeward.logs.limits.MOST_ROWS", 100)
    assert "more than 100 rows" in refusal(tmp_path / "run.parquet")
    monkeypatch.setattr("homeward.logs.limits.MOST_ROWS", 1000)
    monkeypatch.setattr("homeward.logs.limits.MOST_BYTES", 1000)
    assert "or 1000 rows, unpacked" in refusal(tmp_path / "run.parquet")


def test_speed_in_km_per_hour_shows_against_distance(table: pd.DataFrame, csv: Write) -> None:
    table["distance_m"] = np.cumsum(table.speed_mps) / 10.0
    assert len(read_recording(csv(table))) == 600
    table["speed_mps"] *= 3.6
    assert "looks like km/h" in refusal(csv(table))


def test_current_in_milliamperes_shows_against_power(table: pd.DataFrame, csv: Write) -> None:
    table["voltage_v"] = 24.0
    table["current_a"] = 1000.0 * table.power_w / 24.0 * (table.power_w < 36.0) + 900.0
    table["power_w"] = table.voltage_v * table.current_a / 1000.0
    assert "milliamperes" in refusal(csv(table))


def test_text_and_infinity_in_a_cell(table: pd.DataFrame, csv: Write) -> None:
    assert "power_w in row 4 is 'n/k', not a number" in refusal(
        csv(
            table.astype({"power_w": object}).assign(
                power_w=lambda t: t.power_w.where(t.index != 3, "n/k")
            )
        )
    )
    table.loc[3, "power_w"] = np.inf
    assert "power_w in row 4 is infinite" in refusal(csv(table))


@pytest.mark.parametrize(
    ("dropped", "said"),
    [
        ("time_s", "no column time_s"),
        ("speed_mps", "no motion channel (speed_mps or wheel_left_mps + wheel_right_mps)"),
        ("power_w", "no power channel"),
    ],
)
def test_missing_columns(table: pd.DataFrame, csv: Write, dropped: str, said: str) -> None:
    message = refusal(csv(table.drop(columns=dropped)))
    assert said in message and "--columns" in message and "it has" in message


def test_same_column_twice(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("time_s,speed_mps,power_w,power_w\n0,0,1,1\n1,0,1,1\n")
    assert "two columns power_w" in refusal(path)


@pytest.mark.parametrize("apart_s", [0.03, 0.0])
def test_a_table_with_a_row_for_each_topic_is_aligned_as_bags_are(
    table: pd.DataFrame, csv: Write, apart_s: float
) -> None:
    """PlotJuggler writes one row for each message; Foxglove has several of one time."""
    motion = table[["time_s", "speed_mps"]]
    power = table[["time_s", "power_w"]][::2].assign(time_s=lambda of: of.time_s + apart_s)
    sparse = pd.concat([motion, power]).sort_values("time_s", kind="stable")
    read = read_recording(csv(sparse))
    assert len(read) == pytest.approx(300, abs=1)
    assert read.notes == (
        "power and motion stand in different rows: faster columns are averaged at the times of the slower",
    )
    now = read.channels["time_s"]
    np.testing.assert_allclose(
        read.channels["speed_mps"], np.interp(now, table.time_s, table.speed_mps), atol=1e-3
    )
    np.testing.assert_allclose(
        read.channels["power_w"], np.interp(now, power.time_s, power.power_w)
    )
