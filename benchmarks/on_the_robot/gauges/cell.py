"""A battery pack: open-circuit curves, two RC pairs, two charge wells, cold and self-heating.

Each chemistry has a curve of another form: a sum of logistic steps, Plett's combined model, a power
of the charge, or Shepherd's. Resistance depends on temperature (Arrhenius), on charge, and for
charge transfer on current.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LOGISTIC, COMBINED, POWER, SHEPHERD = 0, 1, 2, 3
CURVES = {"logistic": LOGISTIC, "combined": COMBINED, "power": POWER, "shepherd": SHEPHERD}

# Columns of a pack's state.
AVAILABLE, BOUND, SLOW_V, DIFFUSION_V, TEMPERATURE_C = range(5)

KELVIN = 273.15  # K, zero of the Celsius scale
REFERENCE_K = 298.15  # K, 25 C: temperature for which resistance and capacity are stated
EMPTY_CHARGE = 1e-6  # share, chosen: a curve with a logarithm cannot be evaluated at 0


class Pack(NamedTuple):
    """A pack's true parameters; sags are volts per cell at a current that empties the label's
    charge in an hour."""

    curve: int
    curve_v: Floats
    cells: int
    label_ah: float
    true_ah: float  # in both wells at 25 C, including what a cut-off leaves
    learned_ah: float  # what it gives at 25 C before it is cut off
    cutoff_v: float  # of the pack
    ohm_sag_v: float
    slow_sag_v: float
    diffusion_sag_v: float
    ohm_activation_k: float
    slow_activation_k: float
    cold_loss_per_k: float
    heat_j_per_k: float
    well_share: float
    well_per_h: float
    slow_s: float
    diffusion_s: float
    knee_c: float
    low_charge_rise: float
    low_charge_share: float
    cooling_s: float
    outside_c: float


@numba.njit(cache=True)
def open_circuit_v(curve: int, curve_v: Floats, share: float) -> float:
    """Voltage of a cell at rest, V, at a share of charge of 0 to 1."""
    charge = min(max(share, EMPTY_CHARGE), 1.0)
    if curve == LOGISTIC:
        voltage_v = float(curve_v[0] + curve_v[1] * charge)
        for step in range((curve_v.size - 2) // 3):
            height_v = curve_v[2 + 3 * step]
            place = curve_v[3 + 3 * step]
            width = curve_v[4 + 3 * step]
            voltage_v += height_v / (1.0 + math.exp(-(charge - place) / width))
        return voltage_v
    if curve == COMBINED:
        inner = 0.03 + 0.94 * charge  # Plett keeps the logarithms finite in this way
        return float(
            curve_v[0]
            - curve_v[1] / inner
            - curve_v[2] * inner
            + curve_v[3] * math.log(inner)
            + curve_v[4] * math.log(1.0 - inner)
        )
    if curve == POWER:
        return float(
            curve_v[0]
            + curve_v[1] * charge ** curve_v[2]
            - curve_v[3] * math.exp(-charge / curve_v[4])
        )
    exponential_v = curve_v[2] * math.exp(-curve_v[3] * (1.0 - charge))
    return float(curve_v[0] - curve_v[1] / (0.01 + 0.99 * charge) + exponential_v)


@numba.njit(cache=True)
def height(pack: Pack, state: Floats) -> float:
    """Share of charge as the terminals feel it: the level of the available well."""
    return float(state[AVAILABLE] / pack.well_share)


@numba.njit(cache=True)
def total_share(state: Floats) -> float:
    """Share of the true capacity that is left, both wells."""
    return float(state[AVAILABLE] + state[BOUND])


@numba.njit(cache=True)
def step(pack: Pack, state: Floats, power_w: float, time_s: float) -> tuple[float, float]:
    """Draw a power for a time, and change `state` accordingly; return voltage, V, and current, A,
    at the terminals."""
    charge = height(pack, state)
    inverse_k = 1.0 / (state[TEMPERATURE_C] + KELVIN) - 1.0 / REFERENCE_K
    ohm_factor = math.exp(pack.ohm_activation_k * inverse_k)
    slow_factor = math.exp(pack.slow_activation_k * inverse_k)
    low_charge_factor = 1.0 + pack.low_charge_rise * math.exp(
        -max(charge, 0.0) / pack.low_charge_share
    )
    ohm_sag_v = pack.ohm_sag_v * ohm_factor * low_charge_factor

    cell_v = open_circuit_v(pack.curve, pack.curve_v, charge) - state[SLOW_V] - state[DIFFUSION_V]
    inner_v = pack.cells * cell_v
    inner_ohm = pack.cells * ohm_sag_v / pack.label_ah
    under_root = inner_v * inner_v - 4.0 * inner_ohm * power_w
    if under_root <= 0.0:  # more than the pack can deliver: its voltage collapses
        current_a = inner_v / (2.0 * inner_ohm)
    else:
        current_a = (inner_v - math.sqrt(under_root)) / (2.0 * inner_ohm)
    voltage_v = inner_v - inner_ohm * current_a
    rate_c = current_a / pack.label_ah

    slow_v = (
        pack.slow_sag_v
        * slow_factor
        * low_charge_factor
        * rate_c
        / math.sqrt(1.0 + abs(rate_c) / pack.knee_c)
    )
    diffusion_v = pack.diffusion_sag_v * slow_factor * low_charge_factor * rate_c
    state[SLOW_V] += (slow_v - state[SLOW_V]) * (1.0 - math.exp(-time_s / pack.slow_s))
    state[DIFFUSION_V] += (diffusion_v - state[DIFFUSION_V]) * (
        1.0 - math.exp(-time_s / pack.diffusion_s)
    )

    # In the cold each ampere-hour costs a larger share of what the cell can give.
    usable = 1.0 - pack.cold_loss_per_k * max(25.0 - state[TEMPERATURE_C], 0.0)
    state[AVAILABLE] -= current_a * time_s / (3600.0 * pack.true_ah * usable)
    if pack.well_share < 1.0:
        bound_height = state[BOUND] / (1.0 - pack.well_share)
        flow = pack.well_per_h / 3600.0 * (bound_height - height(pack, state)) * time_s
        state[AVAILABLE] += flow
        state[BOUND] -= flow

    heat_w = current_a * (current_a * inner_ohm + pack.cells * (state[SLOW_V] + state[DIFFUSION_V]))
    cooling_k_per_s = (state[TEMPERATURE_C] - pack.outside_c) / pack.cooling_s
    state[TEMPERATURE_C] += (heat_w / pack.heat_j_per_k - cooling_k_per_s) * time_s
    return voltage_v, current_a


@numba.njit(cache=True)
def is_down(pack: Pack, state: Floats, voltage_v: float) -> bool:
    """Whether the pack is below its cut-off voltage, or empty."""
    return voltage_v <= pack.cutoff_v or state[AVAILABLE] <= 0.0


@numba.njit(cache=True)
def discharge(pack: Pack, state: Floats, power_w: float, trip_s: float) -> tuple[float, float]:
    """Energy, J, and charge, Ah, that the pack still delivers at its terminals under a steady power
    to its cut-off.

    `state` stays as it is. The pack is cut off after `trip_s` below its cut-off voltage, or when it
    is empty.
    """
    time_s = 2.0  # chosen: short beside the RC pairs
    now = state.copy()
    energy_j = 0.0
    charge_ah = 0.0
    low_s = 0.0
    while low_s < trip_s and now[AVAILABLE] > 0.0:
        voltage_v, current_a = step(pack, now, power_w, time_s)
        low_s = low_s + time_s if is_down(pack, now, voltage_v) else 0.0
        energy_j += power_w * time_s
        charge_ah += current_a * time_s / 3600.0
    return energy_j, charge_ah


def full_state(pack: Pack, share: float) -> Floats:
    """State of a rested pack at a share of charge, as warm as the air."""
    return np.array(
        [share * pack.well_share, share * (1.0 - pack.well_share), 0.0, 0.0, pack.outside_c]
    )
