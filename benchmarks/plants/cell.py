"""Batteries of PyBaMM under the plants' robots: cases in which the battery is what the nominal file leaves out.

What is recorded is the power that the store gives up, as a fuel gauge counts it against the rated energy, so that sag
and cold show as power beyond the load. Of a pack that fades, power at the terminals and the gauge's charge are.

`python benchmarks/plants/cell.py` prints the table of cases.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.plants import base, electrochemistry
from benchmarks.plants.case import Case, Kind, Noise, Run, anonymous
from benchmarks.plants.drives import Array, Drive
from benchmarks.plants.electrochemistry import ROOM_C, Cell
from benchmarks.plants.observe import NOISE, observe
from benchmarks.plants.plant import EVERY, VISIBLE_BELOW, summary
from benchmarks.plants.rollout import Rollout, Scenario, hidden_efforts, start
from homeward.physics import Robot

STEP_S = 1.0
SOC_STEP = 5e-4
DRAWS, LIVELY_BELOW = 24, 0.87
ENERGY_CELL, POWER_CELL = "OKane2022", "Ecker2015"


@dataclass(frozen=True)
class Pack:
    """A pack and how it is in the first and in the last run; in between, its state moves evenly."""

    cell: str
    peak_rate: float  # highest load over rated energy, per hour
    contact_ohm_ah: tuple[float, float] = (0.0, 0.0)
    loosens: bool = False  # from the first contact resistance to the last at once, half-way through the runs
    lithium_lost: tuple[float, float] = (0.0, 0.0)
    air_c: float | None = ROOM_C  # None: that of the journey

    def in_run(self, number: int, runs: int) -> Cell:
        """The cell as it is in a run."""
        passed = float(number >= runs // 2) if self.loosens else number / (runs - 1)
        first, last = self.contact_ohm_ah
        contact = first + passed * (last - first)
        return Cell(self.cell, contact, self.lithium_lost[0] + passed * (self.lithium_lost[1] - self.lithium_lost[0]))


Listed = tuple[str, str, Pack]
PACKS: dict[str, tuple[Listed, ...]] = {
    "internal_resistance": (
        ("van", "passes", Pack(ENERGY_CELL, 2.6, (0.2, 0.2))),
        ("van", "passes", Pack(ENERGY_CELL, 2.0, (0.35, 0.35))),
        ("courier", "hills", Pack(ENERGY_CELL, 1.7, (0.05, 0.3), loosens=True)),
        ("husky", "patrol", Pack(ENERGY_CELL, 1.4, (0.0, 0.25), loosens=True)),
    ),
    "cold_battery": (
        ("husky", "climate", Pack(POWER_CELL, 1.9, air_c=None)),
        ("courier", "climate", Pack(POWER_CELL, 2.4, air_c=None)),
        ("jackal", "climate", Pack(POWER_CELL, 2.6, air_c=None)),
    ),
    "ageing": (
        ("courier", "depot", Pack(POWER_CELL, 1.7, lithium_lost=(0.0, 0.25))),
        ("husky", "depot", Pack(POWER_CELL, 1.1, lithium_lost=(0.0, 0.35))),
    ),
    "rate_capacity": (
        ("van", "passes", Pack(POWER_CELL, 3.9, air_c=8.0)),
        ("van", "passes", Pack(POWER_CELL, 3.5, air_c=2.0)),
    ),
}
"""Of each effect of the battery, the robots, journeys and packs in which it is hidden."""

PAIRS: tuple[tuple[tuple[str, ...], str, str, Pack], ...] = (
    (("payload", "cold_battery"), "courier", "climate", Pack(POWER_CELL, 2.9, air_c=None)),
    (("standby", "cold_battery"), "husky", "climate", Pack(POWER_CELL, 1.9, air_c=None)),
)
STRONG = Pack(POWER_CELL, 0.1)
"""So much larger than its load that hardly anything is lost in it."""

CONTROLS = (("courier", "patrol"), ("husky", "hills"), ("jackal", "survey"), ("porter", "indoor"), ("van", "passes"),
            ("rusti_computer", "survey"))  # fmt: skip


def simulate(scenario: Scenario, pack: Pack) -> tuple[Rollout, tuple[Array, ...]]:
    """Drive a scenario's robot on a pack: what happened, and the gauge's state of charge in each run."""
    nominal, robot, drives = start(scenario, STEP_S)
    plain = [base.drawn(robot, drive, base.force(robot, drive)) for drive in drives]
    loads, drive_effects = _loads(scenario, robot, plain, drives)
    fresh = Cell(pack.cell)
    cell_j = electrochemistry.rated_energy_j(fresh)
    count = max(round(float(np.max(np.concatenate(loads))) * 3600.0 / pack.peak_rate / cell_j), 1)
    rng = np.random.default_rng([scenario.seed, 50])
    battery, counted, seen = [], [], []
    for drive, load in zip(drives, loads, strict=True):
        cell = pack.in_run(drive.number, len(drives))
        gauge, temperature = _gauge(scenario.truth, pack, cell, drive, load / count, rng)
        seen.append(dataclasses.replace(drive, temperature_c=temperature))
        battery.append(count * gauge - load)
        counted.append(_charge(gauge / cell_j, rng))
    faded = "ageing" in scenario.truth  # the gauge alone knows of it
    clean = [load if faded else load + extra for load, extra in zip(loads, battery, strict=True)]
    nominal, robot = (dataclasses.replace(r, rated_energy_j=count * cell_j) for r in (nominal, robot))
    effects = (*drive_effects, tuple(battery)) if scenario.truth else ()
    return Rollout(nominal, robot, drives, tuple(seen), tuple(clean), effects, False, scenario.flat, True), tuple(
        counted
    )


def _loads(
    scenario: Scenario, robot: Robot, plain: list[Array], drives: tuple[Drive, ...]
) -> tuple[list[Array], tuple[tuple[Array, ...], ...]]:
    """Power that each run asks of the pack, and what each hidden effect of the drive adds to it."""
    effects = tuple(
        tuple(
            base.drawn(robot, d, base.force(robot, d) + e.force_n) + e.power_w - p
            for d, e, p in zip(drives, effort, plain, strict=True)
        )
        for effort in hidden_efforts(scenario, robot, drives).values()
    )
    return [p + sum(effect[run] for effect in effects) for run, p in enumerate(plain)], effects


def _gauge(
    truth: tuple[str, ...], pack: Pack, cell: Cell, drive: Drive, load_w: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Rate at which the rated energy of one cell is counted down, W, and its temperature, C; shape (n,)."""
    air_c = drive.temperature_c if pack.air_c is None else np.full(load_w.size, pack.air_c)
    if "rate_capacity" in truth:
        mean_c = float(np.mean(air_c))
        return electrochemistry.counted_w(cell, load_w, mean_c), air_c
    discharged = electrochemistry.discharge(cell, drive.time_s, load_w, air_c, float(rng.uniform(0.6, 0.95)))
    faded = electrochemistry.rated_energy_j(Cell(pack.cell)) / electrochemistry.rated_energy_j(
        Cell(pack.cell, lithium_lost=cell.lithium_lost)
    )
    return faded * discharged.chemical_w, discharged.temperature_c


def _charge(share_per_s: Array, rng: np.random.Generator) -> Array:
    """State of charge that a gauge shows, from the rate at which it counts; shape (n,)."""
    soc = rng.uniform(0.8, 0.98) - np.concatenate([[0.0], np.cumsum(share_per_s[:-1])]) * STEP_S
    return np.asarray(np.round(soc / SOC_STEP) * SOC_STEP)


def scenarios(seed: int = 0) -> Iterator[tuple[Scenario, Pack, tuple[Noise, ...]]]:
    """All scenarios, the packs, and the noise levels at which each is recorded; the same with the same seed."""
    number = 1000 * seed + 500
    for effect, places in PACKS.items():
        for robot, profile, pack in places:
            yield Scenario("single", (effect,), robot, profile, number := number + 1), pack, EVERY
    for truth, robot, profile, pack in PAIRS:
        yield Scenario("pair", truth, robot, profile, number := number + 1, share=0.12), pack, EVERY
    kinds: tuple[Kind, ...] = ("exact", "misset")
    for kind in kinds:
        for index, (robot, profile) in enumerate(CONTROLS):
            flat = profile == "indoor"
            yield Scenario(kind, (), robot, profile, number := number + 1, flat=flat), STRONG, (EVERY[index % 3],)


def record(scenario: Scenario, rollout: Rollout, charge: tuple[Array, ...], noise: Noise, number: int) -> Case:
    """One case of a rollout; the state of charge is logged where it is needed, and by every other robot besides."""
    hidden = any(share >= VISIBLE_BELOW for share in rollout.absorbed)
    seed = 10 * scenario.seed + list(NOISE).index(noise)
    runs, noise_rms = observe(rollout, noise, seed, scenario.kind == "exact", scenario.robot != "porter")
    if "ageing" in scenario.truth or number % 2:
        runs = tuple(
            Run({**run.channels, "soc": soc}, run.affected) for run, soc in zip(runs, charge, strict=True)
        )  # fmt: skip
    return Case(
        anonymous("cell", number), "cell", "invisible" if hidden else scenario.kind, scenario.truth, noise, seed,
        rollout.nominal, runs, noise_rms,
    )  # fmt: skip


def lively(scenario: Scenario) -> Scenario:
    """The scenario with the one of many drawn journeys in which what grows with the square of the load shows best.

    A refit must not absorb it, and it should not come from one climb in one run: nothing held out would confirm it.
    """

    def merit(drawn: Scenario) -> tuple[bool, float]:
        _, robot, drives = start(drawn, STEP_S)
        squared = [base.drawn(robot, drive, base.force(robot, drive)) ** 2 for drive in drives]
        columns = np.concatenate([base.columns(robot, drive) for drive in drives])
        sums = [float(run @ run) for run in squared]
        hidden = base.absorbed_share(np.concatenate(squared), columns) > LIVELY_BELOW
        return hidden, max(sums) / sum(sums) * len(sums)

    return min((dataclasses.replace(scenario, seed=scenario.seed + 10**7 * draw) for draw in range(DRAWS)), key=merit)


def roll(scenario: Scenario, pack: Pack) -> tuple[Rollout, tuple[Array, ...]]:
    """Rollout of a scenario, on a larger pack where the one given runs into its lowest voltage."""
    journey = lively(scenario) if scenario.profile == "passes" else scenario
    for _ in range(4):
        try:
            return simulate(journey, pack)
        except electrochemistry.ExhaustedError:
            pack = dataclasses.replace(pack, peak_rate=0.8 * pack.peak_rate)
    return simulate(journey, pack)


def rollouts(seed: int = 0) -> Iterator[tuple[Rollout, Case]]:
    """Every case with the rollout behind it, one at a time."""
    number = 1000 * seed
    for scenario, pack, levels in scenarios(seed):
        rollout, charge = roll(scenario, pack)
        for noise in levels:
            yield rollout, record(scenario, rollout, charge, noise, number)
            number += 1


def cases(seed: int = 0) -> Iterator[Case]:
    """Every case of the batteries, one at a time."""
    return (case for _, case in rollouts(seed))


if __name__ == "__main__":
    summary("Batteries by PyBaMM", rollouts())
