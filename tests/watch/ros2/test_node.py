"""A robot on the network, in a second process, on the loopback interface alone."""

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("cyclonedds", reason="needs the extra ros2")

from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from homeward.cli import Terminal
from homeward.companion import Companion, CompanionError
from homeward.physics import load_robot
from homeward.watch.ros2 import LOOPBACK, idl, listener, session
from homeward.watch.ros2.advice_messages import messages
from homeward.watch.ros2.idl import struct_of
from homeward.watch.ros2.network import Network
from homeward.watch.ros2.node import PERIOD_S, Node
from homeward.watch.ros2.session import Session

DOMAIN = 100 + os.getpid() % 100
LONGEST_S = 60.0
PUBLISHED = {
    "/homeward/can_reach_home": "std_msgs/msg/Bool", "/homeward/turn_now": "std_msgs/msg/Bool",
    "/homeward/energy_to_home": "std_msgs/msg/Float64", "/homeward/battery": "sensor_msgs/msg/BatteryState",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}  # fmt: skip
STALE = 3


@pytest.fixture(autouse=True)
def loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing leaves this computer: neither from here nor from the processes that are started."""
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setattr(listener, "_SETTLES_S", 0.5)
    monkeypatch.setattr(session, "_WAITS_S", 1.0)


@contextmanager
def robot(*options: str) -> Iterator[subprocess.Popen[bytes]]:
    """A simulated robot in a process of its own, which ends as by a power cut."""
    command = [sys.executable, "-m", "homeward.watch.ros2.simulated", "--domain", str(DOMAIN), *options]
    with subprocess.Popen(command, cwd=Path(__file__).parents[3]) as process:
        try:
            yield process
        finally:
            process.kill()


def until(node: Node, reached: Callable[[], object]) -> None:
    """Listen until something is so."""
    end_s = time.monotonic() + LONGEST_S
    while not reached():
        assert time.monotonic() < end_s, (node.advice, node.warnings, node.found)
        node.step()
        time.sleep(PERIOD_S)


class Others:
    """What another participant reads of what is published."""

    def __init__(self) -> None:
        self._participant = DomainParticipant(DOMAIN)
        self._readers = {
            name: DataReader(self._participant, Topic(self._participant, f"rt{name}", struct_of(kind)))
            for name, kind in PUBLISHED.items()
        }
        self.last: dict[str, Any] = {}

    def heard(self) -> bool:
        """Whether something of everything was read, since `last` was emptied."""
        for name, reader in self._readers.items():
            for one in reader.take(100):
                self.last[name] = one
        return self.last.keys() == self._readers.keys()


def test_lost_messages_a_clock_that_jumps_a_dead_publisher_and_a_restart() -> None:
    node, others = Node(Companion("husky", home="here"), DOMAIN), Others()
    with robot("--x", "500", "--lost", "0.3", "--speed", "1", "--jump-at-s", "4", "--jump-s", "3600"):
        until(node, lambda: node.advice is not None and node.advice.way_home_m > 1.0 and others.heard())
        advice = node.advice
        assert advice is not None
        # Home is where it was first believed; it drives at 1 m/s.
        assert advice.way_home_m == pytest.approx(advice.time_s, abs=1.0)
        assert node.listener.mapping_name == "any_robot" and node.listener.sources["soc"] == "/battery_state"
        assert others.last["/homeward/can_reach_home"].data and not others.last["/homeward/turn_now"].data
        assert others.last["/homeward/energy_to_home"].data >= 0.0
        assert 0.5 < others.last["/homeward/battery"].percentage < 1.0
        until(node, lambda: any("was set forward by 1 h 00 min" in text for text in node.warnings))
        assert node.advice is not None and node.advice.time_s < LONGEST_S
        assert not any("no reading" in text for text in node.warnings)

    before = node.advice
    others.last.clear()
    until(node, lambda: any("nothing on /odom" in text for text in node.warnings) and others.heard())
    others.last.clear()
    until(node, lambda: others.heard() and node.silent)
    (status,) = others.last["/diagnostics"].status
    assert status.level == STALE and any("nothing on /odom" in pair.value for pair in status.values)
    silent = node.advice
    assert silent is not None and silent.time_s > before.time_s and silent.way_home_m >= before.way_home_m

    with robot("--x", "0"):
        until(node, lambda: any("/odom was restarted" in text for text in node.warnings))
        until(node, lambda: not node.silent)
        after = node.advice
        assert after is not None and after.time_s > silent.time_s
        assert before.way_home_m <= after.way_home_m < before.way_home_m + 2.0 * (after.time_s - before.time_s)


def test_a_session_goes_on_from_its_state(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    state = tmp_path / "state.json"
    way_m: list[float] = []

    def drive(least_m: float) -> None:
        """A session until home is so far away."""
        one = Session(load_robot("husky"), DOMAIN, state=state)
        end_s = time.monotonic() + LONGEST_S

        def done() -> bool:
            assert time.monotonic() < end_s, one.node.warnings
            return one.node.advice is not None and one.node.advice.way_home_m > least_m

        one.run(Terminal(), quiet=False, done=done)
        assert one.node.advice is not None
        way_m.append(one.node.advice.way_home_m)

    with robot("--speed", "1"):
        drive(0.5)
        capsys.readouterr()
        drive(way_m[0])
        printed = capsys.readouterr().out
        other = Session(load_robot("husky"), DOMAIN, namespace="/robot2")
        end_s = time.monotonic() + 1.5
        other.run(Terminal(), quiet=False, done=lambda: time.monotonic() > end_s)
    assert way_m[1] > way_m[0]  # at once: it did not begin anew
    assert "topic mapping any_robot: " in printed and "from /odom" in printed and "turn within" in printed
    assert other.node.advice is None and other.node.messages == 0
    assert "waiting for motion; subscribed by the topic mapping : none; 0 other topics" in capsys.readouterr().out
    state.write_text('{"companion": {}}')
    with pytest.raises(CompanionError, match="cannot be used"):
        drive(0.0)


def test_what_is_published_when_it_must_turn() -> None:
    companion = Companion("husky", soc=0.02)
    companion.update(0.0, position=900.0)
    advice = companion.update(10.0, position=900.0, speed_mps=0.0)
    assert advice.turn_now and advice.chance_home < 0.5
    said: dict[str, Any] = {name: one for name, _, one in messages(advice, 1.7e6, "husky", ["dark"], False, "/r1")}
    assert not said["/r1/homeward/can_reach_home"].data and said["/r1/homeward/turn_now"].data
    assert said["/r1/homeward/battery"].percentage == 0.0 and math.isnan(said["/r1/homeward/battery"].current)
    assert said["/r1/homeward/energy_to_home"].data == advice.energy_home_j.mean > 0.0
    (status,) = said["/diagnostics"].status
    assert status.level == 2 and "it may not get home" in status.message and status.name == "r1/homeward: way home"
    assert ("warning", "dark") in {(pair.key, pair.value) for pair in status.values}


def test_bytes_that_do_not_fit_their_type_are_left_out() -> None:
    class Reader:
        def take(self, most: int) -> list[Any]:
            return [struct_of("nav_msgs/msg/Odometry").deserialize(b"\0\1\0\0" + bytes(20))]

    network = Network(DOMAIN)
    network._readers["/odom"] = Reader()  # type: ignore[assignment]
    assert network.take() == [] == network.take() and network.unreadable == {"/odom": 2}


def test_a_field_without_a_type_in_dds_takes_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(idl._BASES, "float64")
    idl.struct_of.cache_clear()
    with pytest.raises(CompanionError, match="a field of type float64 cannot be read"):
        struct_of("std_msgs/msg/Float64")
