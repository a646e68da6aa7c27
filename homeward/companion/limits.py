"""What a robot cannot exceed, whatever its instruments say: way, time, speed and power, from its
file."""

from __future__ import annotations

from typing import NamedTuple

from homeward.companion import thresholds
from homeward.physics import Robot, ancillary_power, model


class Limits(NamedTuple):
    """Limits of a robot, each a multiple of what it does by its file.

    Attributes:
        way_m: Longest way home, m.
        gap_s: Longest time without a reading, s; beyond it the clock was set.
        speed_mps: Highest speed, m/s.
        power_w: Largest power, W.
    """

    way_m: float
    gap_s: float
    speed_mps: float
    power_w: float


def limits_of(robot: Robot, range_m: float) -> Limits:
    """Limits of a robot.

    Args:
        robot: The robot.
        range_m: Distance that it drives on one charge, m.
    """
    way_m = thresholds.RANGES * range_m
    force_n = float(model.traction_force(robot, robot.max_speed_mps, thresholds.STEEP_RAD))
    full_w = float(model.drive_power(robot, force_n, robot.max_speed_mps))
    return Limits(
        way_m=way_m,
        gap_s=way_m / robot.min_speed_mps,
        speed_mps=thresholds.TOP_SPEEDS * robot.max_speed_mps,
        power_w=thresholds.POWERS * (full_w + float(ancillary_power(robot, robot.max_sensing_hz))),
    )
