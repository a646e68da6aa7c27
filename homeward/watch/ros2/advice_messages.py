"""The companion's advice as messages of ROS 2."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from typing import Any

from homeward import quantities
from homeward.companion import Advice
from homeward.companion.advice import HOME
from homeward.watch.online.link import can_reach_home, reserve
from homeward.watch.ros2.interface import OWN, PUBLISHED, name_in

Content = dict[str, Any]
"""Fields of a message by their names, with dictionaries for the messages in it; others are 0 or
empty."""

_OK, _WARN, _ERROR, _STALE = range(4)  # diagnostic_msgs/DiagnosticStatus
_DISCHARGING = 2  # sensor_msgs/BatteryState
_UNMEASURED = "voltage", "temperature", "current", "charge", "capacity", "design_capacity"


def messages(
    advice: Advice | None,
    full_j: float,
    robot: str,
    warnings: Sequence[str],
    silent: bool,
    namespace: str,
) -> Iterator[tuple[str, str, Content]]:
    """Topics, types and contents of an advice; without one, only diagnostics.

    Args:
        advice: The companion's advice, None if there were not enough readings.
        full_j: Energy of a full battery by the robot's file, J.
        robot: Name of the robot.
        warnings: Present warnings.
        silent: Whether no motion is received.
        namespace: Prefix of the names, "" or with a leading slash.
    """
    header = {"stamp": {"sec": int(time.time()), "nanosec": time.time_ns() % 10**9}}
    contents: dict[str, Content] = {}
    if advice is not None:
        contents = {
            "/homeward/can_reach_home": {"data": can_reach_home(advice)},
            "/homeward/turn_now": {"data": advice.turn_now},
            "/homeward/energy_to_home": {"data": advice.energy_home_j.mean},
            "/homeward/battery": {
                "header": header, "percentage": reserve(advice, full_j), "power_supply_status": _DISCHARGING,
                "present": True, **dict.fromkeys(_UNMEASURED, math.nan),
            },
        }  # fmt: skip
    contents["/diagnostics"] = {
        "header": header,
        "status": [_status(advice, robot, warnings, silent, namespace)],
    }
    for topic, content in contents.items():
        yield name_in(namespace, topic), PUBLISHED[topic], content


def _status(
    advice: Advice | None, robot: str, warnings: Sequence[str], silent: bool, namespace: str
) -> Content:
    """The advice as a DiagnosticStatus: its level, a sentence, and its numbers."""
    level = _OK
    if silent:
        level = _STALE
    elif warnings:
        level = _WARN
    text = "no readings yet"
    values: list[tuple[str, str]] = []
    if advice is not None:
        level, text = _order(advice, level)
        values = [(name, _shown(value)) for name, value in _numbers(advice).items()]
    values += [("warning", warning) for warning in warnings]
    return {
        "level": level, "name": f"{namespace}/{OWN}: way home".lstrip("/"), "message": text, "hardware_id": robot,
        "values": [{"key": key, "value": value} for key, value in values],
    }  # fmt: skip


def _order(advice: Advice, level: int) -> tuple[int, str]:
    """What the robot should do, with a level that is not below the given one unless it is an
    error."""
    if not can_reach_home(advice):
        return _ERROR, f"it may not get home: probability {advice.chance_home:.2%}"
    if advice.turn_now:
        destination = "" if advice.home == HOME else f", to {advice.home}"
        return max(level, _WARN), f"turn now{destination}"
    return (
        level,
        f"turn within {quantities.distance(advice.turn_in_m)}, {quantities.duration(advice.turn_in_s)}",
    )


def _numbers(advice: Advice) -> dict[str, object]:
    """Numbers of an advice by name, in SI units; of energies the mean and the 90 % interval."""
    values: dict[str, object] = {
        "way_home_m": advice.way_home_m, "chance_home": advice.chance_home, "risk": advice.risk,
        "turn_in_m": advice.turn_in_m, "turn_in_s": advice.turn_in_s, "turn_now": advice.turn_now,
    }  # fmt: skip
    for name in ("energy_left_j", "energy_home_j", "margin_j"):
        spread = getattr(advice, name)
        values |= {name: spread.mean, f"{name}_low": spread.low, f"{name}_high": spread.high}
    if advice.others:
        values["home"] = advice.home
    for option in advice.others:
        values |= {
            f"way_to_{option.name}_m": option.way_m, f"chance_{option.name}": option.chance,
            f"margin_{option.name}_j": option.margin_j.mean,
        }  # fmt: skip
    return values


def _shown(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
