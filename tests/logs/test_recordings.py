"""Recordings are read whole or refused in one line that says what is wrong, where, and what to do."""

import gzip
import io
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from homeward.diagnosis import RecordingError, load_columns, read_recording

Write = Callable[[pd.DataFrame], Path]


def refusal(path: Path, columns: str | Path | None = None) -> str:
    """The message with which a recording is refused: one line that starts with the file."""
    with pytest.raises(RecordingError) as error:
        read_recording(path, columns)
    message = str(error.value)
    assert "\n" not in message and len(message) < 500
    return message


finite = st.floats(-60.0, 60.0, allow_subnormal=False)


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    speed=st.lists(finite, min_size=2, max_size=30),
    kind=st.sampled_from([".csv", ".csv.gz", ".parquet"]),
    step=st.floats(0.01, 5.0),
)
def test_every_format_gives_back_what_was_written(tmp_path: Path, speed: list[float], kind: str, step: float) -> None:
    table = pd.DataFrame({"time_s": np.arange(len(speed)) * step, "speed_mps": speed, "power_w": np.abs(speed)})
    path = tmp_path / f"run{kind}"
    table.to_parquet(path) if kind == ".parquet" else table.to_csv(path, index=False)
    channels = read_recording(path).channels
    for name in table:
        np.testing.assert_allclose(channels[str(name)], table[name], rtol=1e-12)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
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


def test_last_line_with_an_empty_cell_is_not_a_cut_one(table: pd.DataFrame, csv: Write) -> None:
    table.loc[599, "power_w"] = np.nan
    assert len(read_recording(csv(table))) == 600


def test_no_file_folder_and_unknown_kind(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "none.csv")
    assert "is a folder" in refusal(tmp_path)
    (tmp_path / "run.xlsx").write_text("x")
    assert ".parquet" in refusal(tmp_path / "run.xlsx")


def test_empty_and_header_only(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("")
    assert "is empty" in refusal(path)
    path.write_text("time_s,speed_mps,power_w\n")
    assert "0 samples" in refusal(path)


@pytest.mark.parametrize("packed", [False, True])
def test_half_last_line(table: pd.DataFrame, csv: Write, tmp_path: Path, packed: bool) -> None:
    text = csv(table).read_bytes().rstrip(b"\n")
    text = text[: text.rindex(b",")]
    path = tmp_path / ("run.csv.gz" if packed else "run.csv")
    path.write_bytes(gzip.compress(text) if packed else text)
    assert "last line is cut off (3 of 4 cells)" in refusal(path)


@pytest.mark.parametrize("kind", ["csv.gz", "parquet"])
@pytest.mark.parametrize("share", [0.1, 0.6, 0.98])
def test_cut_files(table: pd.DataFrame, tmp_path: Path, kind: str, share: float) -> None:
    path = tmp_path / f"run.{kind}"
    table.to_parquet(path) if kind == "parquet" else table.to_csv(path, index=False)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    assert "is not a whole" in refusal(path)


def test_binary_in_a_csv(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(np.random.default_rng(0).bytes(5000))
    assert "binary" in refusal(path)


def test_time_must_increase(table: pd.DataFrame, csv: Write) -> None:
    table.loc[100, "time_s"] = 3.0
    assert "time_s goes back in row 101" in refusal(csv(table))
    table.loc[100, "time_s"] = 9.9
    assert "time_s repeats in row 101" in refusal(csv(table))
    table.loc[100, "time_s"] = np.nan
    assert "time_s in row 101 is missing" in refusal(csv(table))


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
def test_time_in_another_unit(table: pd.DataFrame, csv: Write, factor: float, unit: str) -> None:
    table["time_s"] *= factor
    assert f"looks like {unit}" in refusal(csv(table))


@pytest.mark.parametrize(("factor", "unit"), [(1.0, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_time_since_1970(table: pd.DataFrame, csv: Write, factor: float, unit: str) -> None:
    since_s = table["time_s"].copy()
    table["time_s"] = (factor * since_s).round(9).astype("int64" if factor > 1.0 else float) + 1_650_000_000 * int(
        factor
    )
    recording = read_recording(csv(table))
    np.testing.assert_allclose(recording.channels["time_s"] - 1.65e9, since_s, atol=1e-6)
    assert recording.notes == (() if unit == "s" else (f"time_s is in {unit}, read as s since 1970",))


@pytest.mark.parametrize("zone", ["Z", "+02:00", ""])
def test_dates(table: pd.DataFrame, csv: Write, zone: str) -> None:
    moments = pd.Timestamp("2024-05-01 12:00:00") + pd.to_timedelta(table["time_s"], unit="s")
    recording = read_recording(csv(table.assign(time_s=[f"{one.isoformat()}{zone}" for one in moments])))
    time_s = recording.channels["time_s"]
    np.testing.assert_allclose(time_s - time_s[0], table["time_s"], atol=1e-6)
    assert time_s[0] == pd.Timestamp(f"2024-05-01 12:00:00{zone}").timestamp()
    assert recording.notes == ("read with dates (ISO 8601) as s since 1970",)


@pytest.mark.parametrize(
    ("form", "taken"),
    [("%d.%m.%Y %H:%M:%S,%f", "dates (day.month.year) as s since 1970"),
     ("%Y-%m-%d %H:%M:%S,%f", "dates (ISO 8601) as s since 1970"), ("%H:%M:%S,%f", "times of day as s since midnight")],
)  # fmt: skip
def test_times_as_german_programs_write_them(table: pd.DataFrame, csv: Write, form: str, taken: str) -> None:
    moments = pd.Timestamp("2024-03-05 12:00:00") + pd.to_timedelta(table["time_s"], unit="s")
    recording = read_recording(csv(table.assign(time_s=moments.dt.strftime(form))))
    time_s = recording.channels["time_s"]
    np.testing.assert_allclose(time_s - time_s[0], table["time_s"], atol=1e-6)
    assert recording.notes == (f"read with {taken}",)
    if "%d" in form:
        assert time_s[0] == pd.Timestamp("2024-03-05 12:00:00Z").timestamp()


def test_dates_in_a_parquet_file(table: pd.DataFrame, tmp_path: Path) -> None:
    moments = pd.Timestamp("2024-05-01 12:00:00") + pd.to_timedelta(table["time_s"], unit="s")
    table.assign(time_s=moments).to_parquet(tmp_path / "run.parquet")
    time_s = read_recording(tmp_path / "run.parquet").channels["time_s"]
    np.testing.assert_allclose(time_s - time_s[0], table["time_s"], atol=1e-6)


@pytest.mark.parametrize("separator", [",", ";", "\t", "|"])
@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_tables_as_other_programs_write_them(
    table: pd.DataFrame, tmp_path: Path, separator: str, decimal: str, encoding: str
) -> None:
    path = tmp_path / "run.csv"
    table.assign(**{"Temp °C": 20.5}).to_csv(path, sep=separator, decimal=decimal, encoding=encoding, index=False)
    recording = read_recording(path)
    for name in table:
        np.testing.assert_allclose(recording.channels[str(name)], table[name], rtol=1e-12)
    plain = separator == "," and decimal == "." and encoding in ("utf-8", "utf-8-sig")
    assert len(recording.notes) == (0 if plain else 1)


@pytest.mark.parametrize(
    ("head", "notes"),
    [
        ("# logger 3.1\n#\ntime_s,speed_mps,power_w\n", "2 lines of comment before the names left out"),
        ("# time_s,speed_mps,power_w\n", ""),  # as numpy.savetxt writes it
        ("# logger\n# time_s,speed_mps,power_w\n", "1 line of comment before the names left out"),
        ("time_s,speed_mps,power_w\ns,m/s,W\n", "the line of units after the names left out"),
        ("# a\ntime_s,speed_mps,power_w\n[s],[m/s],[W]\n", "left out, the line of units after the names left out"),
    ],
)
def test_comments_and_units_around_the_names(table: pd.DataFrame, tmp_path: Path, head: str, notes: str) -> None:
    path = tmp_path / "run.csv"
    rows = table[["time_s", "speed_mps", "power_w"]].to_csv(index=False, header=False)
    path.write_text(head + rows)
    recording = read_recording(path)
    np.testing.assert_allclose(recording.channels["power_w"], table["power_w"], rtol=1e-12)
    assert len(recording) == 600 and notes in "".join(recording.notes) and bool(notes) == bool(recording.notes)


def test_cells_between_spaces(table: pd.DataFrame, tmp_path: Path) -> None:
    path = tmp_path / "run.txt"
    columns = ["time_s", "speed_mps", "power_w"]
    np.savetxt(path, table[columns], "%12.6f", header=" ".join(columns))
    recording = read_recording(path)
    np.testing.assert_allclose(recording.channels["speed_mps"], table["speed_mps"], atol=1e-6)
    assert recording.notes == ("read with cells separated by spaces",)


def test_a_name_with_spaces_is_one_name(table: pd.DataFrame, tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("the time of day\n1\n2\n")
    assert "it has the time of day" in refusal(tmp_path / "run.csv")
    table.to_csv(tmp_path / "run.tsv", sep="\t", index=False)
    assert len(read_recording(tmp_path / "run.tsv")) == 600


def test_times_of_day(table: pd.DataFrame, csv: Write) -> None:
    stamps = pd.to_datetime(12 * 3600 + table["time_s"], unit="s").dt.strftime("%H:%M:%S.%f")
    recording = read_recording(csv(table.assign(time_s=stamps)))
    np.testing.assert_allclose(recording.channels["time_s"], 12 * 3600 + table["time_s"], atol=1e-6)
    assert recording.notes == ("read with times of day as s since midnight",)
    american = csv(table.assign(time_s="05/01/2024 12:00:00 PM"))
    assert "row 1 is '05/01/2024 12:00:00 PM', neither a number nor a time such as 2024-05-01T" in refusal(american)


def test_commas_for_both_cells_and_decimals_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("time_s,speed_mps,power_w\n" + "".join(f"0,{row},1,0,5,5\n" for row in range(9)))
    assert "row 1 has 6 cells, the header 3; numbers with decimal commas" in refusal(path)


def test_a_half_line_of_a_wide_encoding(table: pd.DataFrame, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    text = table.to_csv(index=False).rstrip("\n")
    path.write_text(text[: text.rindex(",")], "utf-16")
    assert "last line is cut off (3 of 4 cells)" in refusal(path)


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


@pytest.mark.parametrize(
    ("lines", "said"),
    [(b"0,0,0\n", "more than 100000 rows"), (b"0" * 2**16, "a line of more than 1048576 bytes")],
)
def test_a_file_that_unpacks_to_gigabytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lines: bytes, said: str
) -> None:
    monkeypatch.setattr("homeward.logs.tables.MOST_ROWS", 100_000)
    path = tmp_path / "run.csv.gz"
    with gzip.open(path, "wb") as file:
        file.write(b"time_s,speed_mps,power_w\n")
        for _ in range(1000):
            file.write(lines * (600 if len(lines) < 10 else 1))
    assert said in refusal(path)
    monkeypatch.setattr("homeward.logs.tables.MOST_BYTES", 2**20)
    monkeypatch.setattr("homeward.logs.tables.MOST_ROWS", 10**9)
    assert "GB, unpacked" in refusal(path) or len(lines) > 10


def test_a_parquet_file_of_too_many_rows(tmp_path: Path, table: pd.DataFrame, monkeypatch: pytest.MonkeyPatch) -> None:
    table.to_parquet(tmp_path / "run.parquet")
    monkeypatch.setattr("homeward.logs.tables.MOST_ROWS", 100)
    assert "more than 100 rows" in refusal(tmp_path / "run.parquet")
    monkeypatch.setattr("homeward.logs.tables.MOST_ROWS", 1000)
    monkeypatch.setattr("homeward.logs.tables.MOST_BYTES", 1000)
    assert "GB, unpacked" in refusal(tmp_path / "run.parquet")


@pytest.mark.parametrize(
    ("channel", "values", "unit"),
    [
        ("speed_mps", (0.0, 900.0), "mm/s"),
        ("speed_mps", (0.0, 130.0), "km/h"),
        ("grade_rad", (-12.0, 12.0), "degrees"),
        ("yaw_rate_radps", (-90.0, 90.0), "degrees per second"),
        ("heading_rad", (0.0, 359.0), "degrees"),
        ("soc", (20.0, 95.0), "per cent"),
        ("temperature_c", (270.0, 300.0), "kelvin"),
        ("power_w", (1e6, 4e6), "milliwatts"),
        ("voltage_v", (2.2e4, 2.5e4), "millivolts"),
        ("current_a", (2e3, 9e3), "milliamperes"),
        ("motor_left_a", (2e3, 9e3), "milliamperes"),
    ],
)
def test_values_in_another_unit(
    table: pd.DataFrame, csv: Write, channel: str, values: tuple[float, float], unit: str
) -> None:
    table[channel] = np.tile([values[0], values[1], sum(values) / 2], 200)
    message = refusal(csv(table))
    assert channel in message and f"looks like {unit}" in message


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


def test_stray_values_are_left_out_and_noted(table: pd.DataFrame, csv: Write) -> None:
    table.loc[7, "speed_mps"] = 1e4
    recording = read_recording(csv(table))
    assert np.isnan(recording.channels["speed_mps"][7])
    assert recording.notes == ("1 values of speed_mps are outside -70 to 70 m/s and left out",)


def test_text_and_infinity_in_a_cell(table: pd.DataFrame, csv: Write) -> None:
    assert "power_w in row 4 is 'n/k', not a number" in refusal(
        csv(table.astype({"power_w": object}).assign(power_w=lambda t: t.power_w.where(t.index != 3, "n/k")))
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


def test_mapping_applies_factors_sums_and_constants(tmp_path: Path) -> None:
    mapping = tmp_path / "map.toml"
    mapping.write_text(
        'separator = ";"\n[columns]\ntime_s = { columns = ["s", "ns"], factors = [1.0, 1e-9] }\n'
        'speed_mps = { column = "kmh", factor = 0.2777777777777778 }\npower_w = "p"\n[constants]\ngrade_rad = 0.1\n'
    )
    path = tmp_path / "run.csv"
    path.write_text("s;ns;kmh;p\n10;500000000;3.6;7\n11;0;7.2;8\n")
    channels = read_recording(path, mapping).channels
    np.testing.assert_allclose(channels["time_s"], [10.5, 11.0])
    np.testing.assert_allclose(channels["speed_mps"], [1.0, 2.0])
    np.testing.assert_allclose(channels["grade_rad"], 0.1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[columns]\nspeed_mps = 'v'", "at least time_s"),
        ("[columns]\ntime_s = 't'\nvelocity = 'v'", "velocity is not a channel"),
        ("[columns]\ntime_s = { column = 't', scale = 2 }", "is not understood"),
        ("[columns]\ntime_s = { column = 't', factor = 'x' }", "not a finite number"),
        ("[columns]\ntime_s = { columns = ['a', 'b'], factors = [1.0] }", "one factor each"),
        ("[columns]\ntime_s = 't'\n[constants]\nsoc = 'full'", "constants.soc"),
        ("[columns", "not a readable TOML"),
        ("columns = 5", "needs a table [columns]"),
        ("columns = []", "needs a table [columns]"),
        ("columns = 'speed'", "needs a table [columns]"),
        ("[columns]\ntime_s = { columns = 5, factors = 3 }", "one factor each"),
        ("[columns]\ntime_s = { columns = [], factors = [] }", "one factor each"),
        ("separator = ', '\n[columns]\ntime_s = 't'", "separator = ', ' is not one character"),
        ("separator = 5\n[columns]\ntime_s = 't'", "separator = 5 is not one character"),
        ("decimal = ':'\n[columns]\ntime_s = 't'", "decimal = ':' is neither"),
        ("[columns]\ntime_s = { column = 5, whole_seconds = true }", "column is a name"),
        ("columns = " + "[" * 5000, "nested too deeply"),
        ("columns = " + "[" * 50 + "]" * 50, "nested too deeply"),
        ("a" + ".a" * 100000 + " = 1", "too many dots"),
        ("rows = 1\n[columns]\ntime_s = 't'", "rows is not a known entry"),
        ("unknown_if_zero = 'speed_mps'\n[columns]\ntime_s = 't'", "unknown_if_zero = 'speed_mps' is not a list"),
        ("unknown_if_zero = [[]]\n[columns]\ntime_s = 't'", "unknown_if_zero = [[]] is not a list of channels"),
    ],
)
def test_wrong_mappings(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(RecordingError, match=said.replace("[", r"\[")):
        load_columns(path)


VESC_TOOL = (  # the line of names that vescinterface.cpp writes, with its last semicolon
    "ms_today;input_voltage;temp_mos_max;temp_mos_1;temp_mos_2;temp_mos_3;temp_motor;current_motor;current_in;"
    "d_axis_current;q_axis_current;erpm;duty_cycle;amp_hours_used;amp_hours_charged;watt_hours_used;watt_hours_charged;"
    "tachometer;tachometer_abs;encoder_position;fault_code;vesc_id;d_axis_voltage;q_axis_voltage;ms_today_setup;"
    "amp_hours_setup;amp_hours_charged_setup;watt_hours_setup;watt_hours_charged_setup;battery_level;battery_wh_tot;"
    "current_in_setup;current_motor_setup;speed_meters_per_sec;tacho_meters;tacho_abs_meters;num_vescs;ms_today_imu;roll;"
    "pitch;yaw;accX;accY;accZ;gyroX;gyroY;gyroZ;gnss_posTime;gnss_lat;gnss_lon;gnss_alt;gnss_gVel;gnss_vVel;gnss_hAcc;"
    "gnss_vAcc;"
)


@pytest.fixture
def vesc_tool(tmp_path: Path) -> Callable[[float], Path]:
    """A log of VESC Tool of ten seconds at 20 Hz, two controllers on one battery, by the speed at its start."""

    def write(speed_mps: float) -> Path:
        names = VESC_TOOL.split(";")[:-1]
        table = pd.DataFrame(0.0, range(200), names).assign(
            ms_today=68209883 + 50 * np.arange(200), input_voltage=38.1, current_motor=20.0, current_motor_setup=41.0,
            current_in=2.0, current_in_setup=4.1, speed_meters_per_sec=speed_mps - 0.02 * np.arange(200) * speed_mps,
            erpm=2000.0, num_vescs=2,
        )  # fmt: skip
        rows = table.to_csv(sep=";", header=False, index=False, float_format="%.6g").splitlines()
        path = tmp_path / "2026-11-23_18-56-49.csv"
        path.write_text("\n".join([VESC_TOOL, *(f"{row};" for row in rows)]) + "\n")
        return path

    return write


def test_a_log_of_vesc_tool_needs_no_mapping(vesc_tool: Callable[[float], Path]) -> None:
    recording = read_recording(vesc_tool(1.5))
    given = recording.channels
    np.testing.assert_allclose(given["time_s"], 68209.883 + 0.05 * np.arange(200))
    np.testing.assert_allclose(given["current_a"], 4.1)  # of the battery, for both controllers
    np.testing.assert_allclose(given["voltage_v"], 38.1)
    np.testing.assert_allclose(given["speed_mps"], 1.5 - 0.03 * np.arange(200))
    assert recording.notes[0] == "mapping vesc_tool, known by the names of the columns"


def test_a_log_of_vesc_tool_that_did_not_ask_for_the_speed_is_no_robot_that_stands(
    vesc_tool: Callable[[float], Path],
) -> None:
    path = vesc_tool(0.0)
    assert "has no motion channel" in refusal(path)
    assert not read_recording(path, standing=True).channels["speed_mps"].any()


def test_a_cut_log_of_vesc_tool_is_refused(vesc_tool: Callable[[float], Path]) -> None:
    path = vesc_tool(1.5)
    path.write_bytes(path.read_bytes()[:-70])
    assert "the last line is cut off" in refusal(path)


def test_unknown_mapping_and_missing_mapped_column(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="husky_borealtc"):
        load_columns("husky")
    path = tmp_path / "run.csv"
    path.write_text("time,curL,curR,velL\n0,1,1,0\n1,1,1,0\n")
    assert "has no column velR, which the mapping husky_borealtc names" in refusal(path, "husky_borealtc")
