"""From a scenario to what happened without noise: the base model, hidden effects on top, instruments at the end."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchmarks.plants import base, forces, instruments, loads
from benchmarks.plants.case import Kind
from benchmarks.plants.drives import PROFILES, Array, Drive, journeys
from benchmarks.plants.fleet import FLEET, misset, off_nominal
from benchmarks.plants.forces import Effort, World
from homeward.physics import Robot

Hidden = Callable[[World], list[Effort]]
_CATALOGUED: tuple[Hidden, ...] = (
    forces.wind, forces.hidden_grade, forces.regeneration, forces.copper_loss, forces.no_load, forces.viscous,
    forces.breakaway, forces.motor_heating, forces.payload, forces.surface, forces.turning, forces.inertia,
    loads.standby, loads.compute, loads.radio, loads.heater, loads.intermittent_load,
)  # fmt: skip

EFFECTS: dict[str, Hidden] = {function.__name__: function for function in _CATALOGUED} | loads.OUTSIDE
"""What happens to the robot, by effect id or, outside the catalogue, in words."""

INSTRUMENTS = {
    function.__name__: function
    for function in (
        instruments.sensor_offset, instruments.sensor_gain, instruments.clock_lag, instruments.odometry_scale,
    )
}  # fmt: skip
"""What happens to the recording only, by effect id."""

UNSCALED = ("regeneration", "inertia")
"""Effects whose size follows from the robot: they are not scaled to a share of the energy."""


@dataclass(frozen=True)
class Scenario:
    """What is hidden where: cases of several noise levels share its rollout."""

    kind: Kind
    truth: tuple[str, ...]
    robot: str
    profile: str
    seed: int
    share: float = 0.1  # of the energy, that each effect has
    flat: bool = False
    torque: bool = False  # motor currents are recorded instead of power
    constant: bool = False  # the effect is the same all through, so that a refit absorbs it


@dataclass(frozen=True)
class Rollout:
    """What happened and what noise-free instruments tell of it; one entry per run, arrays of shape (n,)."""

    nominal: Robot
    robot: Robot  # the one that drives
    drives: tuple[Drive, ...]
    recorded: tuple[Drive, ...]  # as the instruments have it
    clean: tuple[Array, ...]  # power, W, or current of all motors, A
    effects: tuple[tuple[Array, ...], ...]  # of each hidden effect, what it adds to `clean`
    torque: bool
    flat: bool
    in_watts: bool = False  # power itself is recorded even by robots that log voltage and current

    @cached_property
    def energy_share(self) -> tuple[float, ...]:
        """Of each effect: sum of what it adds or takes over the sum of what was observed."""
        observed = np.abs(np.concatenate(self.clean)).sum()
        return tuple(float(np.abs(np.concatenate(effect)).sum() / observed) for effect in self.effects)

    @cached_property
    def absorbed(self) -> tuple[float, ...]:
        """Of each effect: the share that a refit would take up, from the motion as it is recorded."""
        columns = np.concatenate([base.columns(self.robot, drive, self.torque) for drive in self.recorded])
        return tuple(base.absorbed_share(np.concatenate(effect), columns) for effect in self.effects)

    @cached_property
    def affected(self) -> tuple[NDArray[np.bool_], ...]:
        """Of each run: samples at which some hidden effect adds more than 5 % of its own peak; bool, shape (n,)."""
        affected = [np.zeros(run.size, bool) for run in self.clean]
        for effect in self.effects:
            peak = max(float(np.abs(run).max()) for run in effect)
            affected = [a | (np.abs(run) > 0.05 * peak) for a, run in zip(affected, effect, strict=True)]
        return tuple(affected)


def start(scenario: Scenario, step_s: float = 0.1) -> tuple[Robot, Robot, tuple[Drive, ...]]:
    """Nominal robot, the one that drives, and its journeys."""
    rng = np.random.default_rng([scenario.seed, 0])
    nominal = FLEET[scenario.robot]
    profile = PROFILES[scenario.profile]
    if scenario.flat:
        profile = dataclasses.replace(profile, slope_rad=0.0)
    drives = journeys(nominal, profile, rng, step_s)
    if scenario.kind == "exact":
        return nominal, nominal, drives
    if scenario.kind == "misset":
        return misset(nominal, rng), nominal, drives
    return nominal, off_nominal(nominal, rng, 0.04), drives


def simulate(scenario: Scenario) -> Rollout:
    """Drive a scenario's robot through all its runs."""
    nominal, robot, drives = start(scenario)
    quantity = base.current if scenario.torque else base.drawn
    efforts = hidden_efforts(scenario, robot, drives)

    def total(without: str = "") -> list[Array]:
        forces_n = [base.force(robot, drive) for drive in drives]
        powers_w = [np.zeros(drive.speed_mps.size) for drive in drives]
        for effort in (efforts[name] for name in efforts if name != without):
            forces_n = [f + e.force_n for f, e in zip(forces_n, effort, strict=True)]
            powers_w = [p + e.power_w for p, e in zip(powers_w, effort, strict=True)]
        return [quantity(robot, d, f) + p for d, f, p in zip(drives, forces_n, powers_w, strict=True)]

    clean, recorded = total(), list(drives)
    added = {name: _difference(clean, total(name)) for name in efforts}
    for name in (name for name in scenario.truth if name in INSTRUMENTS):
        rng = np.random.default_rng([scenario.seed, 1 + scenario.truth.index(name)])
        before, told = clean, base_of(robot, recorded, quantity)
        clean, recorded = INSTRUMENTS[name](clean, recorded, scenario.share, rng)
        if scenario.constant:  # over all runs the same, as a calibration that was never right
            clean = [(1.0 + scenario.share) * power if name == "sensor_gain" else power + scenario.share * np.mean(
                np.concatenate(before)) for power in before]  # fmt: skip
        added[name] = [c - b + t - n for c, b, t, n in
                       zip(clean, before, told, base_of(robot, recorded, quantity), strict=True)]  # fmt: skip
    return Rollout(nominal, robot, drives, tuple(recorded), tuple(clean),
                   tuple(tuple(added[name]) for name in scenario.truth), scenario.torque, scenario.flat)  # fmt: skip


def base_of(robot: Robot, drives: list[Drive], quantity: Callable[[Robot, Drive, Array], Array]) -> list[Array]:
    """Power or current that the base model sees in each drive; arrays of shape (n,)."""
    return [quantity(robot, drive, base.force(robot, drive)) for drive in drives]


def hidden_efforts(scenario: Scenario, robot: Robot, drives: tuple[Drive, ...]) -> dict[str, list[Effort]]:
    """Forces and powers of the scenario's effects in the order of the truth, each scaled to its share of the energy."""
    quantity = base.current if scenario.torque else base.drawn
    forces_n = [base.force(robot, drive) for drive in drives]
    efforts: dict[str, list[Effort]] = {}
    for number, name in enumerate(scenario.truth, start=1):
        if name not in EFFECTS:
            continue
        world = World(robot, drives, tuple(forces_n), np.random.default_rng([scenario.seed, number]))
        effort = _constant(name, world) if scenario.constant else EFFECTS[name](world)
        if name not in UNSCALED:
            effort = _scaled(effort, scenario.share, quantity, world)
        efforts[name] = effort
        forces_n = [f + e.force_n for f, e in zip(forces_n, effort, strict=True)]
    return efforts


def _difference(of: list[Array], without: list[Array]) -> list[Array]:
    return [a - b for a, b in zip(of, without, strict=True)]


def _scaled(
    effort: list[Effort], share: float, quantity: Callable[[Robot, Drive, Array], Array], world: World
) -> list[Effort]:
    """Effort of the wanted share; repeated, for a force that would pull the robot along adds nothing there."""
    plain = [quantity(world.robot, d, f) for d, f in zip(world.drives, world.forces_n, strict=True)]
    wanted, factor = share * sum(np.abs(p).sum() for p in plain), 1.0
    for _ in range(8):
        size = sum(
            np.abs(quantity(world.robot, d, f + factor * e.force_n) + factor * e.power_w - p).sum()
            for d, f, e, p in zip(world.drives, world.forces_n, effort, plain, strict=True)
        )
        factor *= wanted / size
    return [Effort(factor * e.force_n, factor * e.power_w) for e in effort]


def _constant(name: str, world: World) -> list[Effort]:
    """The same effect where it never changes: a steady load, ground, slope or drag."""
    robot, weight = world.robot, world.robot.mass_kg * base.GRAVITY_MPS2
    if name == "payload":
        return world.adding(lambda d: robot.rolling_resistance * np.cos(d.grade_rad) + np.sin(d.grade_rad))
    if name in ("surface", "hidden_grade"):
        return world.adding(lambda d: weight * np.cos(d.grade_rad))
    if name == "viscous":
        return world.adding(lambda d: d.speed_mps**1.1)
    if name == "standby":
        return world.adding(power=lambda d: np.ones(d.speed_mps.size))
    raise ValueError(f"{name} has no constant form")
