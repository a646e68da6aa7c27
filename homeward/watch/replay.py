"""A recording replayed to a companion as if live: predicted against measured energy of the rest.

The way, the speeds and the stops of the rest are taken from the recording, as if the robot had a
map and a schedule. What is tested is the companion's estimate of the robot, the ground and the
wind.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.companion import Advice, Companion, CompanionError, UncertainValue
from homeward.companion import thresholds as companion_thresholds
from homeward.companion.companion import WINDOWS as WINDOWS_A_CHARGE
from homeward.diagnosis.fit.signs import wrong_slopes
from homeward.diagnosis.fit.usable import fault_of
from homeward.diagnosis.read.signals import Signals, signals, slopes_known, speed_of, steps_s
from homeward.estimation import WAY_DTYPE, Prior
from homeward.estimation.drive import modelled_driving
from homeward.logs.recordings import Recording
from homeward.physics import Robot, d_max, optimal_speed, replay
from homeward.physics.terminal_power import at_terminals
from homeward.watch.charge import watch_charge
from homeward.watch.predictions import LEAST_WINDOW_S, WINDOWS, Watched, rest_of

Array = NDArray[np.float64]

_STRETCHES = 48
"""Stretches of a recording's way, of equal length, with uniform ground, wind and speed. Chosen: 2 %
of the way each; more take longer."""
_MOST_FED = 20_000
"""Maximum number of samples; longer recordings are averaged over neighbours. Chosen: an update
takes 0.3 ms (docs/results.md), so that these take six seconds."""


class Rest:
    """The rest of a recording from any of its samples, as a map and a schedule give it."""

    def __init__(self, run: Signals, companion: Companion) -> None:
        self._vehicle = companion.vehicle
        step_s = np.append(steps_s(run.time_s), 0.0)
        self.way_m = np.abs(run.speed_mps) * step_s
        direction = np.where(run.speed_mps < 0.0, -1.0, 1.0)
        heading_rad = heading_of(run)
        robot = at_terminals(companion.robot) if run.at_terminals else companion.robot
        modelled = replay(
            robot, run.time_s, run.speed_mps, grade_rad=run.grade_rad, yaw_rate_radps=run.yaw_rate_radps,
            accel_mps2=run.accel_mps2, temperature_c=run.temperature_c, sensing_hz=run.sensing_hz,
            base_distance_m=run.base_distance_m, direction=run.direction,
        )  # fmt: skip
        self.left_m = rest_of(self.way_m)
        self.took_j = rest_of(run.observed * step_s)
        self._modelled_j = rest_of(modelled.power_w * step_s)
        # Sums over the way, by the field of `WAY_DTYPE` whose mean they give.
        self._sums_m = {
            "sine": rest_of(direction * np.sin(run.grade_rad) * self.way_m),
            "speed_mps": rest_of(np.abs(run.speed_mps) * self.way_m),
            "east": rest_of(direction * np.cos(heading_rad) * self.way_m),
            "north": rest_of(direction * np.sin(heading_rad) * self.way_m),
        }
        # First samples of the stretches: the way left falls.
        edges_m = self.left_m[0] * (1.0 - np.arange(_STRETCHES + 1) / _STRETCHES)
        self._edges = np.unique(np.searchsorted(-self.left_m, -edges_m))
        self._edges[-1] = len(run.time_s)

    def from_sample(self, sample: int) -> tuple[NDArray[np.void], float]:
        """Stretches of the rest, `WAY_DTYPE`, and the model's energy of all else in it, J."""
        starts = np.concatenate(([sample], self._edges[self._edges > sample])).astype(np.intp)
        ways = np.zeros(len(starts) - 1, WAY_DTYPE)
        length_m = -np.diff(self.left_m[starts])
        is_driven = length_m > 0.0
        per_m = 1.0 / np.where(is_driven, length_m, 1.0)
        for name, sum_m in self._sums_m.items():
            ways[name] = -np.diff(sum_m[starts]) * per_m
        ways["way_m"] = length_m
        ways = ways[is_driven & (ways["speed_mps"] > 0.0)]
        steady_j = 0.0
        for way in ways:
            steady_j += (
                modelled_driving(self._vehicle, float(way["sine"]), float(way["speed_mps"]))
                * way["way_m"]
            )
        return ways, float(self._modelled_j[sample] - steady_j)


def heading_of(run: Signals) -> Array:
    """Heading, as recorded or integrated from the turning rate from east, rad, shape (n,)."""
    if "heading_rad" in run.context and np.isfinite(run.context["heading_rad"]).all():
        return run.context["heading_rad"]
    return np.concatenate(([0.0], np.cumsum(run.yaw_rate_radps[:-1] * steps_s(run.time_s))))


def turns(recording: Recording) -> bool:
    """Whether a recording contains the direction of travel."""
    return any(
        name in recording.channels for name in ("heading_rad", "yaw_rate_radps", "wheel_left_mps")
    )


def window_of(robot: Robot, duration_s: float) -> float:
    """Time over which readings are averaged, s: the companion's own, or less for a short
    recording."""
    lasts_s = float(d_max(robot)) / float(optimal_speed(robot))
    return max(min(lasts_s / WINDOWS_A_CHARGE, duration_s / WINDOWS), LEAST_WINDOW_S)


def watch(
    recording: Recording,
    robot: Robot,
    *,
    soc: float | None = None,
    prior: Prior | None = None,
    risk: float = companion_thresholds.RISK,
    cutoff_v: float | None = None,
    capacity_j: float | None = None,
    cruise_mps: float | None = None,
    show: Callable[[Advice, float, float], None] | None = None,
) -> Watched:
    """Replay a recording to a companion whose home is where it began; for motor currents see
    `watch_charge`.

    Args:
        recording: A recording with battery power, or voltage and current.
        robot: The robot of the file.
        soc: State of charge at the start; by default as recorded, or full.
        prior: Prior of the estimator, instead of the one that follows from the file.
        risk: Accepted probability of not getting home.
        cutoff_v: Voltage at which the battery is cut off; by default that of the robot's file, or
            what is usual for its cells.
        capacity_j: Energy that this battery gave when it was last discharged from full, J, see
            `Companion`.
        cruise_mps: Speed on the way home in the advice that is shown, m/s; the rest has the
            recorded speeds.
        show: Called with each advice, the time in the recording and its duration, s.

    Raises:
        CompanionError: The recording has motor current only, and the file has no uncertainty of
            charge; the robot stood; or it is too short, or in another unit.
    """
    run = signals(recording, robot)
    if not slopes_known([run]):
        run = signals(recording, robot, sloped=False)
    if run.unit == "A":
        return watch_charge(run, robot)
    fault = fault_of(run, robot)
    if fault:
        raise CompanionError(f"{recording.name}: {fault}")
    duration_s = float(run.time_s[-1] - run.time_s[0])
    window_s = window_of(robot, duration_s)
    has_turns = turns(recording)
    companion = Companion(
        robot, home="here" if has_turns else None, soc=soc, prior=prior, risk=risk, cutoff_v=cutoff_v,
        capacity_j=capacity_j, cruise_mps=cruise_mps, window_s=window_s,
    )  # fmt: skip
    rest = Rest(run, companion)
    if rest.left_m[0] <= 0.0:
        raise CompanionError(
            f"{recording.name}: the robot stood all the time; there is no way to predict"
        )
    readings = _readings(recording, run, has_turns)
    # time, way left, energy of the rest, prediction
    moments: list[tuple[float, float, float, UncertainValue]] = []
    warned_s: dict[str, float] = {}  # when first, by kind of warning
    wrong_sign = wrong_slopes([run], robot)
    if wrong_sign is not None:
        warned_s[wrong_sign] = 0.0
    next_s = 0.0
    advice = None
    stride = math.ceil(len(run.time_s) / _MOST_FED)  # samples of which each reading is the mean
    for start in range(0, len(run.time_s), stride):
        end = min(start + stride, len(run.time_s))
        sample = end - 1
        since_s = float(run.time_s[sample] - run.time_s[0])
        reading = {name: _mean(values[start:end]) for name, values in readings.items()}
        advice = companion.update(since_s, **reading)
        for text in advice.warnings:
            kind = text.split(":")[0].split(" (")[0]
            warned_s.setdefault(kind, since_s)
        if show is not None:
            show(advice, since_s, duration_s)
        if since_s >= next_s and rest.left_m[sample] > 0.0:
            ways, constant_j = rest.from_sample(sample)
            predicted_j = companion.ahead(ways, constant_j)
            moments.append(
                (since_s, float(rest.left_m[sample]), float(rest.took_j[sample]), predicted_j)
            )
            next_s = since_s + window_s
    if advice is None or not moments:
        first_s = float(run.time_s[min(stride, len(run.time_s)) - 1] - run.time_s[0])
        raise CompanionError(
            f"{recording.name}: the robot moves only in the first {first_s:.3g} s, before the first reading; "
            "there is no way to predict"
        )
    predictions = [predicted_j for _, _, _, predicted_j in moments]
    return Watched(
        name=recording.name,
        time_s=np.array([time_s for time_s, _, _, _ in moments]),
        left_m=np.array([left_m for _, left_m, _, _ in moments]),
        took_j=np.array([took_j for _, _, took_j, _ in moments]),
        mean_j=np.array([spread.mean for spread in predictions]),
        low_j=np.array([spread.low for spread in predictions]),
        high_j=np.array([spread.high for spread in predictions]),
        length_m=float(rest.left_m[0]),
        rests_on=advice.rests_on,
        warnings=tuple((first_s, kind) for kind, first_s in warned_s.items()),
        advice=advice,
    )


def _mean(values: Array) -> float | None:
    """Mean of the known values; None where none is known."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else None


def _readings(recording: Recording, run: Signals, has_turns: bool) -> dict[str, Array]:
    """Readings for the companion, arrays of shape (n,): as recorded if the robot would read them
    so.

    A slope from elevations is smoothed over the drive, and a heading is integrated from turning
    rates.
    """
    raw = recording.channels
    is_kept = np.isin(raw["time_s"], run.time_s)
    channels: dict[str, Array] = {"speed_mps": speed_of(raw)[is_kept], "sensing_hz": run.sensing_hz}
    for name in ("voltage_v", "current_a", "soc"):
        if name in raw:
            channels[name] = raw[name][is_kept]
    if "power_w" in raw:
        channels["power_w"] = raw["power_w"][is_kept]
    if "grade_rad" in run.context:
        grade_rad = raw["grade_rad"][is_kept] if "grade_rad" in raw else run.grade_rad
        # along the way it drives
        channels["grade_rad"] = np.where(run.speed_mps < 0.0, -grade_rad, grade_rad)
    if has_turns:
        channels["heading_rad"] = heading_of(run)
    else:
        # No heading: the distance from home is the distance driven.
        steps_m = np.abs(run.speed_mps[:-1]) * steps_s(run.time_s)
        channels["position"] = np.concatenate(([0.0], np.cumsum(steps_m)))
    return channels


def run_all(
    recordings: list[Recording],
    robot: Robot,
    show: Callable[..., Any] | None = None,
    **keywords: Any,
) -> list[Watched]:
    """Replay recordings one after the other, see `watch`.

    Raises:
        CompanionError: As of `watch`, or some have power and others motor currents.
    """
    runs = [
        watch(
            recording,
            robot,
            show=None if show is None else _named(show, recording.name),
            **keywords,
        )
        for recording in recordings
    ]
    if len({run.unit for run in runs}) > 1:
        raise CompanionError(
            "some recordings have power and others motor currents only; watch them separately"
        )
    return runs


def _named(show: Callable[..., Any], name: str) -> Callable[[Advice, float, float], None]:
    def shown(advice: Advice, since_s: float, duration_s: float) -> None:
        show(name, advice, since_s, duration_s)

    return shown
