"""Logs of PX4 and ArduPilot as recordings: real formats, units and axes as their sources say,
damage in one line."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pyulog", reason="needs the extra logs")
pytest.importorskip("pymavlink", reason="needs the extra logs")

from homeward.diagnosis import Recording, RecordingError, read_recording
from homeward.logs.bags.flight import FlightLog
from tests.logs.flight_writer import BOOT_US, Array, write_dataflash, write_ulog

FAST_S, SLOW_S = np.arange(0.0, 40.0, 0.05), np.arange(0.0, 40.0, 0.1)
SPEED_MPS = 0.8 * np.cos(FAST_S / 6.0)  # in reverse for half of the time
HEADING_RAD = 1.0 + 0.03 * FAST_S  # clockwise from north, as autopilots count
GRADE_RAD = 0.1 * np.sin(FAST_S / 10.0)
CURRENT_A = 3.0 + np.cos(SLOW_S / 6.0)
HEIGHT_M = 300.0 + 0.1 * FAST_S
VALID = np.ones(len(FAST_S), np.bool_)

POSITION = {
    "vx": SPEED_MPS * np.cos(HEADING_RAD), "vy": SPEED_MPS * np.sin(HEADING_RAD), "z": -HEIGHT_M,
    "heading": HEADING_RAD, "v_xy_valid": VALID, "z_valid": VALID,
}  # fmt: skip
HALF = np.stack([HEADING_RAD, GRADE_RAD]) / 2.0
(COS, COS_UP), (SIN, SIN_UP) = np.cos(HALF), np.sin(HALF)
# to the heading first, then the nose up
TURNED = COS * COS_UP, -SIN * SIN_UP, COS * SIN_UP, SIN * COS_UP
PX4 = {
    "battery_status": (SLOW_S, {"voltage_v": 25.0, "current_a": CURRENT_A, "remaining": 0.9 - SLOW_S / 1e3}),
    "vehicle_local_position": (FAST_S, POSITION),
    "vehicle_attitude": (FAST_S, dict(zip(["q[0]", "q[1]", "q[2]", "q[3]"], TURNED, strict=True))),
    "vehicle_angular_velocity": (FAST_S, {"xyz[0]": 0.0, "xyz[1]": 0.0, "xyz[2]": 0.03}),
}  # fmt: skip
ARDUPILOT: list[tuple[str, Array, Mapping[str, object]]] = [
    ("BAT", SLOW_S, {"Volt": 25.0, "Curr": CURRENT_A}),
    ("THR", FAST_S, {"Speed": SPEED_MPS}),
    ("STER", FAST_S, {"TurnRate": np.degrees(0.03)}),
    ("ATT", FAST_S, {"Roll": 5.0, "Pitch": np.degrees(GRADE_RAD), "Yaw": np.degrees(HEADING_RAD)}),
    ("POS", FAST_S, {"Alt": HEIGHT_M}),
]


def px4(folder: Path, **changes: object) -> Path:
    """A log of PX4 with some messages replaced; None leaves one out."""
    messages = {name: one for name, one in {**PX4, **changes}.items() if one is not None}
    return write_ulog(folder / "run.ulg", messages)  # type: ignore[arg-type]


def ardupilot(
    folder: Path, *changes: tuple[str, Array, Mapping[str, object]], without: str = ""
) -> Path:
    return write_dataflash(
        folder / "00000001.BIN",
        [one for one in ARDUPILOT if one[0] not in without.split()] + [*changes],
    )


def check(recording: Recording) -> None:
    """It is the drive above, on the clock of the battery."""
    given, time_s = recording.channels, recording.channels["time_s"]
    np.testing.assert_allclose(time_s, SLOW_S[: len(time_s)], atol=1e-6)
    assert len(time_s) >= len(SLOW_S) - 1
    np.testing.assert_allclose(given["current_a"], CURRENT_A[: len(time_s)], rtol=1e-6)
    np.testing.assert_allclose(given["voltage_v"], 25.0)
    np.testing.assert_allclose(given["speed_mps"], 0.8 * np.cos(time_s / 6.0), atol=1e-3)
    np.testing.assert_allclose(given["yaw_rate_radps"], -0.03, rtol=1e-5)
    np.testing.assert_allclose(np.diff(given["heading_rad"])[1:-1], -0.003, atol=2e-4)
    np.testing.assert_allclose(
        given["grade_rad"][8:-8], 0.1 * np.sin(time_s / 10.0)[8:-8], atol=5e-4
    )
    np.testing.assert_allclose(given["elevation_m"], 300.0 + 0.1 * time_s, atol=5e-3)


def test_a_log_of_px4_reads_as_the_drive_that_it_is_of(tmp_path: Path) -> None:
    recording = read_recording(px4(tmp_path))
    check(recording)
    np.testing.assert_allclose(
        recording.channels["soc"], 0.9 - recording.channels["time_s"] / 1e3, atol=1e-6
    )
    assert recording.notes[0].startswith(
        "topic mapping px4: power from battery_status, motion from vehicle_local_pos"
    )


def test_a_log_of_ardupilot_reads_as_the_drive_that_it_is_of(tmp_path: Path) -> None:
    recording = read_recording(ardupilot(tmp_path))
    check(recording)
    assert recording.notes[0].startswith("topic mapping ardupilot: power from BAT, motion from THR")


def test_the_rover_modules_speed_comes_first(tmp_path: Path) -> None:
    status = FAST_S, {"measured_speed_body_x": 0.5 + 0.0 * FAST_S}
    for name in ("rover_speed_status", "rover_velocity_status"):
        np.testing.assert_allclose(
            read_recording(px4(tmp_path, **{name: status})).channels["speed_mps"], 0.5
        )


def test_a_speed_without_rover_messages_comes_from_the_receiver_where_it_has_a_fix(
    tmp_path: Path,
) -> None:
    fixed = FAST_S > 10.0
    gps = FAST_S, {"vel_m_s": np.where(fixed, 1.2, 9.0), "fix_type": np.where(fixed, 3.0, 0.0)}
    received = px4(tmp_path, vehicle_local_position=None, vehicle_gps_position=gps)
    spd = {"Spd": gps[1]["vel_m_s"], "Status": np.where(fixed, 3, 1)}
    for path in (received, ardupilot(tmp_path, ("GPS", FAST_S, spd), without="THR")):
        given = read_recording(path).channels
        np.testing.assert_allclose(given["speed_mps"], 1.2, rtol=1e-6)
        assert np.ptp(given["time_s"]) == pytest.approx(29.9, abs=0.2)


def test_what_px4_marks_as_unknown_is_left_out(tmp_path: Path) -> None:
    unknown = np.arange(len(SLOW_S)) % 4 == 0
    battery = {
        "voltage_v": 25.0,
        "current_a": np.where(unknown, -1.0, CURRENT_A),
        "remaining": -1.0,
    }
    given = read_recording(px4(tmp_path, battery_status=(SLOW_S, battery))).channels
    assert given["current_a"].min() > 1.9
    assert "soc" not in given
    position = {**POSITION, "v_xy_valid": FAST_S > 20.0, "z_valid": ~VALID}
    given = read_recording(px4(tmp_path, vehicle_local_position=(FAST_S, position))).channels
    assert len(given["time_s"]) == pytest.approx(200, abs=2)
    assert "elevation_m" not in given
    with pytest.raises(
        RecordingError,
        match="has no power by the topic mapping px4; battery_status gives current_a as",
    ):
        read_recording(px4(tmp_path, battery_status=(SLOW_S, {**battery, "current_a": -1.0})))


def test_of_several_batteries_at_other_voltages_the_mapping_names_one(tmp_path: Path) -> None:
    later_s = SLOW_S + 0.03
    second = later_s, {"voltage_v": 12.0, "current_a": 1.0, "remaining": 0.5}
    of_px4 = px4(tmp_path, **{"battery_status#1": second})
    of_ardupilot = ardupilot(tmp_path, ("BAT", later_s, {"Inst": 1, "Volt": 12.0, "Curr": 1.0}))
    for path, mapping, name in (
        (of_px4, "px4", "battery_status"),
        (of_ardupilot, "ardupilot", "BAT"),
    ):
        with pytest.raises(
            RecordingError, match=rf"has several batteries, .*{name}@0 .*{name}@1 \(1 at 12 V\)"
        ):
            read_recording(path)
        mine = tmp_path / "mine.toml"
        shipped = Path(str(files("homeward.logs.bags") / "maps" / f"{mapping}.toml")).read_text(
            "utf-8"
        )
        mine.write_text(shipped.replace(f'name = "{name}"', f'name = "{name}@0"'), "utf-8")
        check(read_recording(path, mine))


def test_a_mapping_names_messages_and_fields(tmp_path: Path) -> None:
    mapping = tmp_path / "mine.toml"
    power = '[[topics]]\nname = "BAT"\npower_w = { field = "Curr", factor = 25.0 }\n'
    text = power + '[[topics]]\nname = "THR"\nspeed_mps = "Speed"\n'
    mapping.write_text(text)
    given = read_recording(ardupilot(tmp_path), mapping).channels
    np.testing.assert_allclose(
        given["power_w"], 25.0 * CURRENT_A[: len(given["power_w"])], rtol=1e-6
    )
    mapping.write_text(text.replace('"Speed"', '"Spd"'))
    with pytest.raises(
        RecordingError,
        match="THR: no field 'Spd'; it has TimeUS, ThrIn, ThrOut, DesSpeed, Speed, AccY",
    ):
        read_recording(ardupilot(tmp_path), mapping)


def test_time_counts_from_the_first_common_sample_and_not_from_the_start_of_the_autopilot(
    tmp_path: Path,
) -> None:
    with FlightLog(px4(tmp_path)) as log:
        samples, unread = log.samples({"battery_status": ["voltage_v"], "no_such_message": ["x"]})
    assert samples["battery_status"].stamp_ns[0] == BOOT_US * 1000
    assert unread == ["no_such_message is left out: none of its messages can be read"]


@pytest.mark.parametrize("kind", ["ulg", "bin"])
def test_a_cut_log_is_read_up_to_the_cut(tmp_path: Path, kind: str) -> None:
    path = px4(tmp_path) if kind == "ulg" else ardupilot(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: 2 * len(content) // 3])
    assert 0.6 < len(read_recording(path)) / len(SLOW_S) < 0.7


@pytest.mark.parametrize("kind", ["ulg", "bin"])
def test_damage_is_named_and_what_could_be_read_is_used(
    tmp_path: Path, kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = px4(tmp_path) if kind == "ulg" else ardupilot(tmp_path)
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 200] = bytes(200)
    path.write_bytes(content)
    recording = read_recording(path)
    assert len(recording) > 0.4 * len(SLOW_S)
    assert recording.notes[0].startswith(f"{path.name} is damaged (b")
    assert capfd.readouterr() == ("", "")


def damaged_definition(content: bytes) -> bytes:
    """A message that is said to be shorter than its header, at which a reader would not move on."""
    at = content.index(b"THR\0") - 1
    return content[:at] + b"\x00" + content[at + 1 :]


@pytest.mark.parametrize(
    ("kind", "content", "message"),
    [
        ("ulg", lambda whole: b"", "is empty"),
        ("bin", lambda whole: b"", "is empty"),
        ("ulg", lambda whole: b"time_s,speed_mps\n", r"is not a whole PX4 log \(Invalid file format"),
        ("ulg", lambda whole: whole[:30], "holds nothing that can be read as messages of PX4"),
        ("bin", lambda whole: b"time_s,speed_mps\n", "holds nothing that can be read as messages of ArduPilot"),
        ("bin", lambda whole: whole[:60], "holds nothing that can be read"),
        ("bin", damaged_definition, r"is not a whole ArduPilot log \(the definition of a message is damaged"),
    ],
)  # fmt: skip
def test_what_is_no_log_is_refused_in_a_line(
    tmp_path: Path, kind: str, content: object, message: str
) -> None:
    path = px4(tmp_path) if kind == "ulg" else ardupilot(tmp_path)
    path.write_bytes(content(path.read_bytes()))  # type: ignore[operator]
    with pytest.raises(RecordingError, match=rf"{path.name}: {message}") as refusal:
        read_recording(path)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("kind", "package"), [("ulg", "pyulog"), ("bin", "pymavlink")])
def test_a_missing_package_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, package: str
) -> None:
    path = px4(tmp_path) if kind == "ulg" else ardupilot(tmp_path)
    for name in [one for one in sys.modules if one.partition(".")[0] == package]:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(
        RecordingError, match=rf"needs {package}.*; install it with pip install .*(logs|{package})"
    ):
        read_recording(path)
