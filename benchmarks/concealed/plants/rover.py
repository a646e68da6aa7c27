"""Cases of a skid-steered rover in MuJoCo, where the omitted physics follows from contact
dynamics."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.random import Generator

from benchmarks.concealed.plants import rover_scenarios as hidden
from benchmarks.concealed.plants.cases import Case, missed_share, misset
from benchmarks.concealed.plants.chain import Work
from benchmarks.concealed.plants.instruments import NOISES, Logging, NoiseLevel, record
from benchmarks.concealed.plants.motion import Array, Motion
from benchmarks.concealed.plants.rover_drives import TICKS_PER_S, cruise
from benchmarks.concealed.plants.rover_engine import (
    STEP_S,
    THRUST_N_PER_A,
    TRACK_M,
    Log,
    Rover,
    Trip,
    World,
    drive,
)
from benchmarks.concealed.plants.rover_scenarios import Build, Scenario
from benchmarks.concealed.plants.vehicles import GRAVITY_MPS2, Plant
from homeward.physics import Robot

# steady drives; chosen: over the range of speeds that the scenarios have
CALIBRATION_MPS = (0.3, 0.6, 0.9)
CALIBRATION_S = 6.0  # of each, after settling; chosen
SHORT_S = 10.0  # of a trip for tests; chosen: they are to be quick
LISTED: tuple[tuple[Build, int, tuple[str, ...]], ...] = (
    (hidden.turning, 4, tuple(NOISES)), (hidden.inertia, 3, tuple(NOISES)), (hidden.slip, 2, tuple(NOISES)),
    (hidden.surface, 3, tuple(NOISES)), (hidden.payload, 1, tuple(NOISES)), (hidden.payload_on_hills, 1, tuple(NOISES)),
    (hidden.hidden_grade, 2, tuple(NOISES)), (hidden.regeneration, 1, tuple(NOISES)),
    (hidden.turning_and_surface, 1, ("low", "middle")), (hidden.turning_and_payload, 1, ("low", "middle")),
    (hidden.turning_and_inertia, 1, ("low", "middle")), (hidden.turning_and_hidden_grade, 1, ("low",)),
    (hidden.surface_and_payload, 1, ("low",)), (hidden.inertia_and_payload, 1, ("low",)),
    (hidden.inertia_and_regeneration, 1, ("low",)),
    (hidden.stuck_brake, 1, ("low", "middle")), (hidden.chatter, 1, ("low", "middle")),
    (hidden.constant_payload, 1, ("low",)), (hidden.constant_surface, 1, ("low",)),
    (hidden.level, 4, tuple(NOISES)), (hidden.hilly, 2, tuple(NOISES)),
)  # fmt: skip
"""Scenarios, with their multiplicity and noise level."""

KINDS = tuple(
    (build, level) for build, times, levels in LISTED for level in levels for _ in range(times)
)
OUTSIDE = ("stuck_brake", "chatter")
IN_TORQUE = {"turning", "inertia", "surface", "payload", "hidden_grade"}
"""Every third case that hides nothing else is recorded as motor currents."""


def make(number: int, build: Build, level: str, rng: Generator, short: bool) -> Case:
    """Simulate one scenario and record it."""
    scenario = build(rng)
    if scenario.truth != ("slip",):  # slip is observable only in power with the speed over ground
        torque = set(scenario.truth) <= IN_TORQUE and bool(rng.random() < 1 / 3)
        scenario = dataclasses.replace(
            scenario, torque=torque, wheels=scenario.wheels or bool(rng.random() < 0.5)
        )
    trips = [cut(trip) for trip in scenario.trips[:2]] if short else scenario.trips
    vehicle = vehicle_of(calibrated(scenario))
    robot = vehicle.robot
    # most parameters of the file do not affect currents
    exact = scenario.torque or bool(rng.random() < 0.5)
    wrong = (0.03, 0.1) if scenario.truth else (0.1, 0.4)
    works, recordings = recorded(vehicle, scenario, trips, level, rng)
    if not scenario.truth:
        label = "exact" if exact else "misset"
    elif set(scenario.truth) & set(OUTSIDE):
        label = scenario.truth[0]
    else:
        label = level
    nominal = robot if exact else misset(robot, rng, *wrong)
    misses = dict.fromkeys(scenario.truth, missed_share(works))
    return Case(
        "rover", number, robot.name, label, scenario.truth, robot, nominal, recordings, misses
    )


def recorded(
    vehicle: Plant, scenario: Scenario, trips: Sequence[Trip], level: str, rng: Generator
) -> tuple[list[Work], list[pd.DataFrame]]:
    """Simulate trips: the true quantities, and the recordings at a noise level."""
    logs = [drive(scenario.rover, trip, scenario.brake) for trip in trips]
    works = [work_of(vehicle, scenario, log, index) for index, log in enumerate(logs)]
    return works, [
        _record(work, log, scenario, NOISES[level], rng)
        for work, log in zip(works, logs, strict=True)
    ]


def calibrated(scenario: Scenario) -> Robot:
    """Robot file fitted by least squares to steady straight drives over the rover's own level
    ground."""
    rover = scenario.rover
    speeds = []
    powers = []
    for speed_mps in CALIBRATION_MPS:
        speed, yaw = cruise([speed_mps], CALIBRATION_S)
        log = drive(rover, Trip(speed, yaw, np.zeros(speed.size), World(scenario.ground)))
        speeds.append(_speed(scenario, log).mean())
        powers.append(log.power_w.mean())
    pull_w = rover.mass_kg * GRAVITY_MPS2 * np.array(speeds) / rover.efficiency
    rolling, idle = np.linalg.lstsq(
        np.stack([pull_w, np.ones(pull_w.size)], axis=1), np.array(powers)
    )[0]
    return _robot(rover, float(rolling), float(idle))


def work_of(vehicle: Plant, scenario: Scenario, log: Log, index: int) -> Work:
    """The true quantities that are recorded, in the form that instruments read."""
    speed = _speed(scenario, log)
    speed = np.where(np.abs(speed) > 0.005, speed, 0.0)  # below the resolution of encoders
    zeros = np.zeros(speed.size)
    run = Motion(
        time_s=log.time_s, speed_mps=speed, accel_mps2=np.gradient(speed, STEP_S),
        grade_rad=log.grade_rad * scenario.slope_known, yaw_rate_radps=log.yaw_radps, heading_rad=log.heading_rad,
        place_m=log.place_m, direction=np.sign(np.cos(log.heading_rad)), distance_m=np.cumsum(np.abs(speed)) * STEP_S,
        elevation_m=zeros, base_distance_m=np.abs(log.place_m), sensing_hz=zeros, temperature_c=zeros + 20.0, day_s=0.0,
        index=index,
    )  # fmt: skip
    work = Work(run, vehicle, "gauge")
    work.power_w = work.chemical_w = work.seen_w = log.power_w
    return work


def _speed(scenario: Scenario, log: Log) -> Array:
    return 0.5 * (log.wheel_left_mps + log.wheel_right_mps) if scenario.wheels else log.speed_mps


def _record(
    work: Work, log: Log, scenario: Scenario, noise: NoiseLevel, rng: Generator
) -> pd.DataFrame:
    logging = Logging(distance=False, charge=False, grade=scenario.slope_known)
    frame = record(work, noise, logging, rng).drop(columns=["sensing_hz", "temperature_c"])
    if not scenario.placed:
        frame = frame.drop(columns=["heading_rad", "base_distance_m"])

    def noisy(values: Array, deviation: float) -> Array:
        return np.asarray(values + deviation * rng.normal(size=values.size))

    if scenario.wheels:
        deviation = noise.speed_share * work.vehicle.robot.max_speed_mps
        wheels = {"wheel_left_mps": log.wheel_left_mps, "wheel_right_mps": log.wheel_right_mps}
        speeds = {name: noisy(speed_mps, deviation) for name, speed_mps in wheels.items()}
        frame = frame.drop(columns="speed_mps").assign(**speeds)
    if scenario.torque:  # the driver's currents have no sign
        deviation = noise.power_share * float(np.mean(log.left_a + log.right_a)) / np.sqrt(2.0)
        sides = {"motor_left_a": log.left_a, "motor_right_a": log.right_a}
        amps = {name: np.abs(noisy(side, deviation)) for name, side in sides.items()}
        frame = frame.drop(columns="power_w").assign(**amps)
    return frame


def cut(trip: Trip) -> Trip:
    """The beginning of a trip, for tests."""
    ticks = round(SHORT_S * TICKS_PER_S)
    return dataclasses.replace(trip, speed_mps=trip.speed_mps[:ticks], yaw_radps=trip.yaw_radps[:ticks],
                               payload_kg=trip.payload_kg[:ticks])  # fmt: skip


def vehicle_of(robot: Robot) -> Plant:
    """The rover with a robot file."""
    return Plant(
        robot,
        "skid",
        0.512,
        0.16,
        1.0,
        0.6,
        56.0,
        True,
        "rover.xml: about the size of a Husky A200",
    )


def _robot(rover: Rover, rolling_resistance: float, idle_w: float) -> Robot:
    return Robot(
        name="rover", description="A four-wheeled skid-steered rover.", mass_kg=rover.mass_kg,
        rolling_resistance=rolling_resistance, drag_ns2_per_m2=0.0, track_m=TRACK_M,
        rated_energy_j=1728000.0, nominal_voltage_v=24.0, motor_loss=0.0, friction_loss=1.0 - rover.efficiency,
        traction_n_per_a=THRUST_N_PER_A, min_speed_mps=0.1, max_speed_mps=1.0, sensing_idle_w=0.0,
        sensing_j_per_sample=0.0, max_sensing_hz=10.0, communication_w=0.0, controller_w=idle_w,
    )  # fmt: skip
