"""A robot on the network, in a second process, on the loopback interface alone; tests/ros2 has a
clock that jumps."""

import time
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("cyclonedds", reason="needs the extra ros2")

from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from homeward.companion import Companion
from homeward.watch.online.listener import Heard
from homeward.watch.online.node import PERIOD_S, Node
from homeward.watch.ros2.idl import struct_of
from homeward.watch.ros2.network import Network
from tests.companion.robots import HUSKY, Driven
from tests.watch.ros2.simulated_robot import DOMAIN, LONGEST_S, robot

pytestmark = pytest.mark.usefixtures("loopback")
PUBLISHED = {
    "/homeward/can_reach_home": "std_msgs/msg/Bool", "/homeward/turn_now": "std_msgs/msg/Bool",
    "/homeward/energy_to_home": "std_msgs/msg/Float64", "/homeward/battery": "sensor_msgs/msg/BatteryState",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}  # fmt: skip
STALE = 3


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
            name: DataReader(
                self._participant, Topic(self._participant, f"rt{name}", struct_of(kind))
            )
            for name, kind in PUBLISHED.items()
        }
        self.last: dict[str, Any] = {}

    def heard(self) -> bool:
        """Whether something of everything was read, since `last` was emptied."""
        for name, reader in self._readers.items():
            for one in reader.take(100):
                self.last[name] = one
        return self.last.keys() == self._readers.keys()


def test_a_charge_keeps_what_is_known_of_the_battery_and_a_swap_does_not() -> None:
    left = []
    for by_charger in (True, False):
        node = Node(Companion(HUSKY, home="here"), Network(DOMAIN))
        Driven(health=0.85, every_s=25.0).drive(node.companion, 0.0, 3000.0)
        node._advise(Heard(3600.0, {"speed_mps": 0.0}, 1.02, by_charger))
        assert node.advice is not None
        left.append(node.advice.energy_left_j)
    assert left[0].sd < 0.8 * left[1].sd and left[0].mean < left[1].mean


def test_lost_messages_a_dead_publisher_and_a_restart() -> None:
    node, others = Node(Companion(HUSKY, home="here"), Network(DOMAIN)), Others()
    with robot("--x", "500", "--lost", "0.3", "--speed", "1"):
        until(
            node,
            lambda: node.advice is not None and node.advice.way_home_m > 1.0 and others.heard(),
        )
        advice = node.advice
        assert advice is not None
        # Home is where it was first believed; it drives at 1 m/s.
        assert advice.way_home_m == pytest.approx(advice.time_s, abs=1.0)
        assert (
            node.listener.mapping_name == "any_robot"
            and node.listener.sources["soc"] == "/battery_state"
        )
        assert (
            others.last["/homeward/can_reach_home"].data
            and not others.last["/homeward/turn_now"].data
        )
        assert others.last["/homeward/energy_to_home"].data >= 0.0
        assert 0.5 < others.last["/homeward/battery"].percentage < 1.0

    before = node.advice
    assert before is not None
    others.last.clear()
    until(
        node, lambda: any("nothing on /odom" in text for text in node.warnings) and others.heard()
    )
    others.last.clear()
    until(node, lambda: others.heard() and node.silent)
    (status,) = others.last["/diagnostics"].status
    assert status.level == STALE and any("nothing on /odom" in pair.value for pair in status.values)
    silent = node.advice
    assert (
        silent is not None
        and silent.time_s > before.time_s
        and silent.way_home_m >= before.way_home_m
    )

    with robot("--x", "0"):
        until(node, lambda: any("/odom was restarted" in text for text in node.warnings))
        until(node, lambda: not node.silent)
        after = node.advice
        assert after is not None and after.time_s > silent.time_s
        assert (
            before.way_home_m
            <= after.way_home_m
            < before.way_home_m + 2.0 * (after.time_s - before.time_s)
        )
