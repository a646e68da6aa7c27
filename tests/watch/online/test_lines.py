"""JSON lines of another process: messages in, what is to be published out."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rosbags", reason="needs the extra logs")

from homeward.companion import Companion
from homeward.watch.online.lines import Lines
from homeward.watch.online.link import News
from homeward.watch.ros2.interface import PUBLISHED


class Pipes:
    """Both ends of the two streams."""

    def __init__(self) -> None:
        self.source, self.writes = os.pipe()
        self.reads, self.target = os.pipe()
        self.lines = Lines(self.source, self.target, "/r1")

    def say(self, text: str) -> None:
        os.write(self.writes, text.encode())

    def heard(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in os.read(self.reads, 1_000_000).splitlines()]


@pytest.fixture
def pipes() -> Iterator[Pipes]:
    made = Pipes()
    yield made
    for end in (made.source, made.reads, made.target):
        os.close(end)
    if not made.lines.ended:
        os.close(made.writes)


def test_topics_and_messages_come_in_pieces(pipes: Pipes) -> None:
    topics = {
        "/r1/odom": "nav_msgs/msg/Odometry",
        "/r2/odom": "nav_msgs/msg/Odometry",
        "/r1/homeward/turn_now": "b",
    }
    said = json.dumps({"topics": topics}) + "\n"
    said += (
        json.dumps(
            {"topic": "/r1/odom", "publisher": 7, "content": {"a": {"b": [1.5, float("nan")]}}}
        )
        + "\n"
    )
    assert pipes.lines.take() == []  # without waiting
    pipes.say(said[:90])
    pipes.lines.take()
    pipes.say(said[90:])
    (message,) = pipes.lines.take()
    assert pipes.lines.found() == {"/r1/odom": "nav_msgs/msg/Odometry"}
    assert (message.topic, message.publisher, message.content.a.b[0]) == ("/r1/odom", 7, 1.5)
    pipes.lines.subscribe(
        {"/r1/odom": "nav_msgs/msg/Odometry"}, {"/r1/odom": ["a.b[0]"], "/other": []}
    )
    assert pipes.heard() == [
        {"subscribe": {"/r1/odom": {"type": "nav_msgs/msg/Odometry", "fields": ["a.b[0]"]}}}
    ]


@pytest.mark.parametrize(
    "line",
    [
        "nonsense", "[]", "3", '{"topic": "/x"}', '{"topics": 3}', '{"topic": "/x", "publisher": "y", "content": {}}',
        "[" * 100_000, '"\xff"',
    ],
)  # fmt: skip
def test_what_is_no_message_is_left_out_and_said(pipes: Pipes, line: str) -> None:
    os.set_blocking(pipes.writes, False)
    for start in range(0, len(line), 50_000):
        pipes.say(line[start : start + 50_000])
        assert pipes.lines.take() == []
    pipes.say('\n{"topic": "/x", "publisher": 1, "content": {}}\n')
    assert [message.topic for message in pipes.lines.take()] == ["/x"]
    assert pipes.lines.faults() == ["1 lines are no messages and are left out"]


def test_the_advice_is_written_and_the_end_is_seen(pipes: Pipes) -> None:
    companion = Companion("husky")
    advice = companion.update(0.0, position=100.0)
    pipes.lines.tell(News(advice, 1.7e6, "husky", [], False))
    lines = pipes.heard()
    published = {line["publish"]: line["type"] for line in lines if "publish" in line}
    assert published == {
        topic if topic == "/diagnostics" else f"/r1{topic}": kind
        for topic, kind in PUBLISHED.items()
    }
    assert lines[-1]["advice"]["way_home_m"] == 100.0
    assert not pipes.lines.ended
    os.close(pipes.writes)
    assert pipes.lines.take() == [] and pipes.lines.ended
