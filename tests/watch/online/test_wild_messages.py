"""Whatever is published, `homeward watch --ros2` goes on, and its advice is finite."""

import math
import time
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs the extra ros2")

from homeward.companion import Companion
from homeward.watch.online.node import Node
from homeward.watch.ros2.network import Network
from tests.companion.test_wild import check
from tests.watch.ros2.simulated_robot import DOMAIN, LONGEST_S

pytestmark = pytest.mark.usefixtures("loopback")

WILD = (math.nan, math.inf, -math.inf, 1e308, -1e300, 1e19, 1e12, 5e-324, -1.0, 0.0)
LEAST_ADVICE = 150


def stamped(now_s: float) -> dict[str, Any]:
    """A header with this time."""
    return {"stamp": {"sec": int(now_s), "nanosec": int(now_s % 1.0 * 1e9)}, "frame_id": "odom"}


def battery(
    now_s: float, voltage_v: float, current_a: float, soc: float
) -> tuple[str, str, dict[str, Any]]:
    content = {
        "header": stamped(now_s),
        "voltage": voltage_v,
        "current": current_a,
        "percentage": soc,
    }
    return "/battery_state", "sensor_msgs/msg/BatteryState", content


def odometry(
    now_s: float, east_m: float, north_m: float, speed_mps: float, turn: float
) -> tuple[str, str, dict[str, Any]]:
    pose = {"position": {"x": east_m, "y": north_m}, "orientation": {"z": turn, "w": 1.0}}
    content = {
        "header": stamped(now_s), "pose": {"pose": pose}, "twist": {"twist": {"linear": {"x": speed_mps}}},
    }  # fmt: skip
    return "/odom", "nav_msgs/msg/Odometry", content


def test_no_message_ends_the_session_or_corrupts_its_advice() -> None:
    rng = np.random.default_rng(0)
    companion = Companion("husky", home="here")
    node, robot = Node(companion, Network(DOMAIN)), Network(DOMAIN)

    def read(sane: float, wild_share: float) -> float:
        return float(rng.choice(WILD)) if rng.random() < wild_share else sane

    began_s, advised, said = time.monotonic(), 0, set()
    while advised < LEAST_ADVICE:
        now_s = time.time()
        since_s = time.monotonic() - began_s
        assert since_s < LONGEST_S, (node.messages, node.warnings)
        share = 0.0 if node.advice is None else 0.4
        robot.publish(*odometry(now_s, *(read(sane, share) for sane in (since_s, 0.0, 1.0, 0.1))))
        volts, amperes, soc = (read(sane, share) for sane in (24.0, -6.0, 0.9))
        # Single precision holds no more.
        with np.errstate(over="ignore"):
            robot.publish(
                *battery(now_s, *(float(np.float32(value)) for value in (volts, amperes, soc)))
            )
        if node.step() and node.advice is not None:
            advised += 1
            check(node.advice, companion.robot.usable_energy_j)
            said |= {text.split(" left out")[0] for text in node.warnings}
        time.sleep(0.01)
    assert {"impossible position", "readings of speed_mps that no motion explains are"} <= said, (
        said
    )
    assert node.failures == []
    assert node.advice is not None and node.advice.way_home_m < 100.0
