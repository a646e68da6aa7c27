"""Cells of PyBaMM: cold and contacts cost what they must."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("pybamm")

from benchmarks.concealed.plants import cell
from benchmarks.concealed.plants.cell_electrochemistry import (
    Cell,
    Discharge,
    ExhaustedError,
    discharge,
)
from benchmarks.concealed.plants.motion import Array

POWER_CELL = Cell(cell.POWER_CELL)
TIME_S = np.arange(30.0)


def under(which: Cell, air_c: float, load_w: float = 0.6) -> tuple[Array, Discharge]:
    load = np.where(TIME_S % 30.0 < 15.0, load_w, 0.1 * load_w)
    return load, discharge(which, TIME_S, load, np.full(TIME_S.size, air_c), 0.7)


def test_cold_costs_energy_and_contacts_lose_what_ohm_says() -> None:
    contact = 0.2 / 0.15625  # Ohm, of a cell of 0.15625 A h
    (load, bare), (_, loose) = (
        under(POWER_CELL, 25.0),
        under(Cell(cell.POWER_CELL, contact_ohm_ah=0.2), 25.0),
    )
    steady = (TIME_S % 15.0) > 5.0  # the load is a ramp of one second between its levels
    extra = loose.chemical_w - bare.chemical_w
    np.testing.assert_allclose(extra[steady], contact * loose.current_a[steady] ** 2, rtol=0.15)
    warm, cold = (
        np.sum(one.chemical_w - load) / np.sum(load) for one in (bare, under(POWER_CELL, -10.0)[1])
    )
    assert 0.0 < warm < 0.03 < cold


def test_an_overload_is_said() -> None:
    with pytest.raises(ExhaustedError, match="cannot deliver"):
        under(Cell(cell.POWER_CELL, contact_ohm_ah=1.0), 25.0, 3.0)
