"""Positions by odometry in one frame, also if odometry restarts from zero."""

from __future__ import annotations

import math
from typing import ClassVar

from homeward.watch import thresholds


class Odometry:
    """Keeps the frame of the first pose.

    A robot does not jump because a process restarts. If the publisher has changed and its pose is
    farther away than the robot can have driven, the frame is transformed so that the robot is where
    it was, or would be at constant velocity. A jump without a restart is left to the companion,
    which checks positions.

    Args:
        max_speed_mps: Top speed of the robot.
    """

    SAVED: ClassVar = ("_turn_rad", "_east_m", "_north_m")

    def __init__(self, max_speed_mps: float) -> None:
        self._max_speed_mps = max_speed_mps
        self._publisher: int | None = None
        self._turn_rad = 0.0
        self._east_m = 0.0
        self._north_m = 0.0
        self._last: tuple[float, float, float] | None = None
        self._last_s = 0.0
        self._speed_mps = 0.0

    def place(
        self, pose: tuple[float, float, float], speed_mps: float, publisher: int, now_s: float
    ) -> tuple[tuple[float, float, float], bool]:
        """A pose in the frame of the first one, and whether the frame was moved for it.

        Args:
            pose: As published: m, m, rad.
            speed_mps: Speed of the robot, m/s, NaN if not known.
            publisher: Identity of the publisher.
            now_s: Time of receipt, s.
        """
        moved = False
        if self._last is not None and publisher != self._publisher:
            since_s = now_s - self._last_s
            apart_m = math.dist(self._in_frame(pose)[:2], self._last[:2])
            possible_m = (
                thresholds.SAME_FRAME_M + thresholds.TOP_SPEEDS * self._max_speed_mps * since_s
            )
            if apart_m > possible_m:
                self._anchor(pose, since_s)
                moved = True
        self._publisher = publisher
        self._last = self._in_frame(pose)
        self._last_s = now_s
        self._speed_mps = speed_mps if math.isfinite(speed_mps) else 0.0
        return self._last, moved

    def _in_frame(self, pose: tuple[float, float, float]) -> tuple[float, float, float]:
        """A pose as published, in the frame of the first one: turned and moved."""
        x_m, y_m, yaw_rad = pose
        cos = math.cos(self._turn_rad)
        sin = math.sin(self._turn_rad)
        east_m = self._east_m + cos * x_m - sin * y_m
        north_m = self._north_m + sin * x_m + cos * y_m
        return east_m, north_m, yaw_rad + self._turn_rad

    def _anchor(self, pose: tuple[float, float, float], since_s: float) -> None:
        """Move the frame so that a pose is where the robot would be at constant velocity."""
        assert self._last is not None
        east_m, north_m, yaw_rad = self._last
        way_m = self._speed_mps * since_s
        self._turn_rad = yaw_rad - pose[2]
        self._east_m = 0.0
        self._north_m = 0.0
        turned_east_m, turned_north_m, _ = self._in_frame(pose)
        self._east_m = east_m + way_m * math.cos(yaw_rad) - turned_east_m
        self._north_m = north_m + way_m * math.sin(yaw_rad) - turned_north_m
