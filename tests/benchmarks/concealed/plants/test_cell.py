"""Cells of PyBaMM: cold, contacts and lost lithium cost what they must, and show where they should."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("pybamm")

from benchmarks.concealed.plants import cell
from benchmarks.concealed.plants.cell_electrochemistry import Cell, Discharge, ExhaustedError, discharge
from benchmarks.concealed.plants.chain import rollout
from benchmarks.concealed.plants.motion import Array, make_drives, make_route
from benchmarks.concealed.plants.vehicles import SCOUT

POWER_CELL = Cell(cell.POWER_CELL)
TIME_S = np.arange(30.0)


def under(which: Cell, air_c: float, load_w: float = 0.6) -> tuple[Array, Discharge]:
    load = np.where(TIME_S % 30.0 < 15.0, load_w, 0.1 * load_w)
    return load, discharge(which, TIME_S, load, np.full(TIME_S.size, air_c), 0.7)


def test_cold_costs_energy_and_contacts_lose_what_ohm_says() -> None:
    contact = 0.2 / 0.15625  # Ohm, of a cell of 0.15625 A h
    (load, bare), (_, loose) = under(POWER_CELL, 25.0), under(Cell(cell.POWER_CELL, contact_ohm_ah=0.2), 25.0)
    steady = (TIME_S % 15.0) > 5.0  # the load is a ramp of one second between its levels
    extra = loose.chemical_w - bare.chemical_w
    np.testing.assert_allclose(extra[steady], contact * loose.current_a[steady] ** 2, rtol=0.15)
    warm, cold = (np.sum(one.chemical_w - load) / np.sum(load) for one in (bare, under(POWER_CELL, -10.0)[1]))
    assert 0.0 < warm < 0.03 < cold


def test_an_overload_is_said() -> None:
    with pytest.raises(ExhaustedError, match="cannot deliver"):
        under(Cell(cell.POWER_CELL, contact_ohm_ah=1.0), 25.0, 3.0)


def test_a_pack_that_fades_shows_in_its_charge_and_not_in_its_power() -> None:
    rng = np.random.default_rng(4)
    drives = make_drives(SCOUT, [make_route(SCOUT, rng)], rng, 2, 15.0, short=True)
    pack = dict(cell.PACKS)[("ageing",)]
    vehicle, (_, last) = cell.fitted(pack, SCOUT, drives, rng)
    plain, faded = (
        rollout(vehicle, last, some, rng, "terminals") for some in ([], [cell.in_pack(pack, "ageing", vehicle, rng, 2)])
    )
    np.testing.assert_allclose(faded.seen_w, plain.seen_w)
    assert np.all(faded.chemical_w > plain.chemical_w)
    lost = np.sum(faded.chemical_w - plain.chemical_w) / np.sum(plain.chemical_w)
    assert 0.0 < lost < 0.1
    assert faded.capacity_share < 0.75
    assert 0.95 - faded.soc[-1] == pytest.approx((1.0 + lost) / faded.capacity_share * (0.95 - plain.soc[-1]))
    assert 0.9 < faded.voltage_v.mean() / vehicle.robot.nominal_voltage_v < 1.2
