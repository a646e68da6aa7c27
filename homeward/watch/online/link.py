"""What carries a robot's messages to the node, and its advice back: a network, MAVLink or another
process."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple, Protocol

from homeward.companion import Advice


class Message(NamedTuple):
    """A message and its publisher.

    Attributes:
        topic: Name of its topic.
        content: An object with the fields of its type.
        publisher: Identity of its publisher; another one after a restart.
    """

    topic: str
    content: Any
    publisher: int


class News(NamedTuple):
    """What the robot is told.

    Attributes:
        advice: The companion's advice, None before the first.
        full_j: Energy of a full battery by the robot's file, J.
        robot: Name of the robot.
        warnings: Present warnings, a line each.
        silent: Whether no motion is received.
    """

    advice: Advice | None
    full_j: float
    robot: str
    warnings: list[str]
    silent: bool


class Output(Protocol):
    """Where the advice goes beside the link."""

    def tell(self, news: News) -> None:
        """Publish.

        Raises:
            OSError, CompanionError: It cannot be published now.
        """


class Link(Output, Protocol):
    """A way to exchange messages with a robot.

    Attributes:
        SAVED: What a restart continues from, by name.
    """

    SAVED: ClassVar[tuple[str, ...]]

    def found(self) -> dict[str, str]:
        """Topics that there are, with the types of their messages."""

    def subscribe(self, topics: dict[str, str], fields: dict[str, list[str]]) -> None:
        """Receive these topics from now on.

        Args:
            topics: Types of their messages by name.
            fields: Paths of the fields that are read, by the name of the topic.
        """

    def take(self) -> list[Message]:
        """Messages since the last call, in order for each topic."""

    def faults(self) -> list[str]:
        """What is wrong with the messages, a line each."""


def can_reach_home(advice: Advice) -> bool:
    """Whether the robot gets home when it turns now, at the accepted risk."""
    return advice.chance_home >= 1.0 - advice.risk


def reserve(advice: Advice, full_j: float) -> float:
    """Share of a full battery that the way home leaves at the accepted risk; 0 from when it must
    turn."""
    least_j = advice.margin_j.quantile(advice.risk)
    return 0.0 if advice.turn_now else min(max(least_j / full_j, 0.0), 1.0)
