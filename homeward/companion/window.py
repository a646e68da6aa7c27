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
        self.soc = math.nan
        self.stood_s = 0.0
        self.peak_a = -math.inf
        self._read = self.slopes = 0
        self._read_j = self._read_s = self._sine_m = self._graded_m = 0.0
        self._east_m = self._north_m = self._headed_m = self._speed_m = self._speedy_m = 0.0
        self._volt_s = self._amp_s = self._electric_s = 0.0
        self.SAVED = tuple(vars(self))

    def add(
        self, reading: Reading, step: Step, modelled_w: float, drive_w: float, steady_w: float
    ) -> None:
        """Add a reading, with the model's mean powers since the last one: total, of the drive, of
        steady driving."""
        dt_s = reading.dt_s
        way_m = step.way_m
        self.time_s += dt_s
        self.way_m += way_m
        if reading.speed_mps == 0.0:
            self.stood_s += dt_s
        driving_j = steady_w * dt_s
        if reading.speed_mps > 0.0:
            # By the way, which is finite also where a speed is next to nothing.
            driving_j = steady_w / reading.speed_mps * way_m
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
            power_w = modelled_w
            if math.isfinite(reading.power_w):
                power_w = reading.power_w
            current_a = power_w / reading.voltage_v
            if math.isfinite(reading.current_a):
                current_a = reading.current_a
            self._volt_s += reading.voltage_v * dt_s
            self._amp_s += current_a * dt_s
            self.peak_a = max(self.peak_a, current_a)
            self._electric_s += dt_s

    @property
    def power_w(self) -> float:
        """Mean power as read, NaN if it was read for too little of the time."""
        if self._read_s == 0.0 or self._read_s < thresholds.COVERED * self.time_s:
            return math.nan
        return self._read_j / self._read_s

    @property
    def power_noise(self) -> float:
        """Relative error of that beyond the meter's, due to the time without a reading."""
        if self.time_s == 0.0:
            return 0.0
        return thresholds.UNREAD * (1.0 - self._read_s / self.time_s)

    @property
    def of_the_mean(self) -> float:
        """Noise of the mean power over that of a reading."""
        return 1.0 / math.sqrt(max(self._read, 1))

    @property
    def speed_mps(self) -> float:
        """Mean speed over the way, NaN if none was read."""
        return _mean(self._speed_m, self._speedy_m)

    @property
    def sine(self) -> float:
        """Mean sine of the slope in the direction of travel, NaN if none was read."""
        return _mean(self._sine_m, self._graded_m)

    @property
    def direction(self) -> tuple[float, float]:
        """Mean direction of travel, east and north; shorter than 1 where it changed, NaN if none
        was read."""
        return _mean(self._east_m, self._headed_m), _mean(self._north_m, self._headed_m)

    @property
    def electric(self) -> tuple[float, float]:
        """Mean voltage and current, NaN if no voltage was read."""
        return _mean(self._volt_s, self._electric_s), _mean(self._amp_s, self._electric_s)

    def straight(self, change_m: float) -> bool:
        """Whether the way home changed by the distance driven: straight away from home, or back the
        same way."""
        return (
            abs(abs(change_m) - self.way_m)
            <= thresholds.STRAIGHT * max(self.way_m, abs(change_m)) + 1e-6
        )


def _mean(total: float, weight: float) -> float:
    """A weighted mean, NaN if nothing was read."""
    if weight == 0.0:
        return math.nan
    return total / weight
