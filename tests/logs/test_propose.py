"""A mapping proposed for a foreign table reads it as what it is."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from homeward.commands.columns import Args, _tried, main
from homeward.diagnosis import RecordingError, load_columns, read_recording
from homeward.logs.channels import CHANNELS
from homeward.logs.propose import propose

TRUTH = pd.DataFrame(
    {
        "time_s": np.arange(600) / 10.0,
        "speed_mps": 0.5 + 0.4 * np.sin(np.arange(600) / 40.0),
        "voltage_v": 25.0 + np.sin(np.arange(600) / 90.0),
        "current_a": 4.0 + np.sin(np.arange(600) / 40.0),
        "heading_rad": np.arange(600) / 300.0,
        "grade_rad": 0.1 * np.sin(np.arange(600) / 50.0),
        "temperature_c": 15.0 + np.arange(600) / 200.0,
        "soc": 0.9 - np.arange(600) / 3000.0,
    }
)
TABLES = {
    "units in brackets": {
        "Time [ms]": ("time_s", 1e3, 0.0), "Velocity [km/h]": ("speed_mps", 3.6, 0.0),
        "Voltage (V)": ("voltage_v", 1.0, 0.0), "Battery current [mA]": ("current_a", 1e3, 0.0),
        "Heading [deg]": ("heading_rad", 180.0 / np.pi, 0.0), "Temperature [K]": ("temperature_c", 1.0, 273.15),
        "SoC [%]": ("soc", 100.0, 0.0),
    },
    "units at the end": {
        "timestamp_s": ("time_s", 1.0, 0.0), "speed_kmh": ("speed_mps", 3.6, 0.0),
        "batteryVoltage_mV": ("voltage_v", 1e3, 0.0),
        "current_mA": ("current_a", 1e3, 0.0), "yaw_deg": ("heading_rad", 180.0 / np.pi, 0.0),
        "temp_f": ("temperature_c", 1.8, 32.0),
    },
    "no units": {
        "t": ("time_s", 1.0, 0.0), "vx": ("speed_mps", 1.0, 0.0), "voltage": ("voltage_v", 1.0, 0.0),
        "current": ("current_a", 1.0, 0.0), "battery_level": ("soc", 1.0, 0.0),
    },
    "German": {
        "Zeit [s]": ("time_s", 1.0, 0.0), "Geschwindigkeit [km/h]": ("speed_mps", 3.6, 0.0),
        "Spannung [V]": ("voltage_v", 1.0, 0.0), "Strom [A]": ("current_a", 1.0, 0.0),
        "Neigung [°]": ("grade_rad", 180.0 / np.pi, 0.0), "Temperatur": ("temperature_c", 1.0, 0.0),
    },
    "a motor controller's": {
        "timestamp_ms": ("time_s", 1e3, 0.0), "v_in": ("voltage_v", 1.0, 0.0),
        "speed": ("speed_mps", 1.0, 0.0), "avg_input_current": ("current_a", 1.0, 0.0),
    },
    "letters of formulas": {
        "time_s": ("time_s", 1.0, 0.0), "speed [km/h]": ("speed_mps", 3.6, 0.0), "I mA": ("current_a", 1e3, 0.0),
        "U V": ("voltage_v", 1.0, 0.0),
    },
    "units alone": {
        "t": ("time_s", 1.0, 0.0), "v": ("speed_mps", 1.0, 0.0), "Pack [A]": ("current_a", 1.0, 0.0),
        "Pack [mV]": ("voltage_v", 1e3, 0.0),
    },
    "a battery's": {
        "stamp": ("time_s", 1.0, 0.0), "speed_kmh": ("speed_mps", 3.6, 0.0), "batt_mV": ("voltage_v", 1e3, 0.0),
        "batt_mA": ("current_a", -1e3, 0.0),
    },
    "units by values": {
        "time": ("time_s", 1.0, 0.0), "velocity": ("speed_mps", 1.0, 0.0), "voltage": ("voltage_v", 1e3, 0.0),
        "current": ("current_a", -1.0, 0.0), "battery_level": ("soc", 100.0, 0.0),
    },
}  # fmt: skip


@pytest.mark.parametrize("case", TABLES)
def test_what_is_proposed_reads_as_the_truth(tmp_path: Path, case: str) -> None:
    columns = TABLES[case]
    table = pd.DataFrame(
        {
            name: TRUTH[channel] * factor + offset
            for name, (channel, factor, offset) in columns.items()
        }
    )
    table = table.assign(remark="ok", temp_fet=31.5, avg_motor_current=9.0)
    path, mapping = tmp_path / "run.csv", tmp_path / "map.toml"
    table.to_csv(path, index=False)
    proposal = propose(path)
    assert {one.column: one.channel for one in proposal.guesses} == {
        name: to[0] for name, to in columns.items()
    }
    assert list(proposal.left_over) == ["remark", "temp_fet", "avg_motor_current"]
    mapping.write_text(proposal.toml())
    channels = read_recording(path, mapping).channels
    for channel, _, _ in columns.values():
        np.testing.assert_allclose(channels[channel], TRUTH[channel], atol=1e-6)


def test_how_sure_it_is_says_why(tmp_path: Path) -> None:
    table = pd.DataFrame(
        {"time_s": TRUTH.time_s, "Speed": TRUTH.speed_mps, "current": -TRUTH.current_a}
    )
    table.to_csv(tmp_path / "run.csv", index=False)
    by_channel = {one.channel: one for one in propose(tmp_path / "run.csv").guesses}
    assert [by_channel[name].sure for name in ("time_s", "speed_mps", "current_a")] == [0, 1, 2]
    assert "negative when discharging" in by_channel["current_a"].why


def test_one_of_several_by_its_number_is_only_a_guess(tmp_path: Path) -> None:
    table = pd.DataFrame(
        {"time_s": TRUTH.time_s, "speed1 [m/s]": TRUTH.speed_mps, "voltage [V]": TRUTH.voltage_v}
    )
    table.to_csv(tmp_path / "run.csv", index=False)
    written = propose(tmp_path / "run.csv").toml()
    (line,) = (line for line in written.splitlines() if "speed1" in line)
    assert "# a guess: " in line and line.endswith("one of several by its number")


def test_dates_and_decimal_commas(tmp_path: Path) -> None:
    stamps = [
        (pd.Timestamp("2024-05-01") + pd.Timedelta(seconds=one)).isoformat() for one in TRUTH.time_s
    ]
    table = TRUTH.rename(
        columns={"speed_mps": "Geschwindigkeit speed (m/s)", "voltage_v": "U Spannung (V)"}
    ).assign(Date=stamps)
    path = tmp_path / "run.csv"
    table.drop(columns="time_s").to_csv(path, index=False, sep=";", decimal=",")
    proposal = propose(path)
    assert proposal.guesses[0].column == "Date" and "ISO 8601" in proposal.guesses[0].why
    assert proposal.notes == ("cells separated by semicolons", "decimal commas")


def test_a_parquet_file_of_the_schema_is_its_own_mapping(tmp_path: Path) -> None:
    TRUTH.to_parquet(tmp_path / "run.parquet")
    proposal = propose(tmp_path / "run.parquet")
    assert {one.column: one.channel for one in proposal.guesses} == {name: name for name in TRUTH}
    (tmp_path / "map.toml").write_text(proposal.toml())
    assert set(load_columns(tmp_path / "map.toml").sources) == set(TRUTH) <= set(CHANNELS)


@pytest.mark.parametrize(
    ("name", "content"),
    [("run.bag", b"x"), ("none.csv", None), ("run.csv", b"\x00\x01\x02"), ("e.csv", b"")],
)
def test_what_is_no_table_is_refused(tmp_path: Path, name: str, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=name):
        propose(tmp_path / name)


def test_names_that_are_no_toml_are_quoted(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    TRUTH.rename(columns={"speed_mps": 'speed "x" \\ # [m/s]'}).to_csv(path, index=False)
    (tmp_path / "map.toml").write_text(propose(path).toml())
    assert len(read_recording(path, tmp_path / "map.toml")) == 600


def test_a_line_of_units_tells_the_units(tmp_path: Path) -> None:
    rows = (
        TRUTH[["time_s", "speed_mps", "current_a"]]
        .mul([1e3, 3.6, 1.0])
        .to_csv(index=False, header=False)
    )
    (tmp_path / "run.csv").write_text("time,speed,current\nms,km/h,A\n" + rows)
    factors = {one.channel: one.factor for one in propose(tmp_path / "run.csv").guesses}
    assert factors == {"time_s": 1e-3, "speed_mps": pytest.approx(1 / 3.6), "current_a": 1.0}


def test_a_channel_that_is_negative_is_turned(tmp_path: Path) -> None:
    TRUTH.assign(current_a=-TRUTH["current_a"]).to_csv(tmp_path / "run.csv", index=False)
    (current,) = (
        one for one in propose(tmp_path / "run.csv").guesses if one.channel == "current_a"
    )
    assert (current.factor, current.sure) == (-1.0, 2)


@pytest.mark.parametrize("stamp", ["6024-05-01T12:00:00", "05/01/2024 12:00:00 PM"])
def test_dates_that_are_none_are_left_over_with_the_reason(tmp_path: Path, stamp: str) -> None:
    TRUTH.assign(time=stamp).drop(columns="time_s").to_csv(tmp_path / "run.csv", index=False)
    assert (
        "neither numbers nor times such as 2024-05-01T"
        in propose(tmp_path / "run.csv").left_over["time"]
    )


def test_what_a_program_wrote_goes_by_its_mapping(tmp_path: Path) -> None:
    mapping = load_columns("vesc_tool")
    names = [*mapping.file_columns(), "current_motor"]
    table = pd.DataFrame(np.outer(np.arange(1, 101), np.ones(len(names))), columns=names)
    table.to_csv(tmp_path / "run.csv", sep=";", index=False)
    guesses = propose(tmp_path / "run.csv").guesses
    assert {one.channel: one.column for one in guesses} == {
        channel: source.terms[0][0] for channel, source in mapping.sources.items()
    }
    table.assign(speed_meters_per_sec=0.0).to_csv(tmp_path / "run.csv", sep=";", index=False)
    assert "speed_meters_per_sec" in propose(tmp_path / "run.csv").left_over


@pytest.mark.parametrize(
    "other", [["a [A]", "b [A]"], ["Motor [A]"], ["leg (a)"], ["i_x"], ["Irradiance [W/m2]"]]
)
def test_a_unit_that_may_be_of_anything_proposes_nothing(tmp_path: Path, other: list[str]) -> None:
    table = TRUTH[["time_s", "speed_mps"]].assign(**dict.fromkeys(other, TRUTH.current_a))
    table.to_csv(tmp_path / "run.csv", index=False)
    proposal = propose(tmp_path / "run.csv")
    assert list(proposal.left_over) == other


def test_a_letter_or_a_unit_is_only_a_guess(tmp_path: Path) -> None:
    rows = TRUTH[["time_s", "speed_mps", "current_a", "voltage_v"]].to_csv(
        index=False, header=False
    )
    (tmp_path / "run.csv").write_text("time,speed,i,pack\ns,m/s,A,V\n" + rows)
    sure = {one.channel: one.sure for one in propose(tmp_path / "run.csv").guesses}
    assert (sure["current_a"], sure["voltage_v"]) == (2, 2)


@pytest.mark.parametrize(
    ("columns", "channel", "right"),
    [
        (("speed_mps", "watt_hours_used"), "power_w", None),
        (("speed_mps", "power_supply_status"), "power_w", None),
        (("speed_mps", "Capa(mAh)"), "current_a", None),
        (("speed_mps", "current_limit_a"), "current_a", None),
        (("speed_mps", "current_setpoint", "current"), "current_a", "current"),
        (("speed_mps", "iq_phase_current"), "current_a", None),
        (("avg_voltage", "voltage"), "voltage_v", "voltage"),
        (("v", "speed", "voltage"), "speed_mps", "speed"),
        (("v2", "velocity"), "speed_mps", "velocity"),
        (("voltage1", "voltage"), "voltage_v", "voltage"),
        (("time_min", "speed"), "time_s", "time_s"),
    ],
)
def test_what_is_no_measurement_of_a_channel_is_not_proposed(
    tmp_path: Path, columns: tuple[str, ...], channel: str, right: str | None
) -> None:
    table = pd.DataFrame(
        {"time_s": np.arange(100.0), **{name: 1.0 + np.arange(100) % 7 / 10.0 for name in columns}}
    )
    table.to_csv(tmp_path / "run.csv", index=False)
    chosen = {one.channel: one.column for one in propose(tmp_path / "run.csv").guesses}
    assert chosen.get(channel) == right


def test_a_date_and_the_time_of_day_are_joined(tmp_path: Path) -> None:
    """As EdgeTX writes a log; a percentage in 0 to 1 is a share whatever its name says."""
    rows = "".join(f"2026-05-01,10:00:{i:02d}.500,{i % 5},24.0,1.5,0.9\n" for i in range(50))
    path = tmp_path / "log.csv"
    path.write_text("Date,Time,GSpd(kmh),RxBt(V),Curr(A),percentage\n" + rows)
    proposal = propose(path)
    (tmp_path / "map.toml").write_text(proposal.toml())
    read = read_recording(path, tmp_path / "map.toml")
    assert read.duration_s == pytest.approx(49.0) and read.channels["time_s"][0] == pytest.approx(
        1777629600.5
    )
    assert read.channels["soc"][0] == 0.9 and read.channels["current_a"][0] == 1.5


def test_a_table_without_a_time_gets_a_proposal_that_says_so(tmp_path: Path) -> None:
    TRUTH.drop(columns="time_s").to_csv(tmp_path / "run.csv", index=False)
    proposal = propose(tmp_path / "run.csv")
    assert "time_s" not in {guess.channel for guess in proposal.guesses}
    lines, reads = _tried(proposal.path, [proposal])
    assert not reads and "has no time_s; the mapping gives" in lines[-1]


def test_tables_of_one_run_get_a_mapping_each_that_reads_them_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = {"time_s": "Time [ms]", "speed_mps": "Velocity [km/h]", "voltage_v": "batt"}
    odometry = TRUTH[[*names]] * {"time_s": 1e3, "speed_mps": 3.6, "voltage_v": 1.0}
    odometry.rename(columns=names).to_csv(tmp_path / "odom.csv", index=False)
    names = {
        "time_s": "t",
        "voltage_v": "Voltage (V)",
        "current_a": "Current (mA)",
        "speed_mps": "v",
    }
    battery = TRUTH[[*names]][::5] * {
        "time_s": 1.0,
        "voltage_v": 1.0,
        "current_a": 1e3,
        "speed_mps": 1.0,
    }
    battery.rename(columns=names).to_csv(tmp_path / "bat.csv", index=False)
    both = Path(f"{tmp_path}/odom.csv+{tmp_path}/bat.csv")
    written = Path(f"{tmp_path}/odom.toml+{tmp_path}/bat.toml")
    first, second = main(Args(both, out=written))
    assert [guess.channel for guess in first.guesses] == ["time_s", "speed_mps"]
    assert [guess.channel for guess in second.guesses] == ["time_s", "voltage_v", "current_a"]
    assert (
        second.left_over["v"]
        == " (could be speed_mps, for which Velocity [km/h] of odom.csv is used)"
    )
    said = " ".join(capsys.readouterr().out.split())
    assert (
        "With it the file reads: 120 samples over 59.5 s." in said
        and f"--columns {written}" in said
    )
    recording = read_recording(both, str(written))
    np.testing.assert_allclose(recording.channels["current_a"], TRUTH["current_a"][::5], atol=1e-9)
    main(Args(both))
    assert "Write it with --out odom.toml+bat.toml" in capsys.readouterr().out
    for out, words in (
        (tmp_path / "one.toml", "give a file for each of 2 tables, such as a.toml"),
        (written, "an existing one is not replaced"),
    ):
        with pytest.raises(RecordingError, match=words):
            main(Args(both, out=out))
