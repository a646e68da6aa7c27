"""Cases of a skid-steered rover in MuJoCo, where what the paper leaves out comes out of contact, and a table of them.

`python benchmarks/plants/rover.py` prints the table.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.plants import rover_scenarios as hidden
from benchmarks.plants.base import absorbed_share
from benchmarks.plants.case import Array, Case, Noise, Run, anonymous
from benchmarks.plants.drives import coloured
from benchmarks.plants.fleet import misset, off_nominal
from benchmarks.plants.observe import NOISE, noisy, rounded, window_rms
from benchmarks.plants.rover_drives import cruise
from benchmarks.plants.rover_engine import STEP_S, THRUST_N_PER_A, TRACK_M, Ground, Log, Rover, Trip, World, drive
from benchmarks.plants.rover_scenarios import AFFECTED, Build, Scenario
from homeward.physics import Robot, ancillary_power, traction_force

CALIBRATION_MPS = (0.3, 0.6, 0.9)
CALIBRATION_S = 6.0
OFF_NOMINAL = 0.03

EVERY: tuple[Noise, ...] = ("low", "middle", "high")
LISTED: tuple[tuple[Build, int, tuple[Noise, ...]], ...] = (
    (hidden.turning, 4, EVERY), (hidden.inertia, 3, EVERY), (hidden.slip, 2, EVERY), (hidden.surface, 3, EVERY),
    (hidden.payload, 1, EVERY), (hidden.payload_on_hills, 1, EVERY), (hidden.hidden_grade, 2, EVERY),
    (hidden.regeneration, 1, EVERY),
    (hidden.turning_and_surface, 1, ("low", "middle")), (hidden.turning_and_payload, 1, ("low", "middle")),
    (hidden.turning_and_inertia, 1, ("low", "middle")), (hidden.turning_and_hidden_grade, 1, ("low",)),
    (hidden.surface_and_payload, 1, ("low",)), (hidden.inertia_and_payload, 1, ("low",)),
    (hidden.inertia_and_regeneration, 1, ("low",)),
    (hidden.stuck_brake, 1, ("low", "middle")), (hidden.chatter, 1, ("low", "middle")),
    (hidden.constant_payload, 1, ("low",)), (hidden.constant_surface, 1, ("low",)),
    (hidden.level, 4, EVERY), (hidden.hilly, 2, EVERY),
)  # fmt: skip
"""Scenarios, how often each is drawn, and the noise levels that share a rollout."""

IN_TORQUE = ("turning", "inertia", "surface", "payload", "hidden_grade", "")
"""Of these effects, and of what has none, every third rollout is recorded as motor currents."""


@dataclass(frozen=True)
class Rollout:
    """What happened in all runs of a scenario, and the robot that a calibration straight on makes of the rover."""

    scenario: Scenario
    robot: Robot
    logs: tuple[Log, ...]

    def clean(self, log: Log) -> Array:
        """Power, W, or current of all motors, A, without noise; array of shape (n,)."""
        return log.left_a + log.right_a if self.scenario.torque else log.power_w

    def speed(self, log: Log) -> Array:
        """Speed as far as it is recorded, m/s; array of shape (n,)."""
        return 0.5 * (log.wheel_left_mps + log.wheel_right_mps) if self.scenario.wheels else log.speed_mps

    def expected(self, robot: Robot, speed_mps: Array, grade_rad: Array) -> Array:
        """Power, W, or current, A, that the paper's model makes of what is recorded; array of shape (n,)."""
        pace_mps = np.abs(speed_mps)
        force_n = np.maximum(traction_force(robot, pace_mps, grade_rad), 0.0) / robot.traction_efficiency
        if self.scenario.torque:
            return np.asarray(force_n * (pace_mps > 0.02) / robot.traction_n_per_a)
        return np.asarray(ancillary_power(robot, 0.0) + force_n * pace_mps)

    def missing(self, log: Log) -> Array:
        """What the paper's model lacks with the calibrated robot, W or A; array of shape (n,)."""
        return self.clean(log) - self.expected(self.robot, self.speed(log), self.known_grade(log))

    def known_grade(self, log: Log) -> Array:
        """Slope as far as it is recorded, rad; array of shape (n,)."""
        return log.grade_rad * self.scenario.slope_known

    @cached_property
    def absorbed(self) -> float:
        """Share of what the model lacks that a refit would take up; nothing is to be lacking in controls."""
        columns: list[Array] = []
        for log in self.logs:
            speed, grade = self.speed(log), self.known_grade(log)
            moving = (np.abs(speed) > 0.02) if self.scenario.torque else speed
            columns.append(np.stack([np.ones_like(speed), np.cos(grade) * moving, np.sin(grade) * moving], axis=1))
        every = np.concatenate(columns)[:, int(self.scenario.torque) :]
        return absorbed_share(np.concatenate([self.missing(log) for log in self.logs]), every)


def simulate(build: Build, seed: int, number: int) -> Rollout:
    """Drive one scenario; its number settles which channels are recorded."""
    scenario = build(np.random.default_rng([seed, number]))
    if scenario.truth != ("slip",):  # which only shows in power beside the speed over ground
        effects = scenario.truth or ("",)
        torque = number % 3 == 2 and all(effect in IN_TORQUE for effect in effects)
        wheels = scenario.wheels or number % 2 == 1
        scenario = dataclasses.replace(scenario, torque=torque, wheels=wheels)
    logs = tuple(drive(scenario.rover, trip, scenario.brake) for trip in scenario.trips)
    return Rollout(scenario, calibrated(scenario), logs)


def calibrated(scenario: Scenario) -> Robot:
    """Robot file that fits steady drives straight on over the rover's own level ground, by least squares."""
    blank = _robot(scenario.rover, 0.05, 0.0)
    logs = [_steady_log(scenario.rover, scenario.ground, speed) for speed in CALIBRATION_MPS]
    likeness = Rollout(scenario, blank, tuple(logs))
    speeds = np.array([likeness.speed(log).mean() for log in logs])
    observed = np.array([likeness.clean(log).mean() for log in logs])
    pull = likeness.expected(blank, speeds, np.zeros(speeds.size)) / blank.rolling_resistance
    if scenario.torque:
        return _robot(scenario.rover, float(pull @ observed / (pull @ pull)), scenario.rover.idle_w)
    rolling, idle = np.linalg.lstsq(np.stack([pull, np.ones(pull.size)], axis=1), observed)[0]
    return _robot(scenario.rover, float(rolling), float(idle))


def _steady_log(rover: Rover, ground: Ground, speed_mps: float) -> Log:
    speed, yaw = cruise([speed_mps], CALIBRATION_S)
    return drive(rover, Trip(speed, yaw, np.zeros(speed.size), World(ground)))


def _robot(rover: Rover, rolling_resistance: float, idle_w: float) -> Robot:
    return Robot(
        name="rover", description="A four-wheeled skid-steered rover.", mass_kg=rover.mass_kg,
        rolling_resistance=rolling_resistance, drag_ns2_per_m2=0.0, track_m=TRACK_M,
        rated_energy_j=1728000.0, nominal_voltage_v=24.0, motor_loss=0.0, friction_loss=1.0 - rover.efficiency,
        traction_n_per_a=THRUST_N_PER_A, min_speed_mps=0.1, max_speed_mps=1.0, sensing_idle_w=0.0,
        sensing_j_per_sample=0.0, max_sensing_hz=10.0, communication_w=0.0, controller_w=idle_w,
    )  # fmt: skip


def record(rollout: Rollout, noise: Noise, seed: int, robot: Robot, exact: bool) -> tuple[tuple[Run, ...], float]:
    """Recordings of a rollout, and the RMS of the noise in them, of both motor currents summed where there are two.

    Motion is free of noise where the control is to be exact; else its errors count as noise of what the model makes
    of it, for no model can tell them apart.
    """
    rng = np.random.default_rng([seed, 99])
    mean = float(np.mean(np.concatenate([rollout.clean(log) for log in rollout.logs])))
    runs, errors = [], []
    for log in rollout.logs:
        seen = log if exact else _seen(log, NOISE[noise], rng)
        lag_s = rng.uniform(0.0, 0.01) if rollout.scenario.truth else 0.0  # clocks that are set by hand
        channels = _electrical(rollout, log, NOISE[noise], mean, lag_s, rng)
        expected = [rollout.expected(robot, rollout.speed(x), rollout.known_grade(x)) for x in (log, seen)]
        errors.append(np.sum(list(channels.values()), axis=0) - rollout.clean(log) + expected[0] - expected[1])
        affected = np.zeros(log.time_s.size, bool)
        for effect in rollout.scenario.truth:
            affected |= AFFECTED[effect](log)
        runs.append(Run({"time_s": log.time_s, **_motion(rollout.scenario, seen), **channels}, affected))
    return tuple(runs), window_rms(np.concatenate(errors), STEP_S)


def _seen(log: Log, level: float, rng: np.random.Generator) -> Log:
    """The motion as encoders, gyroscope, inclinometer, compass and position fix of a noise level have it."""
    n = log.speed_mps.size

    def encoder(speed: Array) -> Array:
        error = 0.1 * level * coloured(n, 0.4, STEP_S, rng) * (np.abs(speed) > 0.005)
        return np.asarray(np.round(speed + error, 3))

    return dataclasses.replace(
        log,
        speed_mps=encoder(log.speed_mps),
        wheel_left_mps=encoder(log.wheel_left_mps),
        wheel_right_mps=encoder(log.wheel_right_mps),
        yaw_radps=log.yaw_radps + 0.1 * level * coloured(n, 0.2, STEP_S, rng),
        heading_rad=log.heading_rad + 0.3 * level * coloured(n, 20.0, STEP_S, rng),
        grade_rad=np.round(log.grade_rad + 0.03 * level * coloured(n, 4.0, STEP_S, rng), 4),
        place_m=log.place_m + 5.0 * level * coloured(n, 30.0, STEP_S, rng),
    )


def _motion(scenario: Scenario, seen: Log) -> dict[str, Array]:
    if scenario.wheels:
        channels = {"wheel_left_mps": seen.wheel_left_mps, "wheel_right_mps": seen.wheel_right_mps}
    else:
        channels = {"speed_mps": seen.speed_mps}
    channels["yaw_rate_radps"] = seen.yaw_radps
    if scenario.slope_known:
        channels["grade_rad"] = seen.grade_rad
    if scenario.placed:
        channels["heading_rad"] = np.angle(np.exp(1j * seen.heading_rad))
        channels["base_distance_m"] = np.abs(seen.place_m)
    return channels


def _electrical(
    rollout: Rollout, log: Log, level: float, mean: float, lag_s: float, rng: np.random.Generator
) -> dict[str, Array]:
    if not rollout.scenario.torque:
        sides, sigma = {"power_w": log.power_w}, level * mean
    else:  # the driver's currents have no sign
        sides, sigma = {"motor_left_a": log.left_a, "motor_right_a": log.right_a}, level * mean / np.sqrt(2.0)
    late = {name: np.interp(log.time_s - lag_s, log.time_s, clean) for name, clean in sides.items()}
    noise = {name: noisy(log.time_s.size, sigma, STEP_S, rng) for name in sides}
    return {name: rounded(np.abs(late[name] + noise[name]), mean) for name in sides}


def rollouts(seed: int = 0) -> Iterator[tuple[Rollout, Case]]:
    """Every case with the rollout behind it, one at a time."""
    draws = [(build, levels) for build, times, levels in LISTED for _ in range(times)]
    number = 0
    for index, (build, levels) in enumerate(draws):
        rollout = simulate(build, seed, index)
        for noise in levels:
            for kind in ("exact", "misset") if rollout.scenario.kind == "exact" else (rollout.scenario.kind,):
                if kind == "misset" and rollout.scenario.torque:
                    continue  # most of the file has no say in currents
                case_seed = 1000 * seed + number
                rng = np.random.default_rng([case_seed, 5])
                robot = (
                    rollout.robot
                    if kind == "exact"
                    else (
                        misset(rollout.robot, rng) if kind == "misset" else off_nominal(rollout.robot, rng, OFF_NOMINAL)
                    )
                )
                runs, noise_rms = record(rollout, noise, case_seed, rollout.robot, kind == "exact")
                yield rollout, Case(anonymous("rover", case_seed), "rover", kind, rollout.scenario.truth, noise,
                                    case_seed, robot, runs, noise_rms)  # fmt: skip
                number += 1


def cases(seed: int = 0) -> Iterator[Case]:
    """Every case of the rover, one at a time."""
    return (case for _, case in rollouts(seed))


def summary() -> None:
    """Print what is hidden in each case, and how much of it there is."""
    table = Table(title="Rover in MuJoCo")
    for heading in ("case", "kind", "truth", "noise", "runs", "recorded", "mean", "noise RMS", "energy affected",
                    "missing RMS", "missing elsewhere", "absorbed"):  # fmt: skip
        table.add_column(heading)
    for rollout, case in rollouts():
        clean, missing = (np.concatenate([of(log) for log in rollout.logs]) for of in (rollout.clean, rollout.missing))
        affected = np.concatenate([run.affected for run in case.runs])
        elsewhere = missing[~affected] if not affected.all() else np.zeros(1)
        unit = "A" if rollout.scenario.torque else "W"
        recorded = ("wheels" if rollout.scenario.wheels else "speed") + (
            " grade" if rollout.scenario.slope_known else ""
        )
        table.add_row(
            case.name, case.kind, " + ".join(case.truth), case.noise, str(len(case.runs)), recorded,
            f"{clean.mean():.3g} {unit}", f"{case.noise_rms:.3g}", f"{clean[affected].sum() / clean.sum():.0%}",
            f"{np.std(missing):.3g}", f"{np.sqrt(np.mean(elsewhere**2)):.3g}", f"{rollout.absorbed:.2f}",
        )  # fmt: skip
    Console(width=190).print(table)


if __name__ == "__main__":
    summary()
