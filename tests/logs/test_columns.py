"""Mapping files: foreign columns become channels in SI units, or one line says what is wrong with
the mapping."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from homeward.diagnosis import Recording, RecordingError, load_columns, read_recording
from homeward.logs import columns
from homeward.logs.channels import CHANNELS, POWER, first_set
from homeward.logs.columns import Source, known_columns, numeric, shipped, source_of
from tests.logs.refused import refusal


def test_a_source_is_the_sum_of_its_columns_by_their_factors() -> None:
    table = pd.DataFrame({"a": [1.0, 2.0], "b": [10.0, 20.0]})
    assert Source((("a", 2.0), ("b", -0.5)), 100.0).apply(table).tolist() == [97.0, 94.0]
    assert Source((("a", 0.5),)).apply({"a": 3.0}) == 1.5


@pytest.mark.parametrize(
    ("entry", "source"),
    [
        ("v", Source((("v", 1.0),))),
        ({"column": "v", "factor": 2}, Source((("v", 2.0),))),
        (
            {"columns": ["a", "b"], "factors": [1, 1e-9], "offset": -3},
            Source((("a", 1.0), ("b", 1e-9)), -3.0),
        ),
        ({"columns": ["a", "b"], "factor": 4.0}, Source((("a", 4.0), ("b", 4.0)))),
    ],
)
def test_an_entry_is_its_source(entry: object, source: Source) -> None:
    assert source_of("here", entry, "column") == source


@pytest.mark.parametrize(
    "entry", [{"column": "v", "factor": one} for one in (0.0, True, "1", 10**400, np.nan)]
)
def test_a_factor_is_a_finite_number(entry: object) -> None:
    with pytest.raises(
        RecordingError, match=r"^here has a factor or offset that is not a finite number, or"
    ):
        source_of("here", entry, "column")


@pytest.mark.parametrize("name", shipped(columns._MAPS))
def test_a_shipped_mapping_has_motion_and_power_or_stands(name: str) -> None:
    mapping = load_columns(name)
    assert set(mapping.sources) | set(mapping.constants) <= set(CHANNELS)
    # One topic of a run, or a rover that stands.
    partial = ("ase_rover", "ros2_echo_odometry")
    assert first_set(POWER, {*mapping.sources, *mapping.constants}) or name in partial
    assert ("time_s" in mapping.sources) != (mapping.sample_hz is not None)
    assert load_columns(mapping) is mapping


def test_a_table_is_known_only_by_all_the_columns_of_its_program() -> None:
    names = load_columns("vesc_tool").file_columns()
    found = known_columns([*names, "more"])
    assert found is not None and found.name == "vesc_tool"
    assert known_columns(names[1:]) is None is known_columns([])


def test_numbers_of_text_and_gaps() -> None:
    np.testing.assert_array_equal(
        numeric(pd.Series(["1.5", "x", None, "-2e3"])), [1.5, np.nan, np.nan, -2000.0]
    )
    with pytest.raises(RecordingError, match="a whole number of hundreds of digits"):
        numeric(pd.Series([1, 10**400], dtype=object))


def test_a_channel_that_is_zero_throughout_is_missing_where_the_mapping_says_so(
    tmp_path: Path,
) -> None:
    (tmp_path / "map.toml").write_text(
        'unknown_if_zero = ["speed_mps"]\nsample_hz = 4.0\n[columns]\nspeed_mps = "v"\npower_w = "p"\n'
    )
    mapping = load_columns(tmp_path / "map.toml")
    table = pd.DataFrame({"v": [0.0, 0.0], "p": [0.0, 0.0]}, index=[0, 3])
    still = mapping.apply(table)
    # a line is lost
    assert list(still) == ["time_s", "power_w"] and still["time_s"].tolist() == [0.0, 0.75]
    assert list(mapping.apply(table.assign(v=[0.0, 0.1]))) == ["time_s", "speed_mps", "power_w"]


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
        (
            "unknown_if_zero = 'speed_mps'\n[columns]\ntime_s = 't'",
            "unknown_if_zero = 'speed_mps' is not a list",
        ),
        (
            "unknown_if_zero = [[]]\n[columns]\ntime_s = 't'",
            "unknown_if_zero = [[]] is not a list of channels",
        ),
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
    """A log of VESC Tool of ten seconds at 20 Hz, two controllers on one battery, by the speed at
    its start."""

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


def test_unknown_mapping_and_missing_mapped_column(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="husky_borealtc"):
        load_columns("husky")
    path = tmp_path / "run.csv"
    path.write_text("time,curL,curR,velL\n0,1,1,0\n1,1,1,0\n")
    assert "has no column velR, which the mapping husky_borealtc names" in refusal(
        path, "husky_borealtc"
    )


METER = """
header = ["index", "volt", "milliamp"]
sample_hz = 10.0
[columns]
voltage_v = "volt"
current_a = { column = "milliamp", factor = 1e-3 }
"""


def test_files_without_names_or_times(tmp_path: Path) -> None:
    (tmp_path / "meter.toml").write_text(METER)
    lines = [f"{i},12.0,{500 + i % 3}" for i in range(200)]
    lines[20], lines[50], lines[51] = "20,12.0", "50,12.0,abc", "51,12.0,500,7,8"
    run = tmp_path / "DATA.TXT"
    run.write_text("\n".join(lines))
    recording = read_recording(run, tmp_path / "meter.toml", standing=True)
    assert len(recording) == 197 and recording.notes == ("3 broken lines are left out",)
    # a lost line keeps its time
    assert recording.channels["time_s"][[0, 20, -1]] == pytest.approx([0.0, 2.1, 19.9])
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
    (tmp_path / "run.csv").write_text(
        "stamp,power\n" + "".join(f"{s},{7 + i % 2}\n" for i, s in enumerate(stamps))
    )
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
        (
            'sample_hz = 5\n[columns]\ntime_s = "t"\npower_w = "p"',
            "or with sample_hz instead of it",
        ),
        ('sample_hz = "5"\n[columns]\npower_w = "p"', "is not a finite number"),
        ('sample_hz = -5\n[columns]\npower_w = "p"', "is not between"),
        (
            'sample_hz = 5\nheader = ["p", "p"]\n[columns]\npower_w = "p"',
            "not a list of different names",
        ),
        (
            '[columns]\ntime_s = { column = "t", whole_seconds = true }\nspeed_mps = "t"',
            "is the column of the stamps",
        ),
        (
            '[columns]\ntime_s = "t"\npower_w = { column = "p", whole_seconds = true }',
            "is for time_s only",
        ),
        (
            '[columns]\ntime_s = { column = "t", whole_seconds = true, factor = 2.0 }',
            "is not understood",
        ),
    ],
)
def test_wrong_mappings_of_files_without_times(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(RecordingError, match=said):
        load_columns(tmp_path / "map.toml")


def test_a_cut_log_of_vesc_tool_is_refused(vesc_tool: Callable[[float], Path]) -> None:
    path = vesc_tool(1.5)
    path.write_bytes(path.read_bytes()[:-70])
    assert "the last line is cut off" in refusal(path)
