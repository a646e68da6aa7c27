"""Logs as recorders leave them: parts, clocks that begin again, other encodings, no schema. Each is
said."""

from __future__ import annotations

import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")

from rosbags.rosbag2 import Reader

from homeward.diagnosis import RecordingError, read_recording
from homeward.logs.bags.samples import Samples, restarts, times_s
from tests.logs.bag_writer import Stream, write_bag
from tests.logs.flight_writer import write_dataflash
from tests.logs.test_limits import mcap, record, text

TIME_S = np.arange(0.0, 20.0, 0.2)
KINDS = {"/odom": "nav_msgs/msg/Odometry", "/battery": "sensor_msgs/msg/BatteryState"}


def drive(folder: Path, time_s: np.ndarray = TIME_S) -> Path:
    """A bag of a robot that draws 4 A."""
    odometry = Stream(KINDS["/odom"], time_s, {"twist.twist.linear.x": 1.0})
    battery = Stream(KINDS["/battery"], time_s, {"voltage": 24.0, "current": -4.0})
    return write_bag(folder, "mcap", {"/odom": odometry, "/battery": battery})


def test_a_metadata_of_some_of_the_files_is_said_and_all_are_read(tmp_path: Path) -> None:
    first, second = drive(tmp_path / "a"), drive(tmp_path / "b", TIME_S + 20.0)
    shutil.move(next(second.glob("*.mcap")), first / "run_1.mcap")
    read = read_recording(first)
    assert read.duration_s == pytest.approx(39.8)
    assert "metadata.yaml lists 1 of 2 files: all are read, one by one" in read.notes


def test_of_a_log_whose_clock_begins_again_the_longest_part_is_read(tmp_path: Path) -> None:
    parts = []
    for count in (30, 100):
        at_s = TIME_S[:count]
        messages = [("BAT", at_s, {"Volt": 24.0, "Curr": 4.0}), ("THR", at_s, {"Speed": 1.0})]
        parts.append(write_dataflash(tmp_path / "part.bin", messages).read_bytes())
    (tmp_path / "run.bin").write_bytes(b"".join(parts))
    read = read_recording(tmp_path / "run.bin")
    assert read.duration_s == pytest.approx(19.8)
    assert (
        "its clock begins again: of 2 parts (5.8 s, 19.8 s) the longest is read, and the others are left out"
        in read.notes
    )


def test_stamps_that_go_back_are_replaced_by_the_time_of_receipt() -> None:
    received_ns = (np.arange(1, 101) * 10**8).astype(np.int64)
    stamp_ns = np.where(received_ns > 5 * 10**9, received_ns - 4 * 10**9, received_ns)
    assert restarts(stamp_ns) == 1 and restarts(received_ns) == 0
    good, bad = (Samples(received_ns, stamps, {}) for stamps in (received_ns, stamp_ns))
    times, _, notes = times_s({"/good": good, "/bad": bad}, ())
    np.testing.assert_allclose(times["/bad"], times["/good"])
    assert "stamps of /bad go back, as after a restart" in notes


@pytest.mark.parametrize("schema", ["other", "empty", "none"])
def test_topics_of_an_mcap_file_without_a_schema_of_ros(tmp_path: Path, schema: str) -> None:
    other = record(3, struct.pack("<H", 9) + text("Status") + text("jsonschema") + text("{}"))
    records = [
        other,
        record(4, struct.pack("<HH", 9, 9) + text("/status") + text("json") + bytes(4)),
    ]
    records *= schema == "other"
    with Reader(drive(tmp_path)) as bag:
        numbers = {name: number for number, name in enumerate(KINDS, start=1)}
        for connection in bag.connections:
            number = numbers[connection.topic]
            definition = text("ros2msg") + text("" if schema == "empty" else connection.msgdef.data)
            if schema != "none":
                records.append(
                    record(3, struct.pack("<H", number) + text(connection.msgtype) + definition)
                )
            of_schema = 0 if schema == "none" else number
            records.append(
                record(
                    4,
                    struct.pack("<HH", number, of_schema)
                    + text(connection.topic)
                    + text("cdr")
                    + bytes(4),
                )
            )
        for connection, at_ns, content in bag.messages():
            records.append(
                record(
                    5, struct.pack("<HIQQ", numbers[connection.topic], 0, at_ns, at_ns) + content
                )
            )
    path = tmp_path / "run.mcap"
    path.write_bytes(mcap(*records))
    if schema == "none":
        with pytest.raises(RecordingError, match="without a schema"):
            read_recording(path)
        fields = {
            "/odom": 'speed_mps = "twist.twist.linear.x"',
            "/battery": 'voltage_v = "voltage"\ncurrent_a = "current"',
        }
        entries = (
            f'[[topics]]\nname = "{name}"\ntype = "{KINDS[name]}"\n{text_}\n'
            for name, text_ in fields.items()
        )
        (tmp_path / "map.toml").write_text("".join(entries))
        read = read_recording(path, tmp_path / "map.toml")
    else:
        read = read_recording(path)
    np.testing.assert_allclose(read.channels["current_a"], 4.0)
    said = "run.mcap has topics with schemas in jsonschema, which are left out"
    assert (said in read.notes) == (schema == "other")
    assert not any("damaged" in note for note in read.notes)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("a.mcap.zstd", "zstd -d"), ("a.tlog", "mavlogdump"), ("a.kml", "gpsbabel"), ("a.tcx", "gpsbabel"),
        ("a.geojson", "gpsbabel"), ("a.gpx", "homeward routes"), ("a.xlsx", "save it as CSV"), ("a.zip", "unpack it"),
    ],
)  # fmt: skip
def test_what_is_no_recording_is_refused_with_the_remedy(
    tmp_path: Path, name: str, remedy: str
) -> None:
    (tmp_path / name).write_bytes(b"content")
    with pytest.raises(RecordingError, match=remedy):
        read_recording(tmp_path / name)
