"""The network: topics of others are found, read and published under their names in ROS 2."""

import time
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("cyclonedds", reason="needs the extra ros2")

from homeward.companion import CompanionError
from homeward.watch.ros2.idl import struct_of
from homeward.watch.ros2.network import Network
from tests.watch.ros2.simulated_robot import DOMAIN, LONGEST_S

pytestmark = pytest.mark.usefixtures("loopback")

FLOAT = "std_msgs/msg/Float64"


def until(reached: Callable[[], object]) -> None:
    end_s = time.monotonic() + LONGEST_S
    while not reached():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_bytes_that_do_not_fit_their_type_are_left_out() -> None:
    class Reader:
        def take(self, most: int) -> list[Any]:
            return [struct_of("nav_msgs/msg/Odometry").deserialize(b"\0\1\0\0" + bytes(20))]

    network = Network(DOMAIN)
    network._readers["/odom"] = Reader()  # type: ignore[assignment]
    assert network.take() == [] == network.take() and network.unreadable == {"/odom": 2}


def test_what_one_publishes_another_finds_and_reads_in_order() -> None:
    one, other, elsewhere = Network(DOMAIN), Network(DOMAIN), Network(DOMAIN, "/robot2")
    one.publish("/robot2/level", FLOAT, {"data": 0.0})
    until(lambda: elsewhere.found())
    one.publish("/first/level", FLOAT, {"data": 0.0})
    until(lambda: {"/first/level", "/robot2/level"} <= other.found().keys())
    assert elsewhere.found() == {"/robot2/level": FLOAT} and one.found() == {}  # none of its own
    other.subscribe(other.found(), {})
    other.subscribe({"/first/level": FLOAT}, {})  # a second time changes nothing
    read: list[Any] = []

    def published() -> bool:
        one.publish("/first/level", FLOAT, {"data": 1.0 + len(read)})
        read.extend(other.take())
        return len(read) >= 3

    until(published)
    assert {said.topic for said in read} == {"/first/level"}
    values = [said.content.data for said in read]
    assert values == sorted(values) and values[0] >= 1.0
    assert len({said.publisher for said in read}) == 1 and other.unreadable == {}


def test_a_domain_that_cannot_be_joined_takes_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Domain><General><Interfaces><NetworkInterface "
                       'name="no_such"/></Interfaces></General></Domain></CycloneDDS>')  # fmt: skip
    with pytest.raises(
        CompanionError, match=r"^cannot join domain \d+: .*; check CYCLONEDDS_URI"
    ) as caught:
        Network(DOMAIN + 1)
    assert "\n" not in str(caught.value)
