"""Cases of the benchmark: recordings of a plant with something concealed, or with nothing."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
import pandas as pd
from numpy.random import Generator
from scipy.optimize import nnls

from benchmarks.concealed.plants.catalogue import TRUTHS, replayed
from benchmarks.concealed.plants.chain import Mechanism, Work, rollout
from benchmarks.concealed.plants.effects import EFFECTS, INSTRUMENTS, Draw
from benchmarks.concealed.plants.instruments import (
    FAULTS,
    NEEDS_ROOM,
    NOISES,
    Logging,
    read_power,
    record,
)
from benchmarks.concealed.plants.motion import Array, Course, Motion, make_drives, make_route
from benchmarks.concealed.plants.outside import make_outside
from benchmarks.concealed.plants.vehicles import BURGER, GRAVITY_MPS2, RACER, VEHICLES, Plant
from homeward.physics import Robot

Part = Literal["singles", "pairs", "controls", "outside", "coverage", "rover", "cell"]
PARTS: tuple[Part, ...] = get_args(Part)
# parts on simulators of others, by the library that each needs
NEEDS = {"rover": "mujoco", "cell": "pybamm"}
ReadBy = Literal["gauge", "terminals"]
Fit = Callable[[Plant, list[Motion], Generator], tuple[Plant, list[Motion]]]
"""Changes a vehicle's battery to suit its drives, and the weather of the drives."""

DAY_C = {"heater": (-8.0, 3.0), "cold_battery": (-14.0, 2.0), "cooler": (28.0, 38.0)}
"""Mean temperatures of the day, where it must be cold or hot."""
# at the terminals: in voltage and charge
BATTERY_LAWS = ("internal_resistance", "rate_capacity", "cold_battery")
NEEDS_CHARGE = ("ageing", "rate_capacity")
# of the mean power, which the best refit must miss for an effect to count as visible
VISIBLE_SHARE = 0.03


@dataclass(frozen=True)
class Later:
    """A later drive of the same plant that the diagnosis does not get, with its true energy."""

    run: Motion
    power_w: Array


@dataclass(frozen=True)
class Case:
    """Recordings for a diagnosis, with the correct answer."""

    part: Part
    number: int
    vehicle: str
    label: str  # noise, kind of control, or mechanism
    hidden: tuple[str, ...]
    truth: Robot
    nominal: Robot
    recordings: list[pd.DataFrame]
    refit_misses: dict[str, float]  # share of the mean power that the best refit misses, by effect
    fair: frozenset[str] = frozenset()  # ids that would describe a mechanism outside the catalogue
    fault: str = "none"
    refit: Robot | None = None  # of the noise-free recordings, for the later drives
    later: list[Later] = field(default_factory=list)
    # the same recordings, noise included, less one effect
    without: Callable[[str], list[pd.DataFrame]] | None = None

    @property
    def visible(self) -> dict[str, bool]:
        """Whether each hidden effect is visible in the recordings beyond what a refit absorbs."""
        return {effect: share >= VISIBLE_SHARE for effect, share in self.refit_misses.items()}


def _as_they_are(vehicle: Plant, runs: list[Motion], rng: Generator) -> tuple[Plant, list[Motion]]:
    return vehicle, runs


def hidden_case(part: Part, number: int, effects: tuple[str, ...], level: str, rng: Generator, short: bool,
                fit: Fit = _as_they_are, draws: Mapping[str, Draw] = EFFECTS) -> Case:  # fmt: skip
    """A vehicle with concealed effects."""
    vehicle = _vehicle_for(effects, rng)
    routes, mean_c, runs = _drives(vehicle, effects, rng, short)
    vehicle, runs = fit(vehicle, runs, rng)
    mechanisms = [draws[name](vehicle, rng, len(runs)) for name in effects]
    read_by = _read_by(effects, rng)
    robot = vehicle.robot
    nominal = robot if rng.random() < 0.5 else misset(robot, rng, 0.03, 0.1)
    noise_seed = int(rng.integers(2**32))
    logging = _logging(vehicle, effects, rng)
    works = _rollouts(vehicle, runs, mechanisms, read_by, noise_seed)
    rng_of_records = copy.deepcopy(rng)
    recordings = [record(work, NOISES[level], logging, rng) for work in works]

    def without(effect: str) -> list[pd.DataFrame]:
        remaining = [mechanism for mechanism in mechanisms if mechanism.effect != effect]
        same_noise = copy.deepcopy(rng_of_records)
        works_without = _rollouts(vehicle, runs, remaining, read_by, noise_seed)
        return [record(work, NOISES[level], logging, same_noise) for work in works_without]

    misses = {}
    for mechanism in mechanisms:
        works_of_effect = works
        if len(mechanisms) > 1:
            works_of_effect = _rollouts(vehicle, runs, [mechanism], read_by, noise_seed)
        misses[mechanism.effect] = missed_share(works_of_effect)
    shown_elsewhere = {"ageing", "odometry_scale"}  # in charge or distance
    if read_by == "terminals":
        shown_elsewhere |= set(BATTERY_LAWS)  # in voltage
    misses |= dict.fromkeys(shown_elsewhere & set(effects), 1.0)
    later = (
        []
        if part == "cell"
        else _later(vehicle, routes, mean_c, len(runs), mechanisms, read_by, rng, short)
    )
    return Case(part, number, robot.name, level, effects, robot, nominal, recordings, misses, refit=_refit(works),
                later=later, without=without)  # fmt: skip


def control_case(number: int, exact: bool, fault: str, rng: Generator, short: bool, part: Part = "controls",
                 fit: Fit = _as_they_are, draws: Sequence[Draw] = ()) -> Case:  # fmt: skip
    """A control: a vehicle without concealed physics that matters; `draws` are mechanisms that a
    refit absorbs."""
    vehicle = _pick(
        [v for v in VEHICLES if fault not in NEEDS_ROOM or v not in (BURGER, RACER)], rng
    )
    vehicle, runs = fit(vehicle, _drives(vehicle, (), rng, short)[-1], rng)
    nominal = vehicle.robot if exact else misset(vehicle.robot, rng, 0.1, 0.4)
    mechanisms = [draw(vehicle, rng, len(runs)) for draw in draws]
    level = ("low", "middle")[int(rng.integers(2))]
    logging = _logging(vehicle, (), rng)
    works = _rollouts(vehicle, runs, mechanisms, _read_by((), rng), 0)
    recordings = [record(work, NOISES[level], logging, rng) for work in works]
    if fault != "none":
        bad = rng.random()
        recordings = [
            FAULTS[fault](frame, work, bad, rng)
            for frame, work in zip(recordings, works, strict=True)
        ]
    label = "exact" if exact else "misset"
    truth = vehicle.robot
    return Case(part, number, truth.name, label, (), truth, nominal, recordings, {}, fault=fault)


def outside_case(number: int, name: str, rng: Generator, short: bool) -> Case:
    """Recordings of a vehicle with a mechanism that the catalogue of the diagnosis lacks."""
    vehicle = _pick(VEHICLES, rng)
    *_, runs = _drives(vehicle, (), rng, short)
    mechanism, fair = make_outside(name, vehicle, rng, len(runs))
    level = ("low", "middle")[int(rng.integers(2))]
    read_by = _read_by((), rng)
    works = _rollouts(vehicle, runs, [mechanism], read_by, int(rng.integers(2**32)))
    logging = _logging(vehicle, (), rng)
    recordings = [record(work, NOISES[level], logging, rng) for work in works]
    truth = vehicle.robot
    misses = {name: missed_share(works)}
    return Case(
        "outside", number, truth.name, name, (name,), truth, truth, recordings, misses, fair=fair
    )


def coverage_case(number: int, effect: str, rng: Generator, short: bool) -> Case:
    """A plant with the catalogue's own formulas, whose true parameters are known."""
    vehicle = _vehicle_for((effect,), rng)
    *_, runs = _drives(vehicle, (effect,), rng, short)
    truth = vehicle.robot
    if effect != "none":
        truth = dataclasses.replace(truth, effects={effect: TRUTHS[effect](vehicle, rng)})
    nominal = (
        vehicle.robot
        if effect != "none" and rng.random() < 0.5
        else misset(vehicle.robot, rng, 0.1, 0.3)
    )
    level = ("low", "middle")[int(rng.integers(2))]
    works = [replayed(vehicle, truth, run) for run in runs]
    recordings = [record(work, NOISES[level], Logging(charge=False), rng) for work in works]
    hidden = () if effect == "none" else (effect,)
    misses = {name: missed_share(works) for name in hidden}
    return Case("coverage", number, truth.name, level, hidden, truth, nominal, recordings, misses)


def _pick(vehicles: Sequence[Plant], rng: Generator) -> Plant:
    return vehicles[int(rng.integers(len(vehicles)))]


def go_together(effect: str, partner: str) -> bool:
    """Whether at most one effect is an instrument's, and at most one a law of the battery, and not
    heat meets cold."""
    pair = {effect, partner}
    if effect == partner or pair <= set(INSTRUMENTS) or pair <= set(BATTERY_LAWS):
        return False
    return "cooler" not in pair or pair.isdisjoint({"heater", "cold_battery"})


def _vehicle_for(effects: tuple[str, ...], rng: Generator) -> Plant:
    """A vehicle that can show the effects: weather needs outdoor vehicles, recuperation slopes that
    need braking."""
    fit = list(VEHICLES)
    if set(effects) & {"wind", "heater", "cooler", "cold_battery"}:
        fit = [vehicle for vehicle in fit if vehicle.outdoor]
    if "regeneration" in effects:
        fit = [
            vehicle
            for vehicle in fit
            if vehicle.steepest_grade_rad > 1.5 * vehicle.robot.rolling_resistance
        ]
    return _pick(fit, rng)


def _drives(
    vehicle: Plant, effects: tuple[str, ...], rng: Generator, short: bool
) -> tuple[list[Course], float, list[Motion]]:
    """Routes, mean air temperature, and drives."""
    routes = [_route(vehicle, effects, rng) for _ in range(int(rng.integers(1, 3)))]
    mean_c = rng.uniform(4.0, 24.0) if vehicle.outdoor else rng.uniform(17.0, 23.0)
    for effect in effects:
        mean_c = rng.uniform(*DAY_C[effect]) if effect in DAY_C else mean_c
    count = 2 if short else int(rng.integers(3, 7))
    return routes, mean_c, make_drives(vehicle, routes, rng, count, mean_c, short)


def _route(vehicle: Plant, effects: tuple[str, ...], rng: Generator) -> Course:
    """A route on which the effects are visible: no loop for a tilt, and for recuperation slopes
    that need braking."""
    rolls_rad = 1.3 * vehicle.robot.rolling_resistance
    while True:
        route = make_route(vehicle, rng)
        steepest_rad = np.abs(route.elevation(np.linspace(0.0, route.length_m, 400), 1)).max()
        level = "regeneration" in effects and steepest_rad <= rolls_rad
        if not (level or (route.loop and "hidden_grade" in effects)):
            return route


def _read_by(effects: tuple[str, ...], rng: Generator) -> ReadBy:
    """A charge gauge that includes losses in the cells, or a meter at the battery's terminals."""
    drawn: ReadBy = "gauge" if rng.random() < 0.6 else "terminals"
    return "terminals" if "ageing" in effects else drawn


def _logging(vehicle: Plant, effects: tuple[str, ...], rng: Generator) -> Logging:
    roomy = vehicle.robot.name not in (BURGER.robot.name, RACER.robot.name)
    return Logging(
        wheels=vehicle.steering != "ackermann" and bool(rng.random() < 0.25),
        elevation=roomy and bool(rng.random() < 0.25),
        distance="odometry_scale" in effects or bool(rng.random() < 0.5),
        charge=bool(set(effects) & set(NEEDS_CHARGE)) or bool(rng.random() < 0.5),
    )


def misset(robot: Robot, rng: Generator, smallest: float, largest: float) -> Robot:
    """The robot with relative errors, of a size within limits, of rolling resistance and up to two
    other parameters."""
    count = int(rng.integers(0, 3))
    names = rng.choice(
        ["controller_w", "sensing_j_per_sample", "mass_kg"], size=count, replace=False
    ).tolist()
    wrong = {}
    for name in ("rolling_resistance", *names):
        error = rng.choice([-1.0, 1.0]) * rng.uniform(smallest, largest)
        wrong[name] = getattr(robot, name) * (1.0 + error)
    if "mass_kg" in wrong:  # at most one of the two, so that their errors cannot cancel in C_rr m
        wrong["rolling_resistance"] = robot.rolling_resistance
    return dataclasses.replace(robot, **wrong)


def _rollouts(vehicle: Plant, runs: Sequence[Motion], mechanisms: Sequence[Mechanism], read_by: ReadBy,
              seed: int) -> list[Work]:  # fmt: skip
    return [
        rollout(vehicle, run, mechanisms, np.random.default_rng([seed, run.index]), read_by)
        for run in runs
    ]


def _later(vehicle: Plant, routes: list[Course], mean_c: float, driven: int, mechanisms: Sequence[Mechanism],
           read_by: ReadBy, rng: Generator, short: bool) -> list[Later]:  # fmt: skip
    """Two drives on the known routes and two on new ones, after all changes; with the energy that
    it truly consumed."""
    physical = [mechanism for mechanism in mechanisms if mechanism.stage != "instrument"]
    new = [_route(vehicle, tuple(m.effect for m in mechanisms), rng) for _ in range(2)]
    later = []
    for ways in (routes, new):
        for run in make_drives(vehicle, ways, rng, 2, mean_c, short):
            later_run = dataclasses.replace(run, index=driven + run.index)
            work = rollout(vehicle, later_run, physical, rng, read_by)
            later.append(Later(later_run, work.chemical_w))
    return later


def missed_share(works: Sequence[Work]) -> float:
    """Residual of the best refit of noise-free recordings: RMS over 5 s windows relative to the
    mean power."""
    return _fit(works)[1]


def _refit(works: Sequence[Work]) -> Robot:
    """The robot with the parameter groups that fit noise-free recordings best."""
    robot = works[0].vehicle.robot
    over_gamma, _ = _fit(works)
    idle_w, sample_j = over_gamma[:2]
    rolling, drag, grade = over_gamma[2:] * robot.traction_efficiency
    mass_kg = max(grade / GRAVITY_MPS2, 0.01 * robot.mass_kg)
    return dataclasses.replace(
        robot, mass_kg=mass_kg, rolling_resistance=float(np.clip(rolling / GRAVITY_MPS2 / mass_kg, 1e-4, 1.0)),
        drag_ns2_per_m2=drag, sensing_j_per_sample=max(sample_j - robot.computer_j_per_sample, 0.0),
        controller_w=max(idle_w - robot.sensing_idle_w - robot.communication_w, 0.0),
    )  # fmt: skip


def _fit(works: Sequence[Work]) -> tuple[Array, float]:
    """Fit the model's own parameter groups to noise-free recordings: the groups, and the relative
    residual.

    The groups are those that power identifies: idle power, energy per sample, and C_rr m, c and m
    over Gamma, none of them negative. Descents without consumption are left out, because the model
    has a kink there.
    """
    robot = works[0].vehicle.robot
    columns = []
    powers = []
    for work in works:
        run = work.run
        speed = run.speed_mps * work.odometer_gain
        slope = np.sin(run.grade_rad)
        pulls = speed * (robot.rolling_resistance * np.cos(run.grade_rad) + slope > 0.0)
        groups = np.column_stack(
            [
                np.ones(speed.size),
                run.sensing_hz,
                pulls * np.cos(run.grade_rad),
                pulls * speed**2,
                pulls * slope,
            ]
        )
        block = max(1, round(5.0 / run.dt_s))
        whole_blocks = speed.size // block * block
        columns.append(groups[:whole_blocks].reshape(-1, block, groups.shape[1]).mean(axis=1))
        powers.append(read_power(work)[:whole_blocks].reshape(-1, block).mean(axis=1))
    matrix = np.concatenate(columns)
    power_w = np.concatenate(powers)
    scale = np.maximum(np.abs(matrix).max(axis=0), 1e-12)
    groups = nnls(matrix / scale, power_w)[0] / scale
    missed_w = power_w - matrix @ groups
    return groups, float(np.sqrt(np.mean(missed_w**2)) / np.mean(np.abs(power_w)))
