"""Bags are read as tables are: the channels that were driven come out, and what cannot be read says
why."""

from __future__ import annotations

import dataclasses
import shutil
import sqlite3
import sys
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rosbags")

from rosbags.highlevel import AnyReader

import diagnose
from homeward import load_robot
from homeward.diagnosis import Analysis, Recording, RecordingError, read_recording
from homeward.diagnosis.read.signals import signals
from homeward.logs.bags import clock
from homeward.logs.bags.messages import WrongField, getter, shipped_definitions
from homeward.logs.bags.salvage import DamagedBag
from homeward.logs.bags.topics import load_topics, shipped_topics
from homeward.logs.limits import Allowance
from tests.logs.bag_writer import KINDS, START_S, Array, Stream, write_bag

DEFINITIONS = {**shipped_definitions()[0]}
OLDER = shipped_definitions()[1]
SECONDS = 60.0
FAST_S, SLOW_S = np.arange(0.0, SECONDS, 0.04), np.arange(0.4, SECONDS, 0.5)
ODOMETRY, BATTERY = "nav_msgs/msg/Odometry", "sensor_msgs/msg/BatteryState"
IMU, TWIST, JOINTS = (
    "sensor_msgs/msg/Imu",
    "geometry_msgs/msg/TwistStamped",
    "sensor_msgs/msg/JointState",
)
STATUS, POWER = "husky_msgs/msg/HuskyStatus", "clearpath_platform_msgs/msg/Power"
JACKAL_STATUS = "jackal_msgs/msg/Status"
JACKAL_STATUS_FIELDS = "std_msgs/Header header\nfloat32 measured_battery\nfloat32 total_current\n"


def speed(time_s: Array) -> Array:
    return np.asarray(0.5 + 0.4 * np.sin(time_s / 3.0))


def yaw_rate(time_s: Array) -> Array:
    return np.asarray(0.3 * np.sin(time_s / 2.0))


def slope(time_s: Array) -> Array:
    return np.asarray(0.08 * np.sin(time_s / 9.0))


def power(time_s: Array) -> Array:
    return np.asarray(80.0 + 100.0 * speed(time_s))


def odometry(time_s: Array = FAST_S) -> Stream:
    return Stream(
        ODOMETRY,
        time_s,
        {"twist.twist.linear.x": speed(time_s), "twist.twist.angular.z": yaw_rate(time_s)},
    )


def imu(time_s: Array = FAST_S) -> Stream:
    half = -0.5 * slope(time_s)  # nose up is a negative turn about y (REP 103)
    return Stream(IMU, time_s, {"orientation.y": np.sin(half), "orientation.w": np.cos(half)})


def battery(time_s: Array = SLOW_S, sign: float = -1.0, late_s: float = 0.0) -> Stream:
    current = sign * power(time_s - late_s) / 24.0
    return Stream(BATTERY, time_s, {"voltage": 24.0, "current": current, "percentage": 0.8})


def status(time_s: Array = SLOW_S) -> Stream:
    fields = {
        "battery_voltage": 24.0,
        "mcu_and_user_port_current": 2.0,
        "left_driver_current": 1.0,
        "right_driver_current": power(time_s) / 24.0 - 3.0,
    }
    return Stream(STATUS, time_s, fields, definition=DEFINITIONS[STATUS])


def clearpath_power(
    time_s: Array, currents: list[Array], definition: str = DEFINITIONS[POWER]
) -> Stream:
    rows = np.empty(len(time_s), dtype=object)
    rows[:] = [np.array(row, dtype=np.float32) for row in np.column_stack(currents)]
    voltages = np.array([24.0, 5.0, 12.0], dtype=np.float32)
    return Stream(
        POWER, time_s, {"measured_voltages": voltages, "measured_currents": rows}, definition
    )


def joints(names: list[str], radius_m: float, time_s: Array = FAST_S) -> Stream:
    rows = np.empty(len(time_s), dtype=object)
    rows[:] = [np.full(len(names), v / radius_m) for v in speed(time_s)]
    return Stream(JOINTS, time_s, {"name": names, "velocity": rows})


HUSKY = {"/status": status(), "/odometry/filtered": odometry(), "/imu/data": imu()}


def check(recording: Recording, tolerance: float = 0.02) -> None:
    """The drive above comes out, on the clock of the power."""
    channels = recording.channels
    time_s = channels["time_s"] + SLOW_S[0]
    np.testing.assert_allclose(
        channels["voltage_v"] * channels["current_a"], power(time_s), rtol=1e-5
    )
    np.testing.assert_allclose(channels["speed_mps"], speed(time_s), atol=tolerance)
    if "yaw_rate_radps" in channels:
        np.testing.assert_allclose(channels["yaw_rate_radps"], yaw_rate(time_s), atol=tolerance)


@pytest.mark.parametrize(
    ("form", "compression"),
    [("ros1", ""), ("ros1", "lz4"), ("ros1", "bz2"), ("sqlite3", ""), ("sqlite3", "message"), ("sqlite3", "file"),
     ("mcap", ""), ("mcap", "storage")],
)  # fmt: skip
def test_every_format_gives_the_drive_back(tmp_path: Path, form: str, compression: str) -> None:
    recording = read_recording(write_bag(tmp_path, form, HUSKY, compression))
    check(recording)
    assert len(recording) == len(SLOW_S)
    np.testing.assert_allclose(
        recording.channels["grade_rad"], slope(recording.channels["time_s"] + 0.4), atol=5e-3
    )
    assert recording.notes[0].startswith(
        "topic mapping husky: power from /status, motion from /odometry/filtered"
    )
    assert len(recording.sha256) == 64


def test_a_file_of_a_ros_2_bag_is_enough(tmp_path: Path) -> None:
    for form, suffix in (("sqlite3", "db3"), ("mcap", "mcap")):
        bag = write_bag(tmp_path / form, form, HUSKY)
        check(read_recording(bag / f"run.{suffix}"))


LEGS = ["front_left_wheel", "rear_left_wheel", "front_right_wheel", "rear_right_wheel"]
ROBOTS: dict[str, tuple[str, dict[str, Stream], str, str]] = {
    "husky, ROS 1": ("ros1", HUSKY | {"/joint_states": joints(LEGS, 0.1651)}, "husky", "/status"),
    "husky, ROS 2": (
        "mcap",
        {
            "/a200_0001/platform/mcu/status/power": clearpath_power(
                SLOW_S, [power(SLOW_S) / 24.0 - 5.0, np.full(len(SLOW_S), 3.0), np.full(len(SLOW_S), 2.0)]
            ),
            "/a200_0001/platform/odom/filtered": odometry(),
            "/a200_0001/platform/joint_states": joints([f"{leg}_joint" for leg in LEGS], 0.1651),
            "/a200_0001/sensors/imu_0/data": imu(),
        },
        "husky",
        "/a200_0001/platform/mcu/status/power",
    ),
    "jackal, ROS 1": (
        "ros1",
        {
            "/status": Stream(
                JACKAL_STATUS, SLOW_S, {"measured_battery": 24.0, "total_current": power(SLOW_S) / 24.0},
                JACKAL_STATUS_FIELDS,
            ),
            "/odometry/filtered": odometry(),
            "/joint_states": joints(LEGS, 0.098),
        },
        "jackal",
        "/status",
    ),
    "jackal, ROS 2": (
        "sqlite3",
        {
            "/j100_0001/platform/mcu/status/power": clearpath_power(
                SLOW_S, [power(SLOW_S) / 24.0, np.full(len(SLOW_S), 3.0), np.full(len(SLOW_S), 2.0)]
            ),
            "/j100_0001/platform/odom": odometry(),
            "/j100_0001/platform/joint_states": joints([f"{leg}_joint" for leg in LEGS], 0.098),
        },
        "jackal",
        "/j100_0001/platform/mcu/status/power",
    ),
    "turtlebot 4": (
        "mcap",
        {
            "/battery_state": battery(), "/odom": odometry(), "/imu": imu(),
            "/joint_states": joints(["left_wheel_joint", "right_wheel_joint"], 0.03575),
        },
        "turtlebot",
        "/battery_state",
    ),
    "any robot": (
        "sqlite3",
        {
            "/bms": battery(),
            "/vehicle/twist": Stream(
                TWIST, FAST_S, {"twist.linear.x": speed(FAST_S), "twist.angular.z": yaw_rate(FAST_S)}
            ),
            "/cmd_vel": Stream(TWIST, np.arange(0.0, SECONDS, 0.03), {"twist.linear.x": 9.0}),
        },
        "any_robot",
        "/bms",
    ),
}  # fmt: skip


@pytest.mark.parametrize("robot", ROBOTS)
def test_stock_robots_need_no_mapping(tmp_path: Path, robot: str) -> None:
    form, streams, mapping, source = ROBOTS[robot]
    recording = read_recording(write_bag(tmp_path, form, streams))
    check(recording)
    assert recording.notes[0].startswith(
        f"topic mapping {mapping}: power from {source}, motion from"
    )
    if any("joint_states" in name for name in streams):
        for side in ("wheel_left_mps", "wheel_right_mps"):
            np.testing.assert_allclose(
                recording.channels[side], speed(recording.channels["time_s"] + SLOW_S[0]), atol=0.02
            )


def test_a_kobuki_gives_motor_currents(tmp_path: Path) -> None:
    kind = "kobuki_ros_interfaces/msg/SensorState"
    rows = np.empty(len(SLOW_S), dtype=object)
    rows[:] = [np.array([50, 60], dtype=np.uint8) for _ in SLOW_S]
    core = Stream(kind, SLOW_S, {"current": rows, "battery": 160}, DEFINITIONS[kind])
    recording = read_recording(
        write_bag(tmp_path, "mcap", {"/sensors/core": core, "/odom": odometry()})
    )
    assert set(recording.channels["motor_left_a"]) == {0.5}
    assert set(recording.channels["motor_right_a"]) == {0.6}


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_discharge_is_positive_whatever_the_driver_thinks(tmp_path: Path, sign: float) -> None:
    streams = {"/platform/bms/state": battery(sign=sign), "/platform/odom/filtered": odometry()}
    recording = read_recording(write_bag(tmp_path, "mcap", streams))
    check(recording)
    assert any("against the definition of BatteryState" in note for note in recording.notes) == (
        sign > 0.0
    )


def test_charging_at_the_dock_does_not_turn_the_sign(tmp_path: Path) -> None:
    """Two thirds of the time the robot stands and charges."""
    docked = SLOW_S < 40.0
    current = np.where(docked, 2.0, -power(SLOW_S) / 24.0)
    drives = Stream(
        ODOMETRY, FAST_S, {"twist.twist.linear.x": np.where(FAST_S < 40.0, 0.0, speed(FAST_S))}
    )
    bms = Stream(BATTERY, SLOW_S, {"voltage": 24.0, "current": current})
    recording = read_recording(
        write_bag(tmp_path, "mcap", {"/battery_state": bms, "/odom": drives})
    )
    assert np.all(recording.channels["current_a"][~docked] > 0.0)


def accelerometer(covariance: float = -1.0) -> Stream:
    """Specific force of a robot that speeds up and slows down on a slope."""
    forward = np.gradient(speed(FAST_S), FAST_S) + 9.80665 * np.sin(slope(FAST_S))
    noise = 0.3 * np.random.default_rng(2).standard_normal(len(FAST_S))
    unknown = np.full(9, 0.0)
    unknown[0] = covariance
    return Stream(IMU, FAST_S, {"linear_acceleration.x": forward + noise, "orientation_covariance": unknown,
                                "orientation.w": 1.0})  # fmt: skip


def tilted_odometry() -> Stream:
    half = -0.5 * slope(FAST_S)
    values = {
        **odometry().values,
        "pose.pose.orientation.y": np.sin(half),
        "pose.pose.orientation.w": np.cos(half),
    }
    return Stream(ODOMETRY, FAST_S, values)


GRADES: dict[str, tuple[dict[str, Stream], str]] = {
    "orientation": ({"/odom": odometry(), "/imu": imu()}, "grade from the orientation of /imu"),
    "acceleration": (
        {"/odom": odometry(), "/imu": accelerometer()},
        "grade from the acceleration of /imu",
    ),
    "odometry": ({"/odom": tilted_odometry()}, "grade from the orientation of /odom"),
}


@pytest.mark.parametrize("method", GRADES)
def test_the_grade_comes_from_what_there_is(tmp_path: Path, method: str) -> None:
    streams, said = GRADES[method]
    recording = read_recording(
        write_bag(tmp_path, "mcap", {"/bms": battery(), **streams}), "any_robot"
    )
    inner = slice(4, -4)  # averages end at the ends
    expected = slope(recording.channels["time_s"] + SLOW_S[0])
    np.testing.assert_allclose(recording.channels["grade_rad"][inner], expected[inner], atol=0.012)
    assert any(note.startswith(said) for note in recording.notes)


@pytest.mark.parametrize(
    ("given", "taken"), [(0.8, 0.8), (80.0, 0.8), (np.nan, None), (-300.0, None)]
)
def test_a_state_of_charge_that_is_none_is_left_out(
    tmp_path: Path, given: float, taken: float | None
) -> None:
    pack = battery()
    streams = {
        "/battery_state": dataclasses.replace(pack, values={**pack.values, "percentage": given}),
        "/odom": odometry(),
    }
    recording = read_recording(write_bag(tmp_path, "mcap", streams))
    check(recording)
    if taken is None:
        assert "soc" not in recording.channels
    else:
        np.testing.assert_allclose(recording.channels["soc"], taken, rtol=1e-6)


def test_a_level_robot_has_no_grade(tmp_path: Path) -> None:
    recording = read_recording(
        write_bag(tmp_path, "mcap", {"/battery_state": battery(), "/odom": odometry()})
    )
    assert "grade_rad" not in recording.channels


def test_the_heading_comes_from_the_odometry(tmp_path: Path) -> None:
    turned = FAST_S / 5.0  # nearly twice round
    values = {
        **odometry().values,
        "pose.pose.orientation.z": np.sin(turned / 2),
        "pose.pose.orientation.w": np.cos(turned / 2),
    }
    streams = {"/bms": battery(), "/odom": Stream(ODOMETRY, FAST_S, values)}
    recording = read_recording(write_bag(tmp_path, "mcap", streams))
    heading = recording.channels["heading_rad"]
    np.testing.assert_allclose(heading - heading[0], recording.channels["time_s"] / 5.0, atol=0.01)


def test_stamps_say_when_and_not_the_time_of_receipt(tmp_path: Path) -> None:
    late = dataclasses.replace(battery(), received_late_s=0.8)
    check(
        read_recording(write_bag(tmp_path, "mcap", {"/battery_state": late, "/odom": odometry()}))
    )


@pytest.mark.parametrize("change", [{"stamped": False}, {"clock_s": 3600.0}])
def test_a_topic_without_a_stamp_of_the_clock_is_placed_by_receipt(
    tmp_path: Path, change: dict[str, Any]
) -> None:
    odd = dataclasses.replace(battery(), **change)
    streams = {"/battery_state": odd, "/odom": odometry(), "/imu": imu()}
    recording = read_recording(write_bag(tmp_path, "mcap", streams))
    check(recording)
    assert (
        "/battery_state: placed by the time of receipt, as they have no stamp of the same clock"
        in recording.notes
    )


def test_a_mapping_may_ask_for_receipt(tmp_path: Path) -> None:
    mapping = tmp_path / "map.toml"
    mapping.write_text(
        '[[topics]]\nname = "/pack"\nstamp = "receive"\nvoltage_v = { field = "voltage", factor = 2.0 }\n'
        'current_a = "current"\n[[topics]]\nname = "/wheels"\nspeed_mps = "twist.twist.linear.x"\n'
    )
    shifted = dataclasses.replace(battery(sign=0.5), clock_s=2.0)
    recording = read_recording(
        write_bag(tmp_path, "mcap", {"/pack": shifted, "/wheels": odometry()}), mapping
    )
    check(recording)


def storage(bag: Path) -> Path:
    """The file that holds the messages."""
    return (
        bag
        if bag.is_file()
        else next(one for one in bag.iterdir() if one.suffix in (".mcap", ".db3"))
    )


@pytest.mark.parametrize("share", [0.97, 0.5])
@pytest.mark.parametrize(
    ("form", "compression"),
    [("ros1", ""), ("ros1", "bz2"), ("ros1", "lz4"), ("mcap", ""), ("mcap", "storage")],
)
def test_a_cut_bag_gives_what_is_left(
    tmp_path: Path, form: str, compression: str, share: float
) -> None:
    bag = write_bag(tmp_path, form, HUSKY, compression)
    file = storage(bag)
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    recording = read_recording(bag)
    check(recording)
    assert recording.duration_s < SECONDS
    assert recording.duration_s > (0.5 if compression else 0.85) * share * SECONDS - 2.0
    (note,) = (note for note in recording.notes if "cut off" in note)
    assert note.startswith(f"{file.name} is cut off or damaged (") and note.endswith(
        " messages could be read"
    )


@pytest.mark.parametrize("form", ["ros1", "mcap"])
def test_messages_of_a_cut_bag_were_received_when_the_bag_says(tmp_path: Path, form: str) -> None:
    bag = write_bag(tmp_path, form, HUSKY)
    file = storage(bag)
    with AnyReader([bag]) as reader:
        whole = {time_ns for _, time_ns, _ in reader.messages()}
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    damaged = DamagedBag(file, Allowance(file.stat().st_size))
    times_ns = [time_ns for _, time_ns, _ in damaged.messages(damaged.connections)]
    assert len(times_ns) > 100
    assert set(times_ns) <= whole


def test_a_cut_database_is_for_sqlite_to_rebuild(tmp_path: Path) -> None:
    bag = write_bag(tmp_path, "sqlite3", HUSKY)
    file = storage(bag)
    file.write_bytes(file.read_bytes()[: int(0.7 * file.stat().st_size)])
    with pytest.raises(RecordingError) as caught:
        read_recording(bag)
    assert (
        f'rebuild it with sqlite3 {file.name} ".recover" | sqlite3 whole.db3 and read whole.db3'
        in str(caught.value)
    )


@pytest.mark.parametrize("form", ["sqlite3", "mcap"])
def test_a_bag_whose_recorder_was_killed_is_read(tmp_path: Path, form: str) -> None:
    bag = write_bag(tmp_path, form, HUSKY)
    (bag / "metadata.yaml").unlink()
    recording = read_recording(bag)
    check(recording)
    assert (
        "has no metadata.yaml: the recorder was stopped before it ended the bag" in recording.notes
    )


def test_an_active_bag_is_read(tmp_path: Path) -> None:
    bag = write_bag(tmp_path, "ros1", HUSKY)
    active = bag.rename(tmp_path / "run.bag.active")
    content = bytearray(active.read_bytes())
    content[13:80] = content[13:80].replace(
        b"index_pos=" + content[content.index(b"index_pos=") + 10 :][:8], b"index_pos=" + bytes(8)
    )
    active.write_bytes(content)
    check(read_recording(active))


def test_a_hole_in_the_middle_ends_the_recording_there(tmp_path: Path) -> None:
    bag = write_bag(tmp_path, "ros1", HUSKY)
    content = bytearray(bag.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 2000] = bytes(2000)
    bag.write_bytes(content)
    recording = read_recording(bag)
    check(recording)
    assert 20.0 < recording.duration_s < 40.0
    (note,) = (note for note in recording.notes if "is damaged" in note)
    assert note.startswith("run.bag is damaged (") and note.endswith(" s could be read")


@given(
    st.binary(max_size=300), st.sampled_from([".bag", ".mcap", ".db3", ".active"]), st.booleans()
)
def test_junk_never_raises_anything_else(
    tmp_path_factory: pytest.TempPathFactory, junk: bytes, suffix: str, head: bool
) -> None:
    magic = {".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\x00"}.get(
        suffix, b"#ROSBAG V2.0\n"
    )
    path = tmp_path_factory.mktemp("junk") / f"run{suffix}"
    path.write_bytes((magic if head else b"") + junk)
    with pytest.raises(RecordingError) as caught:
        read_recording(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def without_definitions(bag: Path) -> Path:
    """Make a bag as ROS 2 Humble wrote it."""
    with sqlite3.connect(storage(bag)) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("DROP TABLE schema")
    database.close()
    return bag


@pytest.mark.parametrize("layout", [DEFINITIONS, OLDER], ids=["newest", "older"])
def test_a_bag_without_definitions_takes_those_that_ship(
    tmp_path: Path, layout: dict[str, str]
) -> None:
    assert DEFINITIONS[POWER] != OLDER[POWER]
    supply = clearpath_power(SLOW_S, [power(SLOW_S) / 24.0, SLOW_S, SLOW_S], layout[POWER])
    streams = {"/j100_1/platform/mcu/status/power": supply, "/j100_1/platform/odom": odometry()}
    check(read_recording(without_definitions(write_bag(tmp_path, "sqlite3", streams))))


def custom(kind: str) -> Stream:
    return Stream(kind, SLOW_S, {"watts": power(SLOW_S)}, "std_msgs/Header header\nfloat64 watts\n")


def test_an_own_message_type_is_read_by_the_definition_in_the_bag(tmp_path: Path) -> None:
    mapping = tmp_path / "map.toml"
    mapping.write_text('[[topics]]\nname = "/meter"\npower_w = "watts"\n[[topics]]\nname = "/odom"\n'
                       'speed_mps = "twist.twist.linear.x"\n')  # fmt: skip
    streams = {"/meter": custom("my_msgs/msg/Meter"), "/odom": odometry()}
    for form in KINDS:
        recording = read_recording(write_bag(tmp_path / form, form, streams), mapping)
        np.testing.assert_allclose(
            recording.channels["power_w"], power(recording.channels["time_s"] + SLOW_S[0])
        )
    with pytest.raises(
        RecordingError, match=r"/meter is left out: my_msgs/msg/Meter: the bag has no definition"
    ):
        read_recording(without_definitions(tmp_path / "sqlite3" / "run"), mapping)


REFUSED: dict[str, tuple[dict[str, Stream], str]] = {
    "no power": (
        {"/odom": odometry()},
        r"has no power by the topic mapping any_robot; its topics: /odom \(nav_msgs",
    ),
    "no motion": ({"/battery_state": battery()}, "has no motion by the topic mapping"),
    "nothing known": (
        {"/scan": Stream("std_msgs/msg/Header", SLOW_S, {}, stamped=False)},
        "has no motion and no power",
    ),
    "current not measured": (  # as on a stock TurtleBot 3
        {"/battery_state": battery(sign=0.0), "/odom": odometry(), "/imu": imu()},
        "/battery_state gives current_a as 0 or not at all",
    ),
    "not at the same time": (
        {"/battery_state": battery(), "/odom": odometry(FAST_S + 100.0)},
        r"power \(/battery_state\) and motion \(/odom\) were not recorded at the same time",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_a_bag_lacks_is_said_in_one_line(tmp_path: Path, case: str) -> None:
    streams, says = REFUSED[case]
    with pytest.raises(RecordingError, match=says) as caught:
        read_recording(write_bag(tmp_path, "mcap", streams))
    assert "\n" not in str(caught.value) and "--columns" in str(caught.value) + "--columns" * (
        "clocks" in str(caught.value)
    )


def test_a_field_that_is_not_there_names_those_that_are(tmp_path: Path) -> None:
    mapping = tmp_path / "map.toml"
    mapping.write_text('[[topics]]\nname = "/odom"\nspeed_mps = "twist.linear.x"\n')
    with pytest.raises(
        RecordingError,
        match=r"/odom \(nav_msgs/msg/Odometry\): no field 'linear' of 'twist.linear.x'",
    ):
        read_recording(write_bag(tmp_path, "mcap", {"/odom": odometry()}), mapping)


WRONG: dict[str, str] = {
    "x = 1\n": "x is not a known entry",
    "[columns]\ntime_s = 't'\n": "for a bag, give a mapping of topics",
    "topics = 3\n": "needs at least one table",
    "[[topics]]\nspeed_mps = 'a'\n": "needs the name of a topic",
    "[[topics]]\nname = '/a'\nspeed = 'a'\n": "speed is not a channel",
    "[[topics]]\nname = '/a'\nspeed_mps = 3\n": "is not understood",
    "[[topics]]\nname = '/a'\nspeed_mps = 'a..b'\n": "is not a path",
    "[[topics]]\nname = '/a'\nspeed_mps = { field = 'a', factor = 'b' }\n": "is not a finite number",
    "[[topics]]\nname = '/a'\nspeed_mps = { fields = ['a', 'b'], factors = [1] }\n": "one field and one factor each",
    "[[topics]]\nname = '/a'\nstamp = 'now'\n": "choose from header, receive",
    "[[topics]]\nname = '/a'\norientation = 3\n": "is not the path of a field",
    "[[topics\n": "not a readable TOML file",
}


@pytest.mark.parametrize(("text", "says"), WRONG.items())
def test_wrong_mappings(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(RecordingError, match=says) as caught:
        load_topics(tmp_path / "map.toml")
    assert "\n" not in str(caught.value)


def test_unknown_mappings_name_those_that_ship() -> None:
    with pytest.raises(RecordingError, match="any_robot, ardupilot, husky, jackal, px4, turtlebot"):
        load_topics("roomba")
    assert all(load_topics(name).topics for name in shipped_topics())


def test_a_path_that_leads_nowhere_is_missing_and_one_to_no_number_is_wrong() -> None:
    class Message:
        values = (1.0, 2.0)
        name = ("left",)
        text = "far"
        number = 1.0

    assert np.isnan(getter("values[2]")(Message())) and np.isnan(getter("values[right]")(Message()))
    with pytest.raises(WrongField, match="not a number but str"):
        getter("text")(Message())
    for path in ("number[0]", "number[left]", "number[right]", "text[0]"):
        with pytest.raises(WrongField, match=r"is not of a list but of (float|str)"):
            getter(path)(Message())


def test_two_connections_of_one_topic_are_one(tmp_path: Path) -> None:
    """A bag whose files were recorded one after the other, without metadata."""
    first, second = tmp_path / "first", tmp_path / "second"
    for folder, at_s in ((first, slice(None, 750)), (second, slice(750, None))):
        half = (FAST_S[at_s][0] <= SLOW_S) & (FAST_S[at_s][-1] >= SLOW_S)
        write_bag(
            folder,
            "mcap",
            {"/battery_state": battery(SLOW_S[half]), "/odom": odometry(FAST_S[at_s])},
        )
    bag = tmp_path / "both"
    bag.mkdir()
    for index, folder in enumerate((first, second)):
        shutil.copy(folder / "run" / "run.mcap", bag / f"both_{index}.mcap")
    recording = read_recording(bag)
    check(recording)
    assert len(recording) == pytest.approx(len(SLOW_S), abs=2)


def test_nothing_is_carried_across_a_gap() -> None:
    ticks = np.arange(0.0, 20.0, 0.5)
    time_s = np.concatenate((np.arange(0.0, 5.0, 0.1), np.arange(15.0, 20.0, 0.1)))
    values = clock.on_clock(time_s, time_s, ticks)
    inside = (ticks > 4.9) & (ticks < 15.1)
    assert np.isnan(values[inside]).all() and np.isfinite(values[~inside & (ticks < 19.5)]).all()
    np.testing.assert_allclose(values[2:9], ticks[2:9], atol=0.06)


def test_a_recording_of_a_bag_knows_when_it_began(tmp_path: Path) -> None:
    began = {"/status": HUSKY["/status"], "/odometry/filtered": HUSKY["/odometry/filtered"]}
    recording = read_recording(write_bag(tmp_path, "mcap", began))
    first_s = max(float(stream.time_s[0]) for stream in began.values())
    assert recording.start_s == pytest.approx(START_S + first_s, abs=0.2)
    assert recording.channels["time_s"][0] == 0.0
    assert signals(recording, load_robot("husky")).start_s == recording.start_s


def test_a_missing_package_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_bag(tmp_path, "ros1", HUSKY)
    monkeypatch.setitem(sys.modules, "homeward.logs.bags.assemble", None)
    with pytest.raises(
        RecordingError, match=r"a bag needs rosbags; install it with pip install 'homeward\[logs\]'"
    ):
        read_recording(bag)


def test_a_folder_that_is_no_bag_is_refused_as_before(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("none")
    with pytest.raises(RecordingError, match="is a folder; give the files of the runs in it"):
        read_recording(tmp_path)


def test_a_bag_is_diagnosed_as_its_table_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = pd.read_csv(Path(str(files("homeward") / "recordings" / "synthetic_husky.csv.gz")))
    time_s = table["time_s"].to_numpy()
    pitch = -0.5 * table["grade_rad"].to_numpy()
    supply = {
        "battery_voltage": 24.0,
        "mcu_and_user_port_current": 1.5,
        "left_driver_current": table["power_w"].to_numpy() / 24.0 - 2.5,
        "right_driver_current": 1.0,
    }
    streams = {
        "/status": Stream(STATUS, time_s, supply, DEFINITIONS[STATUS]),
        "/odometry/filtered": Stream(ODOMETRY, time_s, {
            "twist.twist.linear.x": table["speed_mps"].to_numpy(),
            "twist.twist.angular.z": table["yaw_rate_radps"].to_numpy(),
        }),
        "/imu/data": Stream(IMU, time_s, {"orientation.y": np.sin(pitch), "orientation.w": np.cos(pitch)}),
    }  # fmt: skip
    bag = write_bag(tmp_path, "ros1", streams)
    analysis = diagnose.main(diagnose.Args(runs=(bag,), robot="husky", out=tmp_path / "out"))
    assert isinstance(analysis, Analysis)
    read = read_recording(bag)
    for name in ("time_s", "speed_mps", "yaw_rate_radps"):
        np.testing.assert_allclose(read.channels[name], table[name], atol=1e-6)
    np.testing.assert_allclose(
        read.channels["voltage_v"] * read.channels["current_a"], table["power_w"], rtol=1e-9
    )
    assert analysis.diagnosis.verdict == "missing_physics"
    # the rate of sensing, which no bag has, leaves more than that
    turning = analysis.diagnosis.missing_physics[0]
    assert turning.effect == "turning"
    assert turning.parameters["scrub"].value == pytest.approx(0.3, abs=0.04)  # as it was made
    said = capsys.readouterr().err
    assert (
        "run.bag: topic mapping husky: power from /status, motion from /odometry/filtered" in said
    )
