"""Packs of PyBaMM's cells: what is lost shows where it should."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("pybamm")

from benchmarks.concealed.plants import cell
from benchmarks.concealed.plants.chain import rollout
from benchmarks.concealed.plants.motion import make_drives, make_route
from benchmarks.concealed.plants.vehicles import SCOUT


def test_a_pack_that_fades_shows_in_its_charge_and_not_in_its_power() -> None:
    rng = np.random.default_rng(4)
    drives = make_drives(SCOUT, [make_route(SCOUT, rng)], rng, 2, 15.0, short=True)
    pack = dict(cell.PACKS)[("ageing",)]
    vehicle, (_, last) = cell.fitted(pack, SCOUT, drives, rng)
    plain, faded = (
        rollout(vehicle, last, some, rng, "terminals")
        for some in ([], [cell.in_pack(pack, "ageing", vehicle, rng, 2)])
    )
    np.testing.assert_allclose(faded.seen_w, plain.seen_w)
    assert np.all(faded.chemical_w > plain.chemical_w)
    lost = np.sum(faded.chemical_w - plain.chemical_w) / np.sum(plain.chemical_w)
    assert 0.0 < lost < 0.1
    assert faded.capacity_share < 0.75
    assert 0.95 - faded.soc[-1] == pytest.approx(
        (1.0 + lost) / faded.capacity_share * (0.95 - plain.soc[-1])
    )
    assert 0.9 < faded.voltage_v.mean() / vehicle.robot.nominal_voltage_v < 1.2
