"""A session on live messages: what is printed, and states that cannot be used; tests/ros2 goes on
from one."""

import contextlib
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

pytest.importorskip("cyclonedds", reason="needs the extra ros2")

from homeward.cli import Terminal
from homeward.companion import Companion
from homeward.physics import load_robot
from homeward.watch.online import session as session_module
from homeward.watch.online.node import Node
from homeward.watch.online.session import Session, _Printer
from homeward.watch.ros2.network import Network
from tests.watch.ros2.simulated_robot import DOMAIN, LONGEST_S, robot

WHERE = f"husky on domain {DOMAIN}"
pytestmark = pytest.mark.usefixtures("loopback")


@pytest.mark.parametrize(
    "content",
    ['{"companion": {}}', "nonsense", "[]", "", '{"schema": 2, "companion": {}, "seal": ""}'],
)
def test_a_state_that_cannot_be_used_is_said_and_left_out(
    content: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    state = tmp_path / "state.json"
    state.write_text(content)
    session = Session(load_robot("husky"), Network(DOMAIN), WHERE, state=state)
    session.node.step()
    (said,) = session.node.warnings
    assert (
        said.startswith("begun without the state: the state in ")
        and "home is where the robot is now" in said
    )
    assert capsys.readouterr().err.count("\n") == 1


def test_a_disk_that_cannot_be_written_ends_nothing_and_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither for the state, nor for what is printed."""
    monkeypatch.setattr(session_module, "_SAVED_S", 0.1)
    monkeypatch.setattr(session_module, "_PRINTED_S", 0.1)
    (tmp_path / "folder").mkdir()
    state = tmp_path / "folder" / "state.json"
    session = Session(load_robot("husky"), Network(DOMAIN), WHERE, state=state)
    (tmp_path / "folder").rmdir()
    (tmp_path / "folder").touch()  # a folder that no file can be made in, also by root
    node, end_s, said = session.node, time.monotonic() + LONGEST_S, set[str]()

    def done() -> bool:
        assert time.monotonic() < end_s, node.warnings
        said.update(text.split(" failed: ")[0] for text in node.warnings)
        return (
            {"saving the state", "printing"} <= said
            and node.advice is not None
            and node.advice.way_home_m > 2.0
        )

    console, went_on = Terminal(), False
    with contextlib.suppress(OSError), Path("/dev/full").open("w") as full, robot("--speed", "1"):
        console.file = full
        session.run(console, quiet=False, done=done)
        went_on = True
    assert went_on  # only closing the full file failed
    assert (
        f"saving the state failed: [Errno 17] File exists: '{state.parent}'"
        in capsys.readouterr().err
    )


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
    assert line.endswith(
        "any_robot: /odom (nav_msgs/msg/Odometry); 2 other topics, such as /a (c), /scan (b)"
    )


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
    assert (
        mapping
        == "topic mapping any_robot: voltage_v, current_a from /battery; speed_mps from /odom"
    )
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
