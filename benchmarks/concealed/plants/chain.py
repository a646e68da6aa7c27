"""From a drive to the power that leaves the battery, stage by stage; hidden mechanisms change one
stage each.

The chain without any mechanism is the paper's model (Tiwari et al., IROS 2018, Eq. 3 and 5), as the
robot file has it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.random import Generator

from benchmarks.concealed.plants.motion import Array, Motion
from benchmarks.concealed.plants.vehicles import GRAVITY_MPS2, Plant

Stage = Literal["ground", "wheel", "motor", "load", "battery", "instrument"]


@dataclass
class Work:
    """A drive and all quantities computed from it, shape (n,) each; a mechanism changes those of
    its stage."""

    run: Motion
    vehicle: Plant
    read_by: Literal["gauge", "terminals"]
    # ground: forces against the wheels
    mass_kg: Array = field(init=False)
    rolling: Array = field(init=False)
    grade_rad: Array = field(init=False)
    air_mps: Array = field(init=False)
    extra_n: Array = field(init=False)
    # mechanical power of scrubbing, also while turning on the spot
    turning_w: Array = field(init=False)
    # wheel: force and the speed of the tread
    force_n: Array = field(init=False)
    tread_mps: Array = field(init=False)
    returned_w: Array = field(init=False)  # electrical power recovered by braking
    # motor
    drive_w: Array = field(init=False)
    # load
    ancillary_w: Array = field(init=False)
    # battery
    power_w: Array = field(init=False)  # at the terminals
    voltage_v: Array = field(init=False)
    chemical_w: Array = field(init=False)  # power that the cells lose
    capacity_share: float = 1.0
    soc: Array = field(init=False)
    seen_w: Array = field(init=False)  # reading of an ideal power meter at its place
    # instrument: readings of faulty instruments
    read_gain: Array = field(init=False)
    read_offset_w: Array = field(init=False)
    read_lag_s: float = 0.0
    read_smooth_s: float = 0.0
    odometer_gain: Array = field(init=False)

    def __post_init__(self) -> None:
        n = self.run.time_s.size
        robot = self.vehicle.robot
        self.mass_kg = np.full(n, robot.mass_kg)
        self.rolling = np.full(n, robot.rolling_resistance)
        self.grade_rad = self.run.grade_rad.copy()
        self.air_mps = self.run.speed_mps.copy()
        self.extra_n = np.zeros(n)
        self.turning_w = np.zeros(n)
        self.returned_w = np.zeros(n)
        self.tread_mps = self.run.speed_mps.copy()
        self.read_gain = np.ones(n)
        self.read_offset_w = np.zeros(n)
        self.odometer_gain = np.ones(n)


Change = Callable[[Work, Generator], None]


@dataclass(frozen=True)
class Mechanism:
    """Physics that the nominal robot lacks: the stage of the chain where it acts, and its change
    there."""

    effect: str
    stage: Stage
    change: Change


def resistance_law(work: Work) -> Array:
    """Traction force, N: rolling, air and slope (paper, Eq. 3), plus what mechanisms added."""
    weight_n = work.mass_kg * GRAVITY_MPS2
    moving = work.run.speed_mps > 0.0
    air_n = work.vehicle.robot.drag_ns2_per_m2 * work.air_mps * np.abs(work.air_mps)
    rolling_n = work.rolling * weight_n * np.cos(work.grade_rad)
    return np.where(
        moving, rolling_n + air_n + weight_n * np.sin(work.grade_rad) + work.extra_n, 0.0
    )


def charge_left(work: Work) -> Array:
    """State of charge by the energy that the cells lost; the drive begins at 95 %."""
    capacity_j = work.capacity_share * work.vehicle.robot.rated_energy_j
    return 0.95 - np.cumsum(work.chemical_w) * work.run.dt_s / capacity_j


def rollout(vehicle: Plant, run: Motion, mechanisms: Sequence[Mechanism], rng: Generator,
            read_by: Literal["gauge", "terminals"] = "gauge") -> Work:  # fmt: skip
    """Compute the power of a drive with the mechanisms."""
    work = Work(run, vehicle, read_by)
    robot = vehicle.robot

    def act(stage: Stage) -> None:
        for mechanism in mechanisms:
            if mechanism.stage == stage:
                mechanism.change(work, rng)

    act("ground")
    work.force_n = resistance_law(work)
    act("wheel")
    mechanical_w = np.maximum(work.force_n, 0.0) * work.tread_mps + work.turning_w
    work.drive_w = mechanical_w / robot.traction_efficiency
    act("motor")
    sample_j = robot.sensing_j_per_sample + robot.computer_j_per_sample
    work.ancillary_w = np.full(
        run.time_s.size, robot.sensing_idle_w + robot.communication_w + robot.controller_w
    )
    work.ancillary_w += sample_j * run.sensing_hz
    act("load")
    work.power_w = work.drive_w + work.ancillary_w - work.returned_w
    work.chemical_w = work.power_w.copy()
    # open circuit, the middle part of a Li-ion cell's curve
    work.voltage_v = robot.nominal_voltage_v * (0.93 + 0.12 * charge_left(work))
    act("battery")
    work.soc = charge_left(work)
    work.seen_w = work.chemical_w if read_by == "gauge" else work.power_w
    act("instrument")
    return work
