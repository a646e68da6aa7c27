"""Vehicles with batteries of PyBaMM: cases in which the nominal robot lacks physics of the
battery."""

from __future__ import annotations

import copy
import dataclasses
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.random import Generator

from benchmarks.concealed.plants import cell_electrochemistry as electrochemistry
from benchmarks.concealed.plants.cases import Case, control_case, hidden_case
from benchmarks.concealed.plants.cell_electrochemistry import RATES, ROOM_C, Cell, ExhaustedError
from benchmarks.concealed.plants.chain import Mechanism, Work, rollout
from benchmarks.concealed.plants.effects import EFFECTS
from benchmarks.concealed.plants.instruments import NOISES
from benchmarks.concealed.plants.motion import Array, Motion
from benchmarks.concealed.plants.vehicles import Plant

STEP_S = 1.0  # of the load on a cell; chosen
START = 0.95  # state of charge, as in the chain
START_C, CHANGE_C = (-18.0, 22.0), (-8.0, 8.0)  # of the air where cold matters, in each drive
ENERGY_CELL, POWER_CELL = "OKane2022", "Ecker2015"


@dataclass(frozen=True)
class Pack:
    """A pack with its state in the first and in the last drive, linear in between."""

    cell: str
    peak_rate: float  # highest load over rated energy, per hour
    contact_ohm_ah: tuple[float, float] = (0.0, 0.0)
    # from the first contact resistance to the last at once, half-way through the drives
    loosens: bool = False
    lithium_lost: tuple[float, float] = (0.0, 0.0)
    air_c: float | None = ROOM_C  # None: that of the drive

    def in_run(self, number: int, runs: int) -> Cell:
        """State of the cell in a drive."""
        passed = float(number >= runs // 2) if self.loosens else number / (runs - 1)
        first, last = self.contact_ohm_ah
        contact = first + passed * (last - first)
        return Cell(
            self.cell,
            contact,
            self.lithium_lost[0] + passed * (self.lithium_lost[1] - self.lithium_lost[0]),
        )


PACKS: tuple[tuple[tuple[str, ...], Pack], ...] = (
    (("internal_resistance",), Pack(ENERGY_CELL, 2.6, (0.2, 0.2))),
    (("internal_resistance",), Pack(ENERGY_CELL, 2.0, (0.35, 0.35))),
    (("internal_resistance",), Pack(ENERGY_CELL, 1.7, (0.05, 0.3), loosens=True)),
    (("internal_resistance",), Pack(ENERGY_CELL, 1.4, (0.0, 0.25), loosens=True)),
    (("cold_battery",), Pack(POWER_CELL, 1.9, air_c=None)),
    (("cold_battery",), Pack(POWER_CELL, 2.4, air_c=None)),
    (("cold_battery",), Pack(POWER_CELL, 2.6, air_c=None)),
    (("ageing",), Pack(POWER_CELL, 1.7, lithium_lost=(0.0, 0.25))),
    (("ageing",), Pack(POWER_CELL, 1.1, lithium_lost=(0.0, 0.35))),
    (("rate_capacity",), Pack(POWER_CELL, 3.9, air_c=8.0)),
    (("rate_capacity",), Pack(POWER_CELL, 3.5, air_c=2.0)),
    (("payload", "cold_battery"), Pack(POWER_CELL, 2.9, air_c=None)),
    (("standby", "cold_battery"), Pack(POWER_CELL, 1.9, air_c=None)),
)
"""Concealed effects and the pack; with payload and standby, two effects."""

STRONG = Pack(POWER_CELL, 0.1)
"""So large for its load that its losses are negligible."""

KINDS = (
    *((truth, pack, level) for truth, pack in PACKS for level in NOISES),
    *(((), STRONG, label) for label in ("exact", "misset") for _ in range(6)),
)
"""Concealed effects, the pack, and the noise level or kind of control."""


def make(
    number: int, truth: tuple[str, ...], pack: Pack, label: str, rng: Generator, short: bool
) -> Case:
    """One case, with a larger pack if the given one reaches its cut-off voltage."""
    for _ in range(5):
        draws = copy.deepcopy(rng)
        draw = partial(in_pack, pack, truth[-1] if truth else "none")
        fit = partial(fitted, pack)
        try:
            if not truth:
                return control_case(
                    number, label == "exact", "none", draws, short, "cell", fit, (draw,)
                )
            return hidden_case(
                "cell", number, truth, label, draws, short, fit, EFFECTS | {truth[-1]: draw}
            )
        except ExhaustedError:
            pack = dataclasses.replace(pack, peak_rate=0.8 * pack.peak_rate)
    raise RuntimeError(f"no pack is large enough for case {number}")


def fitted(
    pack: Pack, vehicle: Plant, runs: list[Motion], rng: Generator
) -> tuple[Plant, list[Motion]]:
    """The vehicle with the pack's energy, by the highest load of its drives; some drives are cold
    if that matters."""
    most_w = max(
        float(rollout(vehicle, run, [], np.random.default_rng(0)).power_w.max()) for run in runs
    )
    rated_j = most_w * 3600.0 / pack.peak_rate
    vehicle = dataclasses.replace(
        vehicle, robot=dataclasses.replace(vehicle.robot, rated_energy_j=rated_j)
    )
    if pack.air_c is not None:
        return vehicle, runs

    def air_c(run: Motion) -> Array:
        return np.linspace(0.0, rng.uniform(*CHANGE_C), run.time_s.size) + rng.uniform(*START_C)

    return vehicle, [dataclasses.replace(run, temperature_c=air_c(run)) for run in runs]


def in_pack(pack: Pack, effect: str, vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Mechanism of a pack with the vehicle's rated energy."""

    def change(work: Work, _: Generator) -> None:
        fresh = Cell(pack.cell)
        cell = pack.in_run(min(work.run.index, runs - 1), runs)
        cells = vehicle.robot.rated_energy_j / electrochemistry.rated_energy_j(fresh)
        if effect == "rate_capacity":
            assert pack.air_c is not None
            work.chemical_w = cells * electrochemistry.counted_w(
                cell, work.power_w / cells, pack.air_c
            )
            return
        time_s = np.arange(0.0, work.run.time_s[-1] + STEP_S, STEP_S)
        load_w, air_c = (
            np.interp(time_s, work.run.time_s, x)
            for x in (work.power_w / cells, work.run.temperature_c)
        )
        air_c = air_c if pack.air_c is None else np.full(time_s.size, pack.air_c)
        discharged = electrochemistry.discharge(cell, time_s, load_w, air_c, START)
        lost_w = np.interp(work.run.time_s, time_s, discharged.chemical_w - load_w)
        work.chemical_w = work.power_w + cells * lost_w
        rested_v = (
            electrochemistry.energy_to_be_had(fresh, ROOM_C, RATES[0])[0]
            / RATES[0]
            / electrochemistry.capacity_ah(fresh)
        )
        work.voltage_v = np.interp(work.run.time_s, time_s, load_w / discharged.current_a)
        work.voltage_v *= vehicle.robot.nominal_voltage_v / rested_v
        work.capacity_share = electrochemistry.rated_energy_j(
            Cell(pack.cell, lithium_lost=cell.lithium_lost)
        ) / electrochemistry.rated_energy_j(fresh)

    return Mechanism(effect, "battery", change)
