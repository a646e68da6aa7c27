"""What a robot file predicts for recorded runs: their motion replayed through the physics, averaged over windows."""

import dataclasses
from collections.abc import Mapping, Sequence
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

_MOST_WINDOWS = 100_000  # beyond it the windows get longer; chosen: bounds time and memory, 14 hours of driving
_MOST_LOADS = 5  # payload levels at which a run is replayed; chosen: power is piecewise linear in the load


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
        return bool(np.bincount(self.run, np.isfinite(self.context.get(name, np.nan * self.time_s))).all())

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
    """Additions to the robot in a prediction: effects by id, conditions of the drive, errors of its instruments."""

    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    headwind_mps: Sequence[Array] | None = None  # against the direction of travel, an array per run
    lag_s: float = 0.0  # delay of the instrument
    speed_factors: Sequence[float] | None = None  # true over recorded speed, a number per run
    roughness: Array | None = None  # of the ground, (windows,)


def average(signals: Sequence[Signals], samples: int = 1) -> Runs:
    """Average runs of one unit over windows of `WINDOW_S`, or longer so that each holds at least so many samples."""
    total_s = sum(float(run.time_s[-1] - run.time_s[0]) for run in signals)
    lengths = [max(WINDOW_S, samples * median_step_s(run.time_s), total_s / _MOST_WINDOWS) for run in signals]
    cuts = [windows(run.time_s, length) for run, length in zip(signals, lengths, strict=True)]
    pairs = list(zip(signals, cuts, strict=True))
    counts = [int(cut.keep.sum()) for cut in cuts]
    context = {
        name: np.concatenate([
            cut.means(run.context.get(name, np.full(len(run.time_s), np.nan))) for run, cut in pairs
        ])
        for name in dict.fromkeys(name for run in signals for name in run.context)
    }  # fmt: skip
    time_s, observed = (
        np.concatenate([cut.means(getattr(run, name)) for run, cut in pairs]) for name in ("time_s", "observed")
    )
    number = np.repeat(np.arange(len(signals)), counts)
    return Runs(signals, cuts, signals[0].unit, number, time_s, np.repeat(lengths, counts), observed, context)


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
    return np.maximum(np.abs(run.speed_mps), 0.5 * np.abs(run.yaw_rate_radps) * robot.track_m)


def current_a(run: Signals, robot: Robot) -> Array:
    """Motor current that a robot file predicts for a run, A, shape (samples,), see `predict`."""
    return _current_a(run, robot, _loaded(robot, run, run.conditions)[1])


def _current_a(run: Signals, robot: Robot, force_n: Array) -> Array:
    # Motor current vanishes with the motion.
    turning = np.minimum(wheels_mps(run, robot) / logs_thresholds.STANDSTILL_MPS, 1.0)
    return np.asarray(robot.rest_current_a + turning * force_n / thrust_n_per_a(robot))


def predict(runs: Runs, robot: Robot, met: WithEffects | None = None) -> Array:
    """Battery power (W) or motor current (A) that the robot file predicts, shape (windows,).

    Power that was recorded as voltage times current is that at the battery's terminals. Motor current is the thrust
    over the thrust per ampere, plus the current at rest; a descent that the robot rolls down draws none, as in the
    power of the drive. Effects are those of the robot: `met` gives only conditions and errors of instruments.
    """
    met = met or WithEffects()
    means = []
    outside = at_terminals(robot)
    for index, (run, cut) in enumerate(zip(runs.signals, runs.windows, strict=True)):
        changed: dict[str, Any] = {}
        if met.speed_factors is not None:
            true = met.speed_factors[index]
            changed |= {"speed_mps": true * run.speed_mps, "accel_mps2": true * run.accel_mps2}
        if met.headwind_mps is not None:
            changed["headwind_mps"] = met.headwind_mps[index]
        if met.roughness is not None:
            changed["roughness"] = cut.samples(met.roughness[runs.run == index], len(run.time_s))
        recorded = run.conditions_with(**changed) if changed else run.conditions
        power, force_n = _loaded(outside if run.at_terminals else robot, run, recorded)
        if runs.unit == "A":
            power = _current_a(run, robot, force_n)
        late: Array = np.interp(run.time_s - met.lag_s, run.time_s, power) if met.lag_s != 0.0 else power
        means.append(cut.means(late))
    return np.concatenate(means)


def _loaded(robot: Robot, run: Signals, recorded: Recorded) -> tuple[Array, Array]:
    """Power, W, and wheel force, N, of a robot with the run's recorded load beside that of its file, (samples,) each.

    Interpolated between a few loads: both are piecewise linear in the load, with kinks where the drive draws nothing.
    """
    if "payload_kg" not in run.context:
        model = recorded.replay(robot)
        return model.power_w, model.wheel_force_n
    load_kg = np.nan_to_num(run.context["payload_kg"])
    levels = np.unique(load_kg)
    if len(levels) > _MOST_LOADS:
        levels = np.linspace(levels[0], levels[-1], _MOST_LOADS)
    power_w, force_n = np.zeros(len(run.time_s)), np.zeros(len(run.time_s))
    effect, switch = payload.EFFECT.id, payload.EFFECT.switch.name
    own_kg = robot.effects.get(effect, {}).get(switch, 0.0)
    for number, level in enumerate(levels.tolist()):
        effects = {**robot.effects, effect: {switch: own_kg + level}}
        model = recorded.replay(dataclasses.replace(robot, effects=effects) if level else robot)
        share = np.interp(load_kg, levels, np.eye(len(levels))[number])
        power_w, force_n = power_w + share * model.power_w, force_n + share * model.wheel_force_n
    return power_w, force_n
