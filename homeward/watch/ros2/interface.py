"""Topics, types and quality of service on ROS 2, read from one table, `interface.json`.

The node for a robot's own Python (`ros2/homeward_ros2`) has a copy of the table, which a test holds
equal.
"""

from __future__ import annotations

import json
from importlib.resources import files
from typing import NamedTuple

OWN = "homeward"
"""Prefix of the published topics, except /diagnostics."""


class Quality(NamedTuple):
    """Quality of service.

    Attributes:
        reliability: `best_effort` or `reliable`.
        durability: `volatile`: no subscriber receives what is old.
        depth: Messages of a topic that are kept until they are read. 100 of subscriptions are a
            fifth of a second of an IMU at 500 Hz, twice the period of the node; chosen.
    """

    reliability: str
    durability: str
    depth: int


_TABLE = json.loads((files("homeward.watch.ros2") / "interface.json").read_text("utf-8"))
PUBLISHED: dict[str, str] = _TABLE["published"]
"""Types of the published topics by their names without a namespace."""
SUBSCRIPTIONS = Quality(**_TABLE["subscriptions"])
PUBLICATIONS = Quality(**_TABLE["publications"])
_OUTSIDE: list[str] = _TABLE["outside_the_namespace"]


def name_in(namespace: str, topic: str) -> str:
    """Name of a published topic in a namespace, "" or with a leading slash.

    >>> name_in("/robot1", "/homeward/turn_now"), name_in("/robot1", "/diagnostics")
    ('/robot1/homeward/turn_now', '/diagnostics')
    """
    return topic if topic in _OUTSIDE else f"{namespace}{topic}"


def is_meant(topic: str, namespace: str) -> bool:
    """Whether a topic of others is to be subscribed, if its mapping says so: below the namespace,
    and no advice.

    >>> is_meant("/robot1/odom", "/robot1"), is_meant("/robot2/odom", "/robot1"), is_meant("/homeward/battery", "")
    (True, False, False)
    """
    return topic.startswith(f"{namespace}/") and f"/{OWN}/" not in topic
