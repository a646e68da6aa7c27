"""Cells under load, by PyBaMM: voltage sag, cold, lost lithium and rate-dependent energy follow
from a cell model.

The model is the single-particle model with electrolyte; a pack consists of equal cells. Sources of
the parameter sets: O'Kane et al. 2022 (LG M50, an energy cell) and Ecker et al. 2015 (Kokam, a
power cell that is weak in the cold).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pybamm
from scipy.interpolate import PchipInterpolator

from benchmarks.concealed.plants.motion import Array
from benchmarks.concealed.plants.vehicles import KELVIN

ROOM_C = 25.0  # at which the rated energy is measured; chosen
RATES = (0.05, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
"""At which the energy of a cell is measured, multiples of its capacity per hour."""


class ExhaustedError(RuntimeError):
    """A load that a cell cannot deliver for its duration."""


@dataclass(frozen=True)
class Cell:
    """A cell in some state of health."""

    parameters: str  # name of PyBaMM's parameter set
    # resistance of tabs and connectors times capacity, the same for large cells and small
    contact_ohm_ah: float = 0.0
    lithium_lost: float = 0.0  # share of the cyclable lithium


@dataclass(frozen=True)
class Discharge:
    """Results of one cell under a load; arrays of shape (n,)."""

    current_a: Array
    rest_v: Array  # open-circuit voltage at the mean state of charge
    temperature_c: Array

    @property
    def chemical_w(self) -> Array:
        """Rate at which stored energy falls, W."""
        return np.asarray(self.rest_v * self.current_a)


def _values(cell: Cell, extra: Mapping[str, Any]) -> Any:
    values = pybamm.ParameterValues(cell.parameters)
    lithium = "Initial concentration in negative electrode [mol.m-3]"
    values[lithium] = values[lithium] * (1.0 - cell.lithium_lost)
    values.update(
        {"Contact resistance [Ohm]": cell.contact_ohm_ah / capacity_ah(cell), **extra},
        check_already_exists=False,
    )
    return values


def capacity_ah(cell: Cell) -> float:
    """Rated capacity, A h."""
    return float(pybamm.ParameterValues(cell.parameters)["Nominal cell capacity [A.h]"])


def _solve(cell: Cell, mode: str, extra: Mapping[str, Any], soc: float, stops_s: Array) -> Any:
    """Solution of the cell model; the solver stops at kinks of the load, so that it does not step
    across."""
    model = pybamm.lithium_ion.SPMe(
        {"thermal": "lumped", "operating mode": mode, "contact resistance": "true"}
    )
    solver = pybamm.IDAKLUSolver(rtol=1e-4, atol=1e-6)
    simulation = pybamm.Simulation(model, parameter_values=_values(cell, extra), solver=solver)
    return simulation.solve(stops_s, initial_soc=soc)


def discharge(cell: Cell, time_s: Array, load_w: Array, air_c: Array, soc: float) -> Discharge:
    """One cell under a load.

    Args:
        cell: The cell.
        time_s: From 0, shape (n,).
        load_w: Power at the terminals, shape (n,).
        air_c: Ambient temperature, C, shape (n,); the cell starts at it.
        soc: State of charge at the start, 0 to 1.

    Raises:
        ExhaustedError: The cell cannot deliver the load for its duration.
    """
    extra = {
        "Power function [W]": pybamm.Interpolant(time_s, load_w, pybamm.t),
        "Ambient temperature [K]": lambda y, z, t: pybamm.Interpolant(time_s, air_c + KELVIN, t),
        "Initial temperature [K]": float(air_c[0]) + KELVIN,
    }
    asked = f"{cell} at {soc:.0%} charge cannot deliver {load_w.max():.3g} W"
    try:
        solution = _solve(cell, "power", extra, soc, time_s)
    except pybamm.SolverError as error:  # no current delivers the load
        raise ExhaustedError(f"{asked}: {error}") from error
    if solution.t[-1] < time_s[-1]:
        raise ExhaustedError(f"{asked}: {solution.termination}")
    return Discharge(
        current_a=np.asarray(solution["Current [A]"](time_s)),
        rest_v=np.asarray(solution["Battery open-circuit voltage [V]"](time_s)),
        temperature_c=np.asarray(solution["Volume-averaged cell temperature [K]"](time_s)) - KELVIN,
    )


@cache
def energy_to_be_had(cell: Cell, temperature_c: float, rate: float) -> tuple[float, float]:
    """Mean power, W, and energy, J, of a full cell discharged to its cut-off voltage at a rate, per
    hour."""
    current_a = rate * capacity_ah(cell)
    kelvin = temperature_c + KELVIN
    extra = {
        "Current function [A]": current_a,
        "Ambient temperature [K]": kelvin,
        "Initial temperature [K]": kelvin,
    }
    solution = _solve(cell, "current", extra, 1.0, np.array([0.0, 1.5 * 3600.0 / rate]))
    energy_j = current_a * float(np.trapezoid(solution["Battery voltage [V]"].entries, solution.t))
    return energy_j / float(solution.t[-1]), energy_j


def rated_energy_j(cell: Cell) -> float:
    """Energy of a cell at room temperature, discharged slowly, J."""
    return energy_to_be_had(cell, ROOM_C, RATES[0])[1]


def counted_w(cell: Cell, load_w: Array, temperature_c: float) -> Array:
    """Rate at which a charge gauge that corrects for the discharge rate counts down the rated
    energy, W; shape (n,).

    At a power at which only a share of the energy is available, each joule delivered counts as its
    inverse.
    """
    power_w, energy_j = np.array([energy_to_be_had(cell, temperature_c, rate) for rate in RATES]).T
    to_be_had = PchipInterpolator(power_w, energy_j / energy_j[0])(
        np.clip(load_w, power_w[0], power_w[-1])
    )
    return np.asarray(load_w / to_be_had)
