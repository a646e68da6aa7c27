"""The node for a robot's own Python, against a stand-in for rclpy, with the cases that the DDS
listener has."""

from __future__ import annotations

import ast
import json
import math
import os
import random
import re
import signal
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

pytest.importorskip("rosbags", reason="needs the extra logs")

from ruamel.yaml import YAML  # rosbags brings it

from homeward.companion import Companion
from homeward.logs.bags.elements import elements_reader
from homeward.logs.bags.messages import getter
from homeward.logs.bags.topics import load_topics, shipped_topics
from tests.ros2.stand_in import Graph, Node, class_of

BATTERY, ODOMETRY, IMU = (
    "sensor_msgs/msg/BatteryState",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/Imu",
)
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
LONGEST_S = 60.0
PERIOD_S = 0.05
STALE = b"\x03"
FAKE = """
import json, sys, time
print("fake started", file=sys.stderr, flush=True)
{body}
"""
SPEAKS = """
for line in sys.stdin:
    said = json.loads(line)
    if "topics" in said:
        fields = ["twist.twist.linear.x"]
        wanted = {name: {"type": kind, "fields": fields} for name, kind in said["topics"].items() if name == "/odom"}
        print(json.dumps({"subscribe": wanted}), flush=True)
    else:
        for name in ("can_reach_home", "turn_now"):
            print(json.dumps({"publish": f"/homeward/{name}", "type": "std_msgs/msg/Bool", "content": {"data": True}}))
        energy = {"publish": "/homeward/energy_to_home", "type": "std_msgs/msg/Float64", "content": {"data": 3}}
        print(json.dumps(energy))
        state = {"percentage": 0.5, "voltage": float("nan"), "header": {"stamp": {"sec": 5, "nanosec": 6}}}
        print(json.dumps({"publish": "/homeward/battery", "type": "sensor_msgs/msg/BatteryState", "content": state}))
        sys.stdout.flush()
"""


@pytest.fixture
def graph() -> Graph:
    return Graph()


def command(path: Path, script: str, *options: str, pythonpath: str = "") -> str:
    """A command of one word that runs a script with this Python."""
    path.write_text(
        f'#!/bin/sh\nPYTHONPATH={pythonpath} exec {sys.executable} {script} {" ".join(options)} "$@"\n'
    )
    path.chmod(0o755)
    return str(path)


def fake(folder: Path, body: str) -> str:
    """A stand-in for homeward that does this."""
    (folder / "fake.py").write_text(FAKE.replace("{body}", body))
    return command(folder / "homeward", str(folder / "fake.py"))


class Robot:
    """Publishes battery, odometry and IMU; drives east at 1 m/s from a place."""

    def __init__(self, graph: Graph, x_m: float) -> None:
        self._battery, self._odometry, self._imu = (
            graph.publisher(kind, topic)
            for kind, topic in ((BATTERY, "/battery"), (ODOMETRY, "/odom"), (IMU, "/imu"))
        )
        self.x_m, self.began_s, self.jump_s = x_m, time.monotonic(), 0.0

    def publish(self) -> None:
        since_s = time.monotonic() - self.began_s
        stamp_s = time.time() + self.jump_s
        stamp = class_of("builtin_interfaces/msg/Time")(
            sec=int(stamp_s), nanosec=int(stamp_s % 1.0 * 1e9)
        )
        header = class_of("std_msgs/msg/Header")(stamp=stamp, frame_id="odom")
        odometry: Any = class_of(ODOMETRY)(header=header)
        odometry.pose.pose.position.x, odometry.twist.twist.linear.x = self.x_m + since_s, 1.0
        odometry.pose.pose.orientation.w = 1.0
        imu: Any = class_of(IMU)(header=header)
        imu.orientation.w = 1.0
        self._battery.publish(
            class_of(BATTERY)(header=header, voltage=25.2, current=-6.0, percentage=0.9)
        )
        self._odometry.publish(odometry)
        self._imu.publish(imu)

    def die(self) -> None:
        for publisher in (self._battery, self._odometry, self._imu):
            publisher.die()


class Bench:
    """A bridge on a graph, and what others hear of it."""

    def __init__(self, package: Any, graph: Graph, homeward: str, **parameters: Any) -> None:
        self.node = Node(graph, {"homeward": homeward, "robot": "husky", **parameters})
        self.bridge = package.node.Bridge(self.node)
        self.last: dict[str, Any] = {}
        self.statuses: dict[str, Any] = {}
        for name, kind in package.node.INTERFACE["published"].items():
            graph.hear(kind, name, partial(self.see, name))

    def see(self, name: str, message: Any) -> None:
        self.last[name] = message
        if name == "/diagnostics":
            self.statuses |= {status.name: status for status in message.status}

    def until(
        self, reached: Callable[[], object], publish: Callable[[], object] = lambda: None
    ) -> None:
        end_s = time.monotonic() + LONGEST_S
        while not reached():
            assert time.monotonic() < end_s, (self.node.logger.lines[-20:], self.last.keys())
            publish()
            self.bridge.step()
            time.sleep(PERIOD_S)

    def values(self) -> dict[str, str]:
        """Values of homeward's diagnostics; warnings joined."""
        status = self.statuses.get("homeward: way home")
        pairs = [] if status is None else [(pair.key, pair.value) for pair in status.values]
        return dict(pairs) | {
            "warnings": "; ".join(value for key, value in pairs if key == "warning")
        }

    def way_m(self) -> float:
        return float(self.values().get("way_home_m", "nan"))


@pytest.fixture
def quick(root: Path, tmp_path: Path) -> str:
    """The command `homeward` with shorter waits."""
    return command(
        tmp_path / "homeward",
        str(root / "tests" / "ros2" / "quick_homeward.py"),
        pythonpath=str(root),
    )


@pytest.fixture
def bench(package: Any, graph: Graph, quick: str) -> Iterator[Bench]:
    # Compiled here, so that no kernel is waited for there: a few minutes on a slow machine.
    Companion("husky", home="here").update(0.0, position=(0.0, 0.0), speed_mps=0.0)
    made = Bench(package, graph, quick, restart_s=0.1, silent_s=2.0)
    try:
        yield made
    finally:
        made.bridge.end()


def test_lost_messages_a_clock_that_jumps_a_dead_publisher_and_restarts(
    bench: Bench, graph: Graph
) -> None:
    """As `tests/watch/online/test_node.py` has them by DDS, and homeward killed in the end."""
    robot, rng = Robot(graph, 500.0), random.Random(0)

    def publish_some() -> None:
        if rng.random() >= 0.3:
            robot.publish()

    bench.until(lambda: bench.way_m() > 1.0, publish_some)
    assert bench.last["/homeward/can_reach_home"].data and not bench.last["/homeward/turn_now"].data
    assert bench.last["/homeward/energy_to_home"].data >= 0.0
    assert 0.0 < bench.last["/homeward/battery"].percentage < 1.0
    assert math.isnan(bench.last["/homeward/battery"].voltage)
    robot.jump_s = 3600.0
    bench.until(
        lambda: "was set forward by 1 h 00 min" in bench.values()["warnings"], robot.publish
    )
    assert "no reading" not in bench.values()["warnings"]
    way_m = bench.way_m()
    robot.die()
    bench.until(lambda: "nothing on /odom" in bench.values()["warnings"])
    assert bench.statuses["homeward: way home"].level == STALE
    robot = Robot(graph, 0.0)
    bench.until(lambda: "/odom was restarted" in bench.values()["warnings"], robot.publish)
    assert way_m <= bench.way_m() < way_m + 30.0
    way_m = bench.way_m()
    os.kill(bench.bridge._process._child.pid, signal.SIGKILL)
    bench.until(lambda: "exit code -9" in bench.node.logger.said("error"), robot.publish)
    bench.statuses.clear()
    bench.until(lambda: bench.way_m() > 0.0, robot.publish)
    assert bench.way_m() >= way_m  # from its state: it did not begin anew
    assert {pair.key: pair.value for pair in bench.statuses["homeward: process"].values} == {
        "starts": "2"
    }
    assert "homeward: " in bench.node.logger.said("info")  # what it said on standard error


def test_unusable_input_is_said_and_not_tried_again(
    package: Any, graph: Graph, tmp_path: Path
) -> None:
    homeward = fake(
        tmp_path, 'print("homeward watch: robot x does not exist", file=sys.stderr)\nsys.exit(2)'
    )
    made = Bench(package, graph, homeward, restart_s=0.0)
    made.until(lambda: made.node.logger.said("error"))
    assert "exit code 2: homeward watch: robot x does not exist; mend it" in made.node.logger.said(
        "error"
    )
    made.statuses.clear()
    made.until(lambda: made.statuses)
    status = made.statuses["homeward: process"]
    assert status.level == b"\x02" and "does not exist" in status.message
    assert [pair.value for pair in status.values] == ["1"]
    made.bridge.end()


def test_a_process_that_is_silent_is_said_and_one_that_hangs_is_ended(
    package: Any, graph: Graph, tmp_path: Path
) -> None:
    made = Bench(
        package, graph, fake(tmp_path, "time.sleep(60)"), restart_s=0.0, silent_s=0.1, hang_s=1.2
    )
    made.until(lambda: "has written nothing" in made.node.logger.said("warn"))
    assert made.statuses["homeward: process"].level == STALE
    made.until(lambda: "and was ended" in made.node.logger.said("error"))
    made.until(lambda: made.node.logger.said("info").count("started: ") == 2)
    made.bridge.end()
    assert made.node.logger.said("info").count("fake started") >= 1


def test_a_command_that_is_not_there_is_said(package: Any, graph: Graph, tmp_path: Path) -> None:
    made = Bench(package, graph, str(tmp_path / "nothing"), restart_s=0.0)
    made.until(lambda: made.statuses)
    assert "set the parameter homeward to its command" in made.node.logger.said("error")
    made.bridge.end()
    with pytest.raises(ValueError, match="parameter robot is missing"):
        package.node.Bridge(Node(graph, {}))


def test_a_slow_process_loses_the_oldest(
    package: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(package.process, "MOST_WAITING", 3)
    process = package.process.Process([fake(tmp_path, "time.sleep(60)")], lambda line: None)
    for number in range(200):
        process.send({"topic": "x" * 5000, "publisher": number})  # more than a pipe holds
    assert process.dropped > 100
    process.end()
    assert process.code() == -signal.SIGTERM


def checked(
    package: Any, graph: Graph, homeward: str, capsys: pytest.CaptureFixture[str]
) -> tuple[int, list[str]]:
    report = package.check.Report()
    package.check.check(Node(graph, {"homeward": homeward, "robot": "husky"}), report, 1.5)
    return report.failed, capsys.readouterr().out.splitlines()


def test_the_check_says_what_works(
    package: Any,
    graph: Graph,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    body = 'if "--help" in sys.argv:\n    print("--stdin")\n    sys.exit()\n' + SPEAKS
    robot = Robot(graph, 0.0)

    def spin_once(node: Node, timeout_sec: float) -> None:
        robot.publish()
        time.sleep(0.02)

    monkeypatch.setattr(package.check.rclpy, "spin_once", spin_once)
    failed, lines = checked(package, graph, fake(tmp_path, body), capsys)
    assert failed == 0, lines
    assert (
        "works: messages of /odom (nav_msgs/msg/Odometry)" in lines
        and "works: advice on /homeward/turn_now" in lines
    )
    robot.die()
    monkeypatch.delitem(sys.modules, "nav_msgs.msg")
    failed, lines = checked(package, graph, fake(tmp_path, body), capsys)
    assert failed >= 6
    assert any(
        re.match(r"FAILS: nav_msgs/msg/Odometry is not installed.*apt install ros-", line)
        for line in lines
    )
    assert any(line.startswith("FAILS: advice on /homeward/turn_now; none yet") for line in lines)
    failed, lines = checked(package, graph, str(tmp_path / "nothing"), capsys)
    assert lines[-1].endswith("is not there; set the parameter homeward to that of its environment")


def test_what_is_passed_on_is_what_homeward_reads(package: Any) -> None:
    """All fields of the shipped mappings, of types that a robot of the stand-in has."""
    counted = 0
    for topic in (topic for name in shipped_topics() for topic in load_topics(name).topics):
        if topic.kind.split("/")[0] not in ("nav_msgs", "sensor_msgs", "geometry_msgs"):
            continue
        message: Any = class_of(topic.kind)()
        if hasattr(message, "name"):
            message.name = ["front_left_wheel_joint", "front_left_wheel", "wheel_left_joint"]
            message.velocity.extend([1.0, 2.0, 3.0])
        content = json.loads(
            json.dumps(package.messages.needed(message, topic.paths())), object_hook=Plain
        )
        for path in topic.paths():
            read = getter(path)(message)
            assert getter(path)(content) == read or math.isnan(read)
            counted += 1
    assert counted > 50


class Plain:
    def __init__(self, fields: dict[str, Any]) -> None:
        vars(self).update(fields)


def test_the_table_is_that_of_homeward(root: Path) -> None:
    own, other = (
        root / part / "interface.json" for part in ("ros2/homeward_ros2", "homeward/watch/ros2")
    )
    assert own.read_bytes() == other.read_bytes()


def test_it_needs_the_standard_library_and_rclpy_of_python_3_10(root: Path) -> None:
    allowed = {"rclpy", "homeward_ros2", *sys.stdlib_module_names} - {"tomllib"}  # which 3.10 lacks
    for file in sorted((root / "ros2" / "homeward_ros2").glob("*.py")):
        tree = ast.parse(file.read_text("utf-8"), feature_version=(3, 10))
        for node in ast.walk(tree):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            assert {name.split(".")[0] for name in names} <= allowed, file


def test_the_package_has_what_it_names(package: Any, root: Path) -> None:
    folder = root / "ros2"
    parameters = YAML(typ="safe").load((folder / "config" / "homeward.yaml").read_text("utf-8"))
    assert parameters["homeward"]["ros__parameters"] == package.node.DEFAULTS
    launch = ast.parse(
        (folder / "launch" / "homeward.launch.py").read_text("utf-8"), feature_version=(3, 10)
    )
    (arguments,) = (
        ast.literal_eval(node.value)
        for node in launch.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "ARGUMENTS"
    )
    assert {
        name: default for name, (default, _) in arguments.items()
    }.items() <= package.node.DEFAULTS.items()
    description = ElementTree.parse(folder / "package.xml").getroot()
    needed = {element.text for element in description.iter("exec_depend")}
    assert {kind.split("/")[0] for kind in package.node.INTERFACE["published"].values()} <= needed
    version = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    setup = (folder / "setup.py").read_text("utf-8")
    assert description.findtext("version") == version and f'version="{version}"' in setup
    for path in re.findall(r'\["((?:config|launch)/[^"]+|package\.xml)"\]', setup):
        assert (folder / path).is_file()
    assert (folder / "resource" / str(description.findtext("name"))).is_file()


def test_a_list_of_batteries_reaches_homeward_with_their_names(package: Any) -> None:
    class Pack:
        def __init__(self, current: float, location: str) -> None:
            self.current, self.location, self.cells = current, location, [4.1]

        def get_fields_and_field_types(self) -> dict[str, str]:
            return {"current": "float", "location": "string", "cells": "sequence<float>"}

    message = Plain({"packs": [Pack(2.4, "left"), Pack(1.6, "right")]})
    content = json.loads(
        json.dumps(package.messages.needed(message, ["packs[*].current"])), object_hook=Plain
    )
    elements = elements_reader(["packs[*].current"])(content, "my_msgs/msg/Packs")
    assert [tuple(element) for element in elements] == [
        ("left", {"packs[*].current": 2.4}), ("right", {"packs[*].current": 1.6}),
    ]  # fmt: skip
