"""A session of `homeward watch --ros2`: what is printed, and that it goes on from its state."""

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

pytest.importorskip("cyclonedds", reason="needs the extra ros2")

from homeward.cli import Terminal
from homeward.companion import Companion, CompanionError
from homeward.physics import load_robot
from homeward.watch.ros2.node import Node
from homeward.watch.ros2.session import Session, _Printer
from tests.watch.ros2.simulated_robot import DOMAIN, LONGEST_S, robot

pytestmark = pytest.mark.usefixtures("loopback")


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


class Lines:
    """A terminal that keeps what is printed."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def print(self, text: str, **_: Any) -> None:
        self.said.append(text)

    def taken(self) -> list[str]:
        said, self.said = self.said, []
        return said


def quiet_node() -> Any:
    """A node that has heard nothing."""
    listener = SimpleNamespace(sources={}, mapping_name="any_robot", wanted={"/odom", "/imu"})
    return SimpleNamespace(advice=None, listener=listener, found={}, warnings=[])


def test_while_it_waits_it_says_once_what_it_has_heard() -> None:
    node, lines = quiet_node(), Lines()
    printer = _Printer(cast(Terminal, lines), cast(Node, node), "husky on domain 3")
    printer.say(0.5, True)
    assert lines.taken() == []
    printer.say(2.0, True)
    printer.say(3.0, True)
    assert lines.taken() == [
        "husky on domain 3: waiting for motion; subscribed by the topic mapping any_robot: none; 0 other topics"
    ]
    node.found = {"/odom": "nav_msgs/msg/Odometry", "/scan": "b", "/a": "c"}
    printer.say(4.0, True)
    (line,) = lines.taken()
    assert line.endswith("any_robot: /odom (nav_msgs/msg/Odometry); 2 other topics, such as /a (c), /scan (b)")


def test_without_a_live_view_it_prints_sources_warnings_and_advice_when_they_change() -> None:
    node, lines = quiet_node(), Lines()
    companion = Companion("husky")
    companion.update(0.0, position=100.0)
    node.advice = companion.update(1.0, position=101.0)
    node.listener.sources = {"voltage_v": "/battery", "speed_mps": "/odom", "current_a": "/battery"}
    printer = _Printer(cast(Terminal, lines), cast(Node, node), "husky")
    printer.say(1.0, False)
    assert lines.taken() == []  # the live view has all that
    printer.say(1.0, True)
    mapping, advice = lines.taken()
    assert mapping == "topic mapping any_robot: voltage_v, current_a from /battery; speed_mps from /odom"
    assert advice == f"1 s: {node.advice}"
    printer.say(30.0, True)
    assert lines.taken() == []
    node.warnings = ["nothing on /odom for 3 s"]
    printer.say(31.0, True)
    node.warnings = ["nothing on /odom for 4 s"]  # the same of another size
    printer.say(32.0, True)
    assert lines.taken() == ["31 s: nothing on /odom for 3 s"]
    printer.say(61.0, True)
    assert lines.taken() == [f"61 s: {node.advice}"]  # once a minute
