"""Recorded runs replayed through the physics: what a robot file predicts, window by window."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.diagnosis.read.signals import WINDOW_S, Array, Signals, Unit, Windows, usual_step_s, windows
from homeward.physics import Robot, replay
from homeward.physics.effects import EFFECTS, Effect, payload

_MOST_WINDOWS = 100_000  # of very long recordings the windows grow instead

_MOST_LOADS = 5  # at which a run is replayed

_SLOW_MPS = 0.02  # wheels slower than this stand: a motor's current vanishes with the motion


@dataclass(frozen=True)
class Runs:
    """The usable runs, averaged over windows and laid end to end; arrays of shape (windows,)."""

    signals: Sequence[Signals]
    windows: Sequence[Windows]
    unit: Unit
    run: NDArray[np.intp]  # which of `signals` a window belongs to
    time_s: Array
    duration_s: Array  # time that a window stands for
    observed: Array
    context: Mapping[str, Array]  # NaN where a run lacks the channel

    @property
    def names(self) -> list[str]:
        """Names of the runs."""
        return [run.name for run in self.signals]


def average(signals: Sequence[Signals], samples: int = 1) -> Runs:
    """Average runs over windows.

    Args:
        signals: Runs with the same unit of what was observed.
        samples: That a window holds at least.
    """
    total_s = sum(float(run.time_s[-1] - run.time_s[0]) for run in signals)
    lengths = [max(WINDOW_S, samples * usual_step_s(run.time_s), total_s / _MOST_WINDOWS) for run in signals]
    cuts = [windows(run.time_s, length) for run, length in zip(signals, lengths, strict=True)]
    pairs = list(zip(signals, cuts, strict=True))
    counts = [int(cut.keep.sum()) for cut in cuts]
    names = dict.fromkeys(name for run in signals for name in run.context)
    context = {
        name: np.concatenate([
            cut.means(run.context[name]) if name in run.context else np.full(int(cut.keep.sum()), np.nan)
            for run, cut in pairs
        ])
        for name in names
    }  # fmt: skip
    return Runs(
        signals,
        cuts,
        signals[0].unit,
        np.repeat(np.arange(len(signals)), counts),
        np.concatenate([cut.means(run.time_s) for run, cut in pairs]),
        np.repeat(lengths, counts),
        np.concatenate([cut.means(run.observed) for run, cut in pairs]),
        context,
    )


def thrust_n_per_a(robot: Robot) -> float:
    """Thrust at the wheels per ampere of motor current, N/A: what gear friction leaves of it.

    The motor loss eta2 is electrical: it takes voltage and no torque.
    """
    return robot.traction_n_per_a * (1.0 - robot.friction_loss)


def power_w(run: Signals, robot: Robot) -> Array:
    """Battery power that a robot file says of a run, W, shape (samples,)."""
    return _loaded(
        robot, run.context.get("payload_kg", np.zeros(1)), run.time_s, run.speed_mps, grade_rad=run.grade_rad,
        yaw_rate_radps=run.yaw_rate_radps, accel_mps2=run.accel_mps2, temperature_c=run.temperature_c,
        sensing_hz=run.sensing_hz, base_distance_m=run.base_distance_m, direction=run.direction,
    )[0]  # fmt: skip


def predict(
    runs: Runs,
    robot: Robot,
    rest_current_a: float = 0.0,
    headwind_mps: Sequence[Array] | None = None,
    lag_s: float = 0.0,
    speed_factors: Sequence[float] | None = None,
    roughness: Array | None = None,
) -> Array:
    """Battery power (W) or motor current (A) that the robot file predicts, shape (windows,).

    Power that was recorded as voltage times current is that at the battery's terminals. Motor current is what the
    motors push with over the thrust per ampere, plus what they draw at rest; a descent that the robot rolls down draws
    none, as in the power of the drive.

    Args:
        runs: The runs.
        robot: The robot.
        rest_current_a: What the motors draw at rest, A.
        headwind_mps: Wind against the direction of travel, m/s, an array per run.
        lag_s: Time by which the instrument is late, s.
        speed_factors: True over recorded speed, a number per run.
        roughness: Of the ground, shape (windows,).
    """
    means = []
    outside = _without_battery(robot)
    loads_kg = [run.context.get("payload_kg", np.zeros(1)) for run in runs.signals]
    for index, (run, cut) in enumerate(zip(runs.signals, runs.windows, strict=True)):
        true = 1.0 if speed_factors is None else speed_factors[index]
        model = _loaded(
            outside if run.at_terminals else robot, loads_kg[index], run.time_s, true * run.speed_mps,
            grade_rad=run.grade_rad, yaw_rate_radps=run.yaw_rate_radps,
            accel_mps2=true * run.accel_mps2, temperature_c=run.temperature_c, sensing_hz=run.sensing_hz,
            base_distance_m=run.base_distance_m, direction=run.direction,
            headwind_mps=0.0 if headwind_mps is None else headwind_mps[index],
            roughness=0.0 if roughness is None else cut.samples(roughness[runs.run == index], len(run.time_s)),
        )  # fmt: skip
        predicted = model[0]
        if runs.unit == "A":
            wheels_mps = np.maximum(np.abs(run.speed_mps), 0.5 * np.abs(run.yaw_rate_radps) * robot.track_m)
            turning = np.minimum(wheels_mps / _SLOW_MPS, 1.0)
            predicted = rest_current_a + turning * model[1] / thrust_n_per_a(robot)
        if lag_s != 0.0:
            predicted = np.interp(run.time_s - lag_s, run.time_s, predicted)
        means.append(cut.means(predicted))
    return np.concatenate(means)


def lost_inside(entry: Effect | Any) -> bool:
    """Whether an effect takes energy inside the battery, and not from what moves."""
    return bool(entry.kind == "battery" and "speed_mps" not in entry.needs)


def _without_battery(robot: Robot) -> Robot:
    """The robot with a battery that loses nothing inside."""
    inside = {effect.id for effect in EFFECTS if lost_inside(effect)}
    if not inside & set(robot.effects):
        return robot
    return dataclasses.replace(robot, effects={name: one for name, one in robot.effects.items() if name not in inside})


def _loaded(robot: Robot, load_kg: Array, time_s: Array, speed_mps: Array, **conditions: Any) -> tuple[Array, Array]:
    """Power and wheel force of a robot with a recorded load beside that of its file, shape (n,) each.

    Between a few loads both are linear in the load, but for the bends where nothing is drawn.
    """
    load_kg = np.nan_to_num(load_kg)
    levels = np.unique(load_kg)
    if len(levels) > _MOST_LOADS:
        levels = np.linspace(levels[0], levels[-1], _MOST_LOADS)
    power_w, force_n = np.zeros(len(time_s)), np.zeros(len(time_s))
    for number, level in enumerate(levels.tolist()):
        model = replay(_with_load(robot, level), time_s, speed_mps, **conditions)
        share = np.interp(load_kg, levels, np.eye(len(levels))[number])
        power_w, force_n = power_w + share * model.power_w, force_n + share * model.wheel_force_n
    return power_w, force_n


def _with_load(robot: Robot, load_kg: float) -> Robot:
    if load_kg == 0.0:
        return robot
    name, switch = payload.EFFECT.id, payload.EFFECT.switch.name
    mass_kg = robot.effects.get(name, {}).get(switch, 0.0) + load_kg
    return dataclasses.replace(robot, effects={**robot.effects, name: {switch: mass_kg}})
