from __future__ import annotations

import dataclasses
from collections import Counter

import numpy as np
import pytest

from benchmarks.plants import base
from benchmarks.plants.case import Array
from benchmarks.plants.drives import PROFILES
from benchmarks.plants.observe import window_rms
from benchmarks.plants.rollout import Scenario

pytest.importorskip("pybamm")

from benchmarks.plants import cell
from benchmarks.plants.electrochemistry import (
    Cell,
    Discharge,
    ExhaustedError,
    counted_w,
    discharge,
    energy_to_be_had,
    rated_energy_j,
)

POWER_CELL = Cell(cell.POWER_CELL)
TIME_S = np.arange(90.0)


def under(which: Cell, air_c: float, load_w: float = 0.6) -> tuple[Array, Discharge]:
    load = np.where(TIME_S % 30.0 < 15.0, load_w, 0.1 * load_w)
    return load, discharge(which, TIME_S, load, np.full(TIME_S.size, air_c), 0.7)


def loss(which: Cell, air_c: float) -> float:
    load, discharged = under(which, air_c)
    assert np.all(discharged.chemical_w >= load)
    return float(np.sum(discharged.chemical_w - load) / np.sum(load))


def test_cold_contacts_and_load_cost_energy() -> None:
    warm, cold = loss(POWER_CELL, 25.0), loss(POWER_CELL, -10.0)
    assert 0.0 < warm < 0.03 < cold
    assert loss(Cell(cell.POWER_CELL, contact_ohm_ah=0.2), 25.0) > warm + 0.02


def test_contacts_lose_what_ohm_says() -> None:
    contact = 0.2 / 0.15625  # Ohm, of a cell of 0.15625 A h
    (load, bare), (_, loose) = under(POWER_CELL, 25.0), under(Cell(cell.POWER_CELL, contact_ohm_ah=0.2), 25.0)
    extra = (loose.chemical_w - load) - (bare.chemical_w - load)
    steady = (TIME_S % 15.0) > 5.0  # the load is a ramp of one second between its levels
    np.testing.assert_allclose(extra[steady], contact * loose.current_a[steady] ** 2, rtol=0.15)


def test_an_overload_is_said() -> None:
    with pytest.raises(ExhaustedError, match="cannot deliver"):
        under(Cell(cell.POWER_CELL, contact_ohm_ah=1.0), 25.0, 3.0)


def test_lost_lithium_and_high_rates_leave_less_energy() -> None:
    assert rated_energy_j(Cell(cell.POWER_CELL, lithium_lost=0.2)) < 0.9 * rated_energy_j(POWER_CELL)
    (slow_w, slow_j), (fast_w, fast_j) = (energy_to_be_had(POWER_CELL, 5.0, rate) for rate in (0.05, 3.0))
    assert slow_w < fast_w and fast_j < 0.9 * slow_j
    load = np.array([0.1 * slow_w, slow_w, fast_w])
    counted = counted_w(POWER_CELL, load, 5.0)
    np.testing.assert_allclose(counted[:2], load[:2], rtol=1e-6)
    np.testing.assert_allclose(counted[2], fast_w * slow_j / fast_j, rtol=0.01)


def test_there_are_enough_cases_of_every_kind() -> None:
    count: Counter[str] = Counter()
    for scenario, _, levels in cell.scenarios():
        count["control" if not scenario.truth else scenario.truth[0] if scenario.kind == "single" else "pair"] += len(
            levels
        )
    least = {"internal_resistance": 10, "cold_battery": 8, "ageing": 6, "rate_capacity": 6, "pair": 4, "control": 10}
    assert all(count[kind] >= number for kind, number in least.items())


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("climate", "depot", "patrol"):
        monkeypatch.setitem(PROFILES, name, dataclasses.replace(PROFILES[name], duration_s=(60.0, 70.0), runs=(4, 4)))


@pytest.mark.usefixtures("short")
def test_controls_are_the_papers_model_and_noise() -> None:
    scenario = Scenario("exact", (), "courier", "patrol", 3)
    rollout, charge = cell.simulate(scenario, cell.STRONG)
    case = cell.record(scenario, rollout, charge, "low", 1)
    plain = [base.drawn(case.robot, d, base.force(case.robot, d)) for d in rollout.drives]
    errors = np.concatenate([run.channels["power_w"] - p for run, p in zip(case.runs, plain, strict=True)])
    assert window_rms(errors, cell.STEP_S) == pytest.approx(case.noise_rms, rel=0.1)
    assert not any(run.affected.any() for run in case.runs)


@pytest.mark.usefixtures("short")
def test_a_fading_pack_shows_in_its_charge_and_not_in_its_power() -> None:
    scenario = Scenario("single", ("ageing",), "courier", "depot", 4)
    rollout, charge = cell.simulate(scenario, cell.PACKS["ageing"][0][2])
    case = cell.record(scenario, rollout, charge, "low", 0)
    again = cell.record(scenario, *cell.simulate(scenario, cell.PACKS["ageing"][0][2]), "low", 0)
    per_charge = [np.sum(run.channels["power_w"]) / np.ptp(run.channels["soc"]) for run in case.runs]
    assert per_charge[-1] < 0.85 * per_charge[0]
    for drive, clean in zip(rollout.drives, rollout.clean, strict=True):
        np.testing.assert_allclose(clean, base.drawn(rollout.robot, drive, base.force(rollout.robot, drive)))
    np.testing.assert_array_equal(case.runs[1].channels["soc"], again.runs[1].channels["soc"])


@pytest.mark.usefixtures("short")
def test_a_cold_pack_and_a_payload_are_told_apart_in_the_truth() -> None:
    truth, robot, profile, pack = cell.PAIRS[0]
    rollout, _ = cell.simulate(Scenario("pair", truth, robot, profile, 5, share=0.12), pack)
    for drive, clean, *effects in zip(rollout.drives, rollout.clean, *rollout.effects, strict=True):
        plain = base.drawn(rollout.robot, drive, base.force(rollout.robot, drive))
        np.testing.assert_allclose(clean - sum(effects), plain)
    assert any(np.abs(effect).max() > 0.0 for effect in rollout.effects[truth.index("payload")])
    coldest = int(np.argmin([drive.temperature_c.mean() for drive in rollout.recorded]))
    lost = [
        np.sum(e) / np.sum(c) for e, c in zip(rollout.effects[truth.index("cold_battery")], rollout.clean, strict=True)
    ]
    assert lost[coldest] == max(lost)
