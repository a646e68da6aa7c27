"""Another process carries a robot's messages: JSON lines on standard input and output
(`homeward watch --stdin`).

It writes what is published by the robot, and each message with the fields that it was asked for:

    {"topics": {"/odom": "nav_msgs/msg/Odometry"}}
    {"topic": "/odom", "publisher": 1, "content": {"twist": {"twist": {"linear": {"x": 0.5}}}}}

and reads which fields of which topics are wanted, what is to be published, and the advice as a
whole:

    {"subscribe": {"/odom": {"type": "nav_msgs/msg/Odometry", "fields": ["twist.twist.linear.x"]}}}
    {"publish": "/homeward/turn_now", "type": "std_msgs/msg/Bool", "content": {"data": false}}
    {"advice": {"time_s": 3.0, "turn_now": false}}

Not a number is NaN, as Python writes it. `ros2/homeward_ros2` is such a process.
"""

from __future__ import annotations

import json
import os
import select
from types import SimpleNamespace
from typing import Any, ClassVar

from homeward.watch.online.link import Message, News
from homeward.watch.ros2.advice_messages import messages
from homeward.watch.ros2.interface import is_meant

_CHUNK = 65536  # bytes read at a time, a pipe's content
_LONGEST = 1_000_000
"""Bytes of a line; a longer one is left out. Chosen: bounds memory, and no message of numbers is
longer."""


class Lines:
    """A `homeward.watch.online.link.Link` of two streams.

    Args:
        source: File descriptor to read from; a pipe, because a file has no end that is waited for.
        target: File descriptor to write to.
        namespace: Topics of others are used, and advice is published, below it; "" for all.

    Attributes:
        ended: Whether the other process has closed its end.
    """

    SAVED: ClassVar[tuple[str, ...]] = ()

    def __init__(self, source: int, target: int, namespace: str = "") -> None:
        self._source, self._target, self._namespace = source, target, namespace
        self.ended = False
        self._rest = b""
        self._topics: dict[str, str] = {}
        self._messages: list[Message] = []
        self._left_out = 0

    def found(self) -> dict[str, str]:
        """Topics as the other process has listed them last."""
        self._read()
        return dict(self._topics)

    def subscribe(self, topics: dict[str, str], fields: dict[str, list[str]]) -> None:
        """Ask for fields of topics."""
        asked = {name: {"type": kind, "fields": fields[name]} for name, kind in topics.items()}
        self._write({"subscribe": asked})

    def take(self) -> list[Message]:
        """Messages since the last call."""
        self._read()
        messages, self._messages = self._messages, []
        return messages

    def faults(self) -> list[str]:
        """Lines that could not be read."""
        return (
            [f"{self._left_out} lines are no messages and are left out"] if self._left_out else []
        )

    def tell(self, news: News) -> None:
        """Write what is to be published, and the advice.

        Raises:
            OSError: The other process has closed its end.
        """
        for topic, kind, content in messages(*news, self._namespace):
            self._write({"publish": topic, "type": kind, "content": content})
        if news.advice is not None:
            self._write({"advice": news.advice.to_json()})

    def _write(self, line: dict[str, Any]) -> None:
        content = json.dumps(line).encode() + b"\n"
        while content:
            content = content[os.write(self._target, content) :]

    def _read(self) -> None:
        """Read what there is, without waiting."""
        while not self.ended and select.select([self._source], [], [], 0.0)[0]:
            content = os.read(self._source, _CHUNK)
            self.ended = not content
            *lines, self._rest = (self._rest + content).split(b"\n")
            for line in lines:
                self._see(line)
            if len(self._rest) > _LONGEST:
                self._rest = b""
                self._left_out += 1

    def _see(self, line: bytes) -> None:
        try:
            said = json.loads(line, object_hook=lambda fields: SimpleNamespace(**fields))
            if hasattr(said, "topics"):
                topics = {str(name): str(kind) for name, kind in vars(said.topics).items()}
                self._topics = {
                    name: kind for name, kind in topics.items() if is_meant(name, self._namespace)
                }
            else:
                self._messages.append(Message(str(said.topic), said.content, int(said.publisher)))
        except (ValueError, TypeError, AttributeError, RecursionError):  # no JSON, or other JSON
            self._left_out += 1
