"""Those who decide when to turn: the companion, two rules of thumb, and a mirror rule that only
estimates."""

from __future__ import annotations

import math
import time
import traceback
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.on_the_robot.gauges.cell import Floats
from benchmarks.on_the_robot.gauges.instruments import Readings
from benchmarks.on_the_robot.gauges.sizes import RuleSizes
from homeward.companion import Advice, Companion

Z90 = 1.6449  # half the width of a normal's 90 % interval, in standard deviations
CLOCK_STEP_S = 600.0  # chosen: updates so far apart are a step of the clock
CHECK_EVERY = 20  # chosen: the ends of an interval cost more than the rest of an update


@dataclass(frozen=True)
class Estimate:
    """An estimate of an energy, J, with the ends of its 90 % interval."""

    mean_j: float
    low_j: float
    high_j: float


@dataclass
class CompanionRun:
    """What the companion said on a way out.

    Attributes:
        turn: Index of the update at which it said to turn; None if it never did.
        advice: Its advice at each update up to there; None where no reading came through.
        updates: How many updates there were.
        seconds: Computing time of all updates, s.
        crash: The exception that ended it, in a line; "" if none.
        faults: Inconsistent advice, a sentence each, without repetition.
        most_left: Largest mean of the energy left over the rated energy.
        companion: The companion as it is after the last update.
    """

    turn: int | None = None
    advice: list[Advice | None] = field(default_factory=list)
    updates: int = 0
    seconds: float = 0.0
    crash: str = ""
    faults: dict[str, int] = field(default_factory=dict)
    most_left: float = 0.0
    companion: Companion | None = None

    def estimates(self, index: int) -> tuple[Estimate, Estimate] | None:
        """Energy left and energy of the way home at an update or the last before it; None before
        the first."""
        for earlier in range(min(index, len(self.advice) - 1), -1, -1):
            advice = self.advice[earlier]
            if advice is not None:
                left = advice.energy_left_j
                home = advice.energy_home_j
                return Estimate(left.mean, left.low, left.high), Estimate(
                    home.mean, home.low, home.high
                )
        return None


def run_companion(
    robot_file: Path,
    readings: Readings,
    cruise_mps: float,
    cutoff_v: float | None,
    rated_energy_j: float,
    told_soc: float | None,
    more: Mapping[str, Any],
) -> CompanionRun:
    """Let the companion read along the way out until it says to turn.

    An exception in an update ends the advice, so that the robot drives on until its battery is cut
    off. An exception at the construction is one of this benchmark, or of the installed version, and
    ends the whole run.

    Args:
        robot_file: The robot file that it gets.
        readings: What the instruments read.
        cruise_mps: Speed at which the robot would drive home.
        cutoff_v: Voltage of the cut-off, if the user knows it.
        rated_energy_j: Energy on the label, to notice estimates above it.
        told_soc: State of charge at the start as the user says; None: the gauge shows it.
        more: Other arguments of the companion.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the file's pack may be unusual for its robot
        companion = Companion(
            robot_file,
            home=(0.0, 0.0),
            cruise_mps=cruise_mps,
            cutoff_v=cutoff_v,
            soc=told_soc,
            **more,
        )
    run = CompanionRun(companion=companion)
    start_s = time.perf_counter()
    try:
        _read_along(companion, readings, rated_energy_j, run)
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        run.crash = f"{type(error).__name__}: {error} ({Path(frame.filename).name}:{frame.lineno})"
    run.seconds = time.perf_counter() - start_s
    return run


def _read_along(
    companion: Companion, readings: Readings, rated_energy_j: float, run: CompanionRun
) -> None:
    """Call `update` with each reading until the companion says to turn, and fill `run`."""
    voltage_v = _optional(readings.voltage_v)
    current_a = _optional(readings.current_a)
    soc = _optional(readings.soc)
    speed_mps = _optional(readings.speed_mps)
    grade_rad = _optional(readings.grade_rad)
    heading_rad = _optional(readings.heading_rad)
    temperature_c = _optional(readings.temperature_c)
    east_m = _optional(readings.position_m[:, 0])
    north_m = _optional(readings.position_m[:, 1])
    for index, clock_s in enumerate(readings.time_s.tolist()):
        if not readings.there[index]:
            run.advice.append(None)
            continue
        east = east_m[index]
        north = north_m[index]
        advice = companion.update(
            clock_s,
            speed_mps=speed_mps[index],
            voltage_v=voltage_v[index],
            current_a=current_a[index],
            soc=soc[index],
            grade_rad=grade_rad[index],
            heading_rad=heading_rad[index],
            position=None if east is None or north is None else (east, north),
            temperature_c=temperature_c[index],
        )
        run.advice.append(advice)
        run.updates += 1
        _check(advice, index, rated_energy_j, run)
        if advice.turn_now:
            run.turn = index
            return


def _check(advice: Advice, index: int, rated_energy_j: float, run: CompanionRun) -> None:
    """Note advice that contradicts itself or the label."""
    left = advice.energy_left_j
    home = advice.energy_home_j
    run.most_left = max(run.most_left, left.mean / rated_energy_j)
    numbers = (
        left.mean,
        home.mean,
        advice.chance_home,
        advice.turn_in_m,
        advice.turn_in_s,
        advice.way_home_m,
    )
    if any(math.isnan(number) for number in numbers):
        _note("not a number", run)
    if left.mean < 0.0 or home.mean < 0.0:
        _note("a negative energy", run)
    if not 0.0 <= advice.chance_home <= 1.0:
        _note("a probability outside 0 to 1", run)
    if advice.turn_now and advice.turn_in_m > 0.0:
        _note("turn now, and some way left to drive on", run)
    if index % CHECK_EVERY == 0 or advice.turn_now:
        for name, energy in (("left", left), ("of the way home", home)):
            if not energy.low <= energy.mean <= energy.high:
                _note(f"mean of the energy {name} outside its interval", run)


def _note(fault: str, run: CompanionRun) -> None:
    """Count a fault."""
    run.faults[fault] = run.faults.get(fault, 0) + 1


def _optional(values: Floats) -> list[float | None]:
    """The same values as a list, None for NaN."""
    return [None if math.isnan(value) else value for value in values.tolist()]


def turn_at_half(readings: Readings, rules: RuleSizes) -> int | None:
    """Index of the first update at which the gauge shows less than half; None if it never does."""
    below = readings.there & (readings.soc < rules.turn_share)
    return _first(below)


def turn_at_reserve(readings: Readings, rules: RuleSizes) -> int | None:
    """Index of the first update at which the used share times 1.2 is the share left; None if it
    never is."""
    start = first_shown(readings)
    reached = readings.there & (rules.reserve_factor * (start - readings.soc) >= readings.soc)
    return _first(reached)


def has_gauge(readings: Readings) -> bool:
    """Whether the gauge shows anything."""
    return bool(np.isfinite(readings.soc).any())


def first_shown(readings: Readings) -> float:
    """The first share that the gauge shows; NaN without a gauge."""
    shown = readings.soc[np.isfinite(readings.soc)]
    return float(shown[0]) if shown.size else math.nan


def _first(flags: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> int | None:
    """Index of the first true flag."""
    indices = np.flatnonzero(flags)
    return int(indices[0]) if indices.size else None


def mirror(
    readings: Readings, index: int, rated_energy_j: float, rules: RuleSizes
) -> tuple[Estimate, Estimate] | None:
    """Estimate energy left and way home without a model; None if the robot records too little for
    it.

    The way home takes what the way out has taken so far, by the meter if there is one, else by the
    gauge. The energy left is the rated energy times the share shown, or the rated energy less what
    was metered. A tenth is their uncertainty.
    """
    shown = readings.soc[: index + 1][readings.there[: index + 1]]
    shown = shown[np.isfinite(shown)]
    metered_j = _metered_j(readings, index)
    if math.isfinite(metered_j):
        home_j = metered_j
    elif shown.size:
        home_j = max(float(shown[0] - shown[-1]), 0.0) * rated_energy_j
    else:
        return None
    left_j = (
        float(shown[-1]) * rated_energy_j if shown.size else max(rated_energy_j - metered_j, 0.0)
    )
    return _mirror_estimate(left_j, rated_energy_j, rules), _mirror_estimate(
        home_j, rated_energy_j, rules
    )


def _mirror_estimate(mean_j: float, rated_energy_j: float, rules: RuleSizes) -> Estimate:
    """An estimate with a standard deviation of a tenth."""
    sd_j = max(rules.mirror_sd_share * mean_j, rules.mirror_sd_floor_share * rated_energy_j)
    return Estimate(mean_j, mean_j - Z90 * sd_j, mean_j + Z90 * sd_j)


def metered_share(readings: Readings, true_w: Floats, index: int) -> float:
    """What the robot's meter has read so far over what it should have read; 1 without a meter."""
    power_w = readings.voltage_v[: index + 1] * readings.current_a[: index + 1]
    measured = readings.there[: index + 1] & np.isfinite(power_w)
    if not measured.any():
        return 1.0
    return float(power_w[measured].mean() / true_w[: index + 1][measured].mean())


def _metered_j(readings: Readings, index: int) -> float:
    """Energy by the meter up to an update, J; NaN without one. A missing reading counts as the mean
    of the others."""
    power_w = readings.voltage_v[: index + 1] * readings.current_a[: index + 1]
    measured = readings.there[: index + 1] & np.isfinite(power_w)
    if not measured.any():
        return math.nan
    # The clock may have stepped. Updates are not evenly spaced, so that their median is not their
    # mean.
    lengths_s = np.diff(readings.time_s[: index + 1])
    usual = (lengths_s > 0.0) & (lengths_s < CLOCK_STEP_S)
    update_s = float(lengths_s[usual].mean()) if usual.any() else 0.0
    return float(power_w[measured].mean()) * update_s * (index + 1)
