"""Live readings that are possible and yet of another unit, doubted by the code for files
(`homeward.logs.doubts`)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from homeward.logs import thresholds as logs_thresholds
from homeward.logs.channels import Array
from homeward.logs.doubts import doubts, drawn_w, turned_slopes
from homeward.physics import Robot
from homeward.physics.model import GRAVITY_MPS2
from homeward.watch import thresholds

if TYPE_CHECKING:
    from homeward.watch.online.listener import Heard

_MEAN_S = 2.0
"""Driving time of a mean at first. Chosen: above the interval of most monitors of a battery."""
_MOST = 1000
"""Means that are kept; from then on each is of twice the time. Chosen: half an hour in some 60
kB."""
_SPOKEN = (
    "heading_rad", "temperature_c", "soc", "power_w", "voltage_v", "current_a", "motor_left_a", "motor_right_a",
)  # fmt: skip
_CLIMB = "climb_mps"


class Doubted:
    """Keeps means over the drive, and says what speaks against a unit. A robot that stands shows
    nothing.

    Args:
        robot: The robot, whose weight a climb asks for.

    Attributes:
        lines: What is doubted, a line each.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.lines: list[str] = []
        self._mean_s = _MEAN_S
        self._driven_s = 0.0
        self._last_s = math.nan
        self._window: list[dict[str, float]] = []
        self._window_s = 0.0
        self._means: list[dict[str, float]] = []

    def see(self, heard: Heard) -> None:
        """Add readings."""
        passed_s = heard.time_s - self._last_s
        self._last_s = heard.time_s
        speed_mps = heard.reading.get("speed_mps", math.nan)
        if not abs(speed_mps) > logs_thresholds.STANDSTILL_MPS or not passed_s > 0.0:
            return
        # The heading is the channel as it was received; that of the reading may be of the pose.
        channels = {
            **heard.values,
            **heard.reading,
            "heading_rad": heard.values.get("heading_rad", math.nan),
        }
        row = {name: channels[name] for name in _SPOKEN if channels.get(name) is not None}
        row["speed_mps"] = abs(speed_mps)
        row[_CLIMB] = abs(speed_mps) * math.sin(channels.get("grade_rad", math.nan))
        self._window.append(row)
        self._window_s += passed_s
        self._driven_s += passed_s
        if self._window_s >= self._mean_s:
            self._end_window()

    def _end_window(self) -> None:
        """Keep the means of the window, and doubt anew what they show."""
        self._means.append({"time_s": self._driven_s, **_mean_of(self._window)})
        self._window = []
        self._window_s = 0.0
        if len(self._means) >= _MOST:
            self._means = self._means[::2]
            self._mean_s *= 2.0
        if self._driven_s >= thresholds.DOUBTED_S:
            self.lines = self._doubts()

    def _doubts(self) -> list[str]:
        channels = {
            name: np.array([mean.get(name, math.nan) for mean in self._means])
            for name in ("time_s", "speed_mps", _CLIMB, *_SPOKEN)
        }
        channels = {name: values for name, values in channels.items() if np.isfinite(values).any()}
        lines = list(doubts(channels).values())
        power_w = drawn_w(channels)
        if power_w is not None and _CLIMB in channels:
            slopes = _turned(channels[_CLIMB], channels["speed_mps"], power_w, self._robot)
            if slopes is not None:
                lines.append(slopes)
        return lines


def _mean_of(rows: list[dict[str, float]]) -> dict[str, float]:
    """Means of the known values, by name."""
    means = {}
    for name in {name for row in rows for name in row}:
        values = [row[name] for row in rows if math.isfinite(row.get(name, math.nan))]
        if values:
            means[name] = sum(values) / len(values)
    return means


def _turned(climb_mps: Array, speed_mps: Array, power_w: Array, robot: Robot) -> str | None:
    is_known = np.isfinite(climb_mps) & np.isfinite(power_w)
    single_run = np.zeros(int(is_known.sum()), np.intp)
    weight_n = robot.mass_kg * GRAVITY_MPS2
    return turned_slopes(
        climb_mps[is_known],
        speed_mps[is_known],
        power_w[is_known],
        single_run,
        weight_n,
        robot.name,
    )
