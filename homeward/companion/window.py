"""Readings since the last update of the estimator, averaged."""

from __future__ import annotations

import math

from homeward.companion import thresholds
from homeward.companion.readings import Reading
from homeward.companion.way import Step


class Window:
    """Sums since the last update of the estimator.

    Attributes:
        time_s: Its length, s.
        way_m: Distance driven, m.
        modelled_j: Energy by the robot's own model, with the slopes as read, J.
        other_j: Part of it beyond steady driving: electronics, turning, accelerating, J.
        extra_j: Part of that due to the drive, J.
        slopes: Number of slope readings.
        soc: Last reading of the state of charge, NaN if none.
        stood_s: Time for which the speed read 0, s.
        peak_a: Largest current, A, minus infinity if no voltage was read.
    """

    def __init__(self) -> None:
        self.time_s = self.way_m = self.modelled_j = self.other_j = self.extra_j = 0.0
        self.soc, self.stood_s, self.peak_a = math.nan, 0.0, -math.inf
        self._read = self.slopes = 0
        self._read_j = self._read_s = self._sine_m = self._graded_m = 0.0
        self._east_m = self._north_m = self._headed_m = self._speed_m = self._speedy_m = 0.0
        self._volt_s = self._amp_s = self._electric_s = 0.0
        self.SAVED = tuple(vars(self))

    def add(self, reading: Reading, step: Step, modelled_w: float, drive_w: float, steady_w: float) -> None:
        """Add a reading, with the model's mean powers since the last one: total, of the drive, of steady driving."""
        dt_s, way_m = reading.dt_s, step.way_m
        self.time_s += dt_s
        self.way_m += way_m
        self.stood_s += dt_s if reading.speed_mps == 0.0 else 0.0
        # By the way: energy per metre, which is finite also where a speed is next to nothing. Without a speed: by time.
        driving_j = steady_w / reading.speed_mps * way_m if reading.speed_mps > 0.0 else steady_w * dt_s
        self.modelled_j += (modelled_w - steady_w) * dt_s + driving_j
        self.other_j += (modelled_w - steady_w) * dt_s
        self.extra_j += (drive_w - steady_w) * dt_s
        if math.isfinite(reading.power_w):
            self._read_j += reading.power_w * dt_s
            self._read_s += dt_s
            self._read += 1
        if math.isfinite(reading.soc):
            self.soc = reading.soc
        if math.isfinite(reading.grade_rad):
            self.slopes += 1
            self._sine_m += math.sin(reading.grade_rad) * way_m
            self._graded_m += way_m
        if math.isfinite(step.heading_rad):
            self._east_m += math.cos(step.heading_rad) * way_m
            self._north_m += math.sin(step.heading_rad) * way_m
            self._headed_m += way_m
        if math.isfinite(reading.speed_mps) and reading.speed_mps != 0.0:
            self._speed_m += abs(reading.speed_mps) * way_m
            self._speedy_m += way_m
        if math.isfinite(reading.voltage_v):
            # A current that is not read follows from the power, and that from the model.
            power_w = reading.power_w if math.isfinite(reading.power_w) else modelled_w
            current_a = reading.current_a if math.isfinite(reading.current_a) else power_w / reading.voltage_v
            self._volt_s += reading.voltage_v * dt_s
            self._amp_s += current_a * dt_s
            self.peak_a = max(self.peak_a, current_a)
            self._electric_s += dt_s

    @property
    def power_w(self) -> float:
        """Mean power as read, NaN if it was read for too little of the time."""
        return (
            self._read_j / self._read_s
            if self._read_s >= thresholds.COVERED * self.time_s and self._read_s
            else math.nan
        )

    @property
    def power_noise(self) -> float:
        """Relative error of that beyond the meter's, due to the time without a reading."""
        return thresholds.UNREAD * (1.0 - self._read_s / self.time_s) if self.time_s else 0.0

    @property
    def of_the_mean(self) -> float:
        """Noise of the mean power over that of a reading."""
        return 1.0 / math.sqrt(max(self._read, 1))

    @property
    def speed_mps(self) -> float:
        """Mean speed over the way, NaN if none was read."""
        return self._speed_m / self._speedy_m if self._speedy_m else math.nan

    @property
    def sine(self) -> float:
        """Mean sine of the slope in the direction of travel, NaN if none was read."""
        return self._sine_m / self._graded_m if self._graded_m else math.nan

    @property
    def direction(self) -> tuple[float, float]:
        """Mean direction of travel, east and north; shorter than 1 where it changed, NaN if none was read."""
        if not self._headed_m:
            return math.nan, math.nan
        return self._east_m / self._headed_m, self._north_m / self._headed_m

    @property
    def electric(self) -> tuple[float, float]:
        """Mean voltage and current, NaN if no voltage was read."""
        if not self._electric_s:
            return math.nan, math.nan
        return self._volt_s / self._electric_s, self._amp_s / self._electric_s

    def straight(self, change_m: float) -> bool:
        """Whether the way home changed by the distance driven: straight away from home, or back the same way."""
        return abs(abs(change_m) - self.way_m) <= thresholds.STRAIGHT * max(self.way_m, abs(change_m)) + 1e-6
