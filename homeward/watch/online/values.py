"""The value of a channel from the fields of a message."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from homeward.logs import thresholds as logs_thresholds
from homeward.logs.bags import grade
from homeward.logs.bags.topics import ACCELERATION, ORIENTATION, Topic
from homeward.logs.unknown import unknown

POSE = "pose.pose.position.x", "pose.pose.position.y"
Value = Callable[[dict[str, float]], float]


def field_value(topic: Topic, name: str) -> Value:
    """Value of a channel that the mapping names; NaN where it means unknown."""
    channel_of = topic.sources[name].apply

    def known_value(values: dict[str, float]) -> float:
        value = float(channel_of(values))
        return math.nan if unknown(name, np.array([value]))[0] else value

    return known_value


def east_m(values: dict[str, float]) -> float:
    """East coordinate of a pose, m."""
    return values[POSE[0]]


def _quaternion(values: dict[str, float], topic: Topic) -> np.ndarray[Any, np.dtype[np.float64]]:
    path = topic.vectors[ORIENTATION]
    if values.get(f"{path}_covariance[0]") == -1.0:
        return np.full((4, 1), np.nan)
    quaternion = np.array([[values[f"{path}.{axis}"]] for axis in "xyzw"])
    # No part of a rotation is longer than 1.
    return np.where(
        np.abs(quaternion) <= 1.0 + logs_thresholds.UNIT_LENGTH_ERROR, quaternion, np.nan
    )


def slope(topic: Topic) -> Value:
    """Slope by an orientation, rad."""
    return lambda values: float(np.arcsin(grade.uphill(_quaternion(values, topic)))[0])


def heading_of(values: dict[str, float], topic: Topic) -> float:
    """Heading by an orientation, rad counter-clockwise from east; NaN without one."""
    if ORIENTATION not in topic.vectors:
        return math.nan
    return float(grade.yaw(_quaternion(values, topic))[0])


def heading(topic: Topic) -> Value:
    """The same for any message of a topic."""
    return lambda values: heading_of(values, topic)


def acceleration(topic: Topic) -> Value:
    """Forward acceleration, m/s^2; NaN if the message states that it has none."""
    path = topic.vectors[ACCELERATION]
    return lambda values: (
        math.nan if values.get(f"{path}_covariance[0]") == -1.0 else values[f"{path}.x"]
    )
