"""Terminal voltage by PyBaMM: a table over charge, steady current and temperature, computed once a run.

Stepping PyBaMM itself every second would take minutes a drive. The table holds its voltage under steady currents, so
what PyBaMM says about cold, rate and diffusion is kept, and only the speed of its reaction to a change is simplified.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from benchmarks.on_the_robot.gauges.cell import Floats

PARAMETER_SETS = {"nmc": "Chen2020", "lfp": "Prada2013"}
RATES_C = np.array([0.02, 0.1, 0.25, 0.5, 1.0, 1.5])  # chosen: up to the hardest climb of a small pack
TEMPERATURES_C = np.array([-15.0, -5.0, 5.0, 15.0, 25.0, 40.0])  # chosen: around the drawn range
SHARES = np.linspace(0.0, 1.0, 201)  # chosen: half a percent resolves the knee
FALL_V = 1.0  # V, chosen: below the end of a discharge the table falls by this, so that the pack cuts off


@dataclass(frozen=True)
class Table:
    """Voltage of a cell, V, shape (shares, C-rates, temperatures), and its axes."""

    voltage_v: Floats
    shares: Floats
    rates_c: Floats
    temperatures_c: Floats


NO_TABLE = Table(np.zeros((2, 2, 2)), np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.array([0.0, 1.0]))


def missing() -> str | None:
    """What to install, in a line; None if all is there."""
    if find_spec("pybamm") is None:
        return "--engine pybamm needs PyBaMM, which is not installed: pip install pybamm"
    return None


def make_table(chemistry: str) -> Table:
    """Discharge PyBaMM's cell at several currents and temperatures; about ten seconds."""
    voltage_v = np.empty((SHARES.size, RATES_C.size, TEMPERATURES_C.size))
    slow_warm_ah, _slow_warm_v = _discharge(chemistry, float(RATES_C[0]), float(TEMPERATURES_C[-1]))
    full_charge_ah = slow_warm_ah[-1]
    for layer, temperature_c in enumerate(TEMPERATURES_C):
        for column, rate_c in enumerate(RATES_C):
            drawn_ah, cell_v = _discharge(chemistry, float(rate_c), float(temperature_c))
            share = 1.0 - drawn_ah / full_charge_ah
            rising_share, rising_v = share[::-1], cell_v[::-1]
            inside_v = np.interp(SHARES, rising_share, rising_v)
            short_of_end = np.maximum(rising_share[0] - SHARES, 0.0)
            voltage_v[:, column, layer] = inside_v - FALL_V * np.minimum(short_of_end / 0.02, 1.0)
    return Table(voltage_v, SHARES, RATES_C, TEMPERATURES_C)


def _discharge(chemistry: str, rate_c: float, temperature_c: float) -> tuple[Floats, Floats]:
    """Charge drawn, Ah, and voltage, V, of a cell's discharge from full; both of shape (times,)."""
    os.environ.setdefault("PYBAMM_DISABLE_TELEMETRY", "true")  # it would ask on the terminal
    import pybamm

    values = pybamm.ParameterValues(PARAMETER_SETS[chemistry])
    nominal_ah = float(values["Nominal cell capacity [A.h]"])
    values["Current function [A]"] = rate_c * nominal_ah
    values["Ambient temperature [K]"] = temperature_c + 273.15
    values["Initial temperature [K]"] = temperature_c + 273.15
    # Prada2013 lacks what electrolyte dynamics need at all rates; the single particle model needs nothing more.
    model = pybamm.lithium_ion.SPMe() if chemistry == "nmc" else pybamm.lithium_ion.SPM()
    end_s = 1.3 * 3600.0 / rate_c
    simulation = pybamm.Simulation(model, parameter_values=values)
    solution = simulation.solve([0.0, end_s], t_interp=np.linspace(0.0, end_s, 1000), initial_soc=1.0)
    drawn_ah: Floats = np.asarray(solution["Discharge capacity [A.h]"].entries, dtype=np.float64)
    cell_v: Floats = np.asarray(solution["Terminal voltage [V]"].entries, dtype=np.float64)
    return drawn_ah, cell_v
