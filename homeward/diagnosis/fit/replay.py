"""What a robot file predicts for recorded runs: their motion replayed through the physics, averaged
over windows."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from homeward.diagnosis.read.signals import WINDOW_S, Signals, Unit, Windows, windows
from homeward.logs import thresholds as logs_thresholds
from homeward.logs.channels import Array, Index
from homeward.logs.times import median_step_s
from homeward.physics import Robot
from homeward.physics.effects import payload
from homeward.physics.log_replay import Recorded
from homeward.physics.terminal_power import at_terminals

# beyond it the windows get longer; chosen: bounds time and memory, 14 hours of driving
_MOST_WINDOWS = 100_000
# payload levels at which a run is replayed; chosen: power is piecewise linear in the load
_MOST_LOADS = 5


@dataclass(frozen=True)
class Runs:
    """The usable runs, averaged over windows and concatenated; arrays of shape (windows,)."""

    signals: Sequence[Signals]
    windows: Sequence[Windows]
    unit: Unit
    run: Index  # which of `signals` a window belongs to
    time_s: Array
    duration_s: Array  # length of a window
    observed: Array  # mean power, W, or motor current, A
    context: Mapping[str, Array]  # NaN where a run lacks the channel

    def has(self, name: str) -> bool:
        """Whether every run has a channel."""
        if name not in self.context:
            return False
        recorded_windows = np.bincount(self.run, np.isfinite(self.context[name]))
        return bool(recorded_windows.all())

    def squared_error(self, predicted: Array) -> float:
        """Squared error of a prediction, shape (windows,), summed over windows."""
        return float(np.sum((self.observed - predicted) ** 2))

    @property
    def elapsed_s(self) -> Array:
        """Time since the first window of the run, s."""
        return np.asarray(self.time_s - self.time_s[np.searchsorted(self.run, self.run)])

    @property
    def sensing_hz(self) -> Array:
        """Sensing rate, Hz, as it is replayed: 0 where a run lacks the channel."""
        return np.nan_to_num(self.context.get("sensing_hz", np.zeros(len(self.run))))

    @property
    def tilt_error_rad(self) -> float:
        """Standard error of the tilt of the slope sensor, rad; 0 where no drive shows it."""
        return max(run.tilt_error_rad for run in self.signals)

    @property
    def names(self) -> list[str]:
        """Names of the runs."""
        return [run.name for run in self.signals]


@dataclass(frozen=True)
class WithEffects:
    """Additions to the robot in a prediction: effects by id, conditions of the drive, errors of its
    instruments."""

    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    headwind_mps: Sequence[Array] | None = None  # against the direction of travel, an array per run
    lag_s: float = 0.0  # delay of the instrument
    speed_factors: Sequence[float] | None = None  # true over recorded speed, a number per run
    roughness: Array | None = None  # of the ground, (windows,)


def average(signals: Sequence[Signals], samples: int = 1, window_s: float = WINDOW_S) -> Runs:
    """Average runs of one unit over windows of `window_s`, or longer so that each holds at least so
    many samples."""
    total_s = sum(float(run.time_s[-1] - run.time_s[0]) for run in signals)
    shortest_s = max(window_s, total_s / _MOST_WINDOWS)
    lengths_s = [max(shortest_s, samples * median_step_s(run.time_s)) for run in signals]
    cuts = [windows(run.time_s, length_s) for run, length_s in zip(signals, lengths_s, strict=True)]
    counts = [int(cut.keep.sum()) for cut in cuts]

    def means(values_of: Callable[[Signals], Array]) -> Array:
        """Window means of all runs."""
        return np.concatenate(
            [cut.means(values_of(run)) for run, cut in zip(signals, cuts, strict=True)]
        )

    def channel_means(name: str) -> Array:
        return means(lambda run: run.context.get(name, np.full(len(run.time_s), np.nan)))

    channels = dict.fromkeys(name for run in signals for name in run.context)
    return Runs(
        signals=signals,
        windows=cuts,
        unit=signals[0].unit,
        run=np.repeat(np.arange(len(signals)), counts),
        time_s=means(lambda run: run.time_s),
        duration_s=np.repeat(lengths_s, counts),
        observed=means(lambda run: run.observed),
        context={name: channel_means(name) for name in channels},
    )


def thrust_n_per_a(robot: Robot) -> float:
    """Thrust at the wheels per ampere of motor current, N/A, after gear friction.

    The motor loss eta2 is electrical: it lowers the voltage, not the torque.
    """
    return robot.traction_n_per_a * (1.0 - robot.friction_loss)


def power_w(run: Signals, robot: Robot) -> Array:
    """Battery power that a robot file predicts for a run, W, shape (samples,)."""
    return _loaded(robot, run, run.conditions)[0]


def wheels_mps(run: Signals, robot: Robot) -> Array:
    """Speed at which the robot's wheels turn, also on the spot, m/s, shape (samples,)."""
    turning_mps = 0.5 * np.abs(run.yaw_rate_radps) * robot.track_m
    return np.maximum(np.abs(run.speed_mps), turning_mps)


def current_a(run: Signals, robot: Robot) -> Array:
    """Motor current that a robot file predicts for a run, A, shape (samples,), see `predict`."""
    return _current_a(run, robot, _loaded(robot, run, run.conditions)[1])


def _current_a(run: Signals, robot: Robot, force_n: Array) -> Array:
    """Motor current at a wheel force, A, shape (samples,); beyond that at rest it vanishes with the
    motion."""
    moving = np.minimum(wheels_mps(run, robot) / logs_thresholds.STANDSTILL_MPS, 1.0)
    return np.asarray(robot.rest_current_a + moving * force_n / thrust_n_per_a(robot))


def predict(runs: Runs, robot: Robot, met: WithEffects | None = None) -> Array:
    """Battery power (W) or motor current (A) that the robot file predicts, shape (windows,).

    Power that was recorded as voltage times current is that at the battery's terminals. Motor
    current is the thrust over the thrust per ampere, plus the current at rest; a descent that the
    robot rolls down draws none, as in the power of the drive. Effects are those of the robot: `met`
    gives only conditions and errors of instruments.
    """
    met = met or WithEffects()
    means = []
    robot_at_terminals = at_terminals(robot)
    for index, (run, cut) in enumerate(zip(runs.signals, runs.windows, strict=True)):
        replayed = robot_at_terminals if run.at_terminals else robot
        power_w, force_n = _loaded(replayed, run, _conditions(runs, index, met))
        predicted = _current_a(run, robot, force_n) if runs.unit == "A" else power_w
        if met.lag_s != 0.0:
            predicted = np.interp(run.time_s - met.lag_s, run.time_s, predicted)
        means.append(cut.means(predicted))
    return np.concatenate(means)


def _conditions(runs: Runs, index: int, met: WithEffects) -> Recorded:
    """What is replayed of a run, with the conditions of the drive and the true speed, where they
    are given."""
    run = runs.signals[index]
    changed: dict[str, Any] = {}
    if met.speed_factors is not None:
        true_over_recorded = met.speed_factors[index]
        changed["speed_mps"] = true_over_recorded * run.speed_mps
        changed["accel_mps2"] = true_over_recorded * run.accel_mps2
    if met.headwind_mps is not None:
        changed["headwind_mps"] = met.headwind_mps[index]
    if met.roughness is not None:
        of_windows = met.roughness[runs.run == index]
        changed["roughness"] = runs.windows[index].samples(of_windows, len(run.time_s))
    if not changed:
        return run.conditions  # computed once
    return run.conditions_with(**changed)


def _loaded(robot: Robot, run: Signals, recorded: Recorded) -> tuple[Array, Array]:
    """Power, W, and wheel force, N, of a robot with the run's recorded load beside that of its
    file, (samples,) each.

    Interpolated between a few loads: both are piecewise linear in the load, with kinks where the
    drive draws nothing.
    """
    if "payload_kg" not in run.context:
        model = recorded.replay(robot)
        return model.power_w, model.wheel_force_n
    load_kg = np.nan_to_num(run.context["payload_kg"])
    levels_kg = np.unique(load_kg)
    if len(levels_kg) > _MOST_LOADS:
        levels_kg = np.linspace(levels_kg[0], levels_kg[-1], _MOST_LOADS)
    power_w = np.zeros(len(run.time_s))
    force_n = np.zeros(len(run.time_s))
    for level_kg, hat in zip(levels_kg.tolist(), np.eye(len(levels_kg)), strict=True):
        model = recorded.replay(_with_load(robot, level_kg))
        share = np.interp(load_kg, levels_kg, hat)
        power_w = power_w + share * model.power_w
        force_n = force_n + share * model.wheel_force_n
    return power_w, force_n


def _with_load(robot: Robot, load_kg: float) -> Robot:
    """The robot with a load beside that of its file."""
    if load_kg == 0.0:
        return robot
    effect = payload.EFFECT.id
    switch = payload.EFFECT.switch.name
    file_kg = robot.effects.get(effect, {}).get(switch, 0.0)
    return dataclasses.replace(
        robot, effects={**robot.effects, effect: {switch: file_kg + load_kg}}
    )
