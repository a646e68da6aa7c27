"""The companion's advice as messages of ROS 2."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence

from cyclonedds.idl import IdlStruct

from homeward import quantities
from homeward.companion import Advice
from homeward.watch.ros2.idl import message

_OK, _WARN, _ERROR, _STALE = range(4)  # diagnostic_msgs/DiagnosticStatus
_DISCHARGING = 2  # sensor_msgs/BatteryState
_UNMEASURED = "voltage", "temperature", "current", "charge", "capacity", "design_capacity"
OWN = "homeward"
"""Prefix of the published topics, except /diagnostics."""


def messages(
    advice: Advice | None, full_j: float, robot: str, warnings: Sequence[str], silent: bool, namespace: str
) -> Iterator[tuple[str, str, IdlStruct]]:
    """Topics, types and messages of an advice; without one, only diagnostics.

    Args:
        advice: The companion's advice, None if there were not enough readings.
        full_j: Energy of a full battery by the robot's file, J.
        robot: Name of the robot.
        warnings: Present warnings.
        silent: Whether no motion is received.
        namespace: Prefix of the names, "" or with a leading slash.
    """
    stamp = message("builtin_interfaces/msg/Time", sec=int(time.time()), nanosec=time.time_ns() % 10**9)
    header = message("std_msgs/msg/Header", stamp=stamp)
    if advice is not None:
        name, kind = f"{namespace}/{OWN}", "std_msgs/msg/Bool"
        yield f"{name}/can_reach_home", kind, message(kind, data=can_reach_home(advice))
        yield f"{name}/turn_now", kind, message(kind, data=advice.turn_now)
        kind = "std_msgs/msg/Float64"
        yield f"{name}/energy_to_home", kind, message(kind, data=advice.energy_home_j.mean)
        kind = "sensor_msgs/msg/BatteryState"
        state = message(
            kind, header=header, percentage=reserve(advice, full_j), power_supply_status=_DISCHARGING, present=True,
            **dict.fromkeys(_UNMEASURED, math.nan),
        )  # fmt: skip
        yield f"{name}/battery", kind, state
    kind = "diagnostic_msgs/msg/DiagnosticArray"
    yield (
        "/diagnostics",
        kind,
        message(kind, header=header, status=[_status(advice, robot, warnings, silent, namespace)]),
    )


def can_reach_home(advice: Advice) -> bool:
    """Whether the robot gets home when it turns now, at the accepted risk."""
    return advice.chance_home >= 1.0 - advice.risk


def reserve(advice: Advice, full_j: float) -> float:
    """Share of a full battery that the way home leaves at the accepted risk; 0 from when it must turn."""
    least_j = advice.margin_j.quantile(advice.risk)
    return 0.0 if advice.turn_now else min(max(least_j / full_j, 0.0), 1.0)


def _status(advice: Advice | None, robot: str, warnings: Sequence[str], silent: bool, namespace: str) -> IdlStruct:
    level, text = (_STALE if silent else _WARN if warnings else _OK), "no readings yet"
    values: dict[str, object] = {}
    if advice is not None:
        text = f"turn within {quantities.distance(advice.turn_in_m)}, {quantities.duration(advice.turn_in_s)}"
        if not can_reach_home(advice):
            level, text = _ERROR, f"it may not get home: probability {advice.chance_home:.2%}"
        elif advice.turn_now:
            level, text = max(level, _WARN), "turn now"
        values = {
            "way_home_m": advice.way_home_m, "chance_home": advice.chance_home, "risk": advice.risk,
            "turn_in_m": advice.turn_in_m, "turn_in_s": advice.turn_in_s, "turn_now": advice.turn_now,
        }  # fmt: skip
        for name in ("energy_left_j", "energy_home_j", "margin_j"):
            spread = getattr(advice, name)
            values |= {name: spread.mean, f"{name}_low": spread.low, f"{name}_high": spread.high}
    said = [(name, f"{value:.6g}" if isinstance(value, float) else str(value)) for name, value in values.items()]
    said += [("warning", one) for one in warnings]
    pairs = [message("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in said]
    return message(
        "diagnostic_msgs/msg/DiagnosticStatus", level=level, name=f"{namespace}/{OWN}: way home".lstrip("/"),
        message=text, hardware_id=robot, values=pairs,
    )  # fmt: skip
