"""Drive out until the battery is cut off, and home from any place: the kernels and their
records."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from benchmarks.on_the_robot.gauges.cell import Floats, Pack, is_down, step, total_share
from benchmarks.on_the_robot.gauges.ground import Ground
from benchmarks.on_the_robot.gauges.sizes import TruthSizes

STAND_STEP_S = 2.0  # s, chosen: step while the robot stops
STATE_COLUMNS = 5
# Columns of a record; means are over the time since the record before.
TIME_S, CELL, SPEED_MPS, VOLTAGE_V, CURRENT_A, POWER_W, ENERGY_J, SHARE, TEMPERATURE_C = range(9)
RECORD_COLUMNS = 9


@dataclass(frozen=True)
class WayOut:
    """What truly happens on the way out, at each update of the companion, until the battery is cut
    off.

    Attributes:
        records: Shape (updates, 9), in the columns above. The energy is what the way out has taken
            so far.
        states: State of the pack at each update; of a circuit, shape (updates, 5).
    """

    records: Floats
    states: Floats | Sequence[Any]

    def column(self, index: int) -> Floats:
        """A column of the records, shape (updates,)."""
        values: Floats = self.records[:, index]
        return values

    @property
    def empty_s(self) -> float:
        """Time at which the battery was cut off, or the way ended."""
        return float(self.records[-1, TIME_S])


@dataclass(frozen=True)
class WayHome:
    """How the way home ended: whether at home, the energy that it took, J, and the share of charge
    left."""

    arrived: bool
    energy_j: float
    share: float


@numba.njit(cache=True)
def _out(
    pack: Pack,
    state: Floats,
    power_w: Floats,
    cross_s: Floats,
    stop_s: Floats,
    standby_w: float,
    length_m: float,
    update_s: float,
    trip_s: float,
    records: Floats,
    states: Floats,
) -> int:
    """Fill `records` and `states`; return how many there are."""
    time_s = 0.0
    energy_j = 0.0
    low_s = 0.0
    count = 0
    since_s = 0.0
    since_m = 0.0
    since_vs = 0.0
    since_as = 0.0
    since_j = 0.0
    for cell in range(power_w.size):
        stands = math.ceil(stop_s[cell] / STAND_STEP_S)
        for part in range(1 + stands):
            drives = part == 0
            step_s = cross_s[cell] if drives else STAND_STEP_S
            step_w = power_w[cell] if drives else standby_w
            voltage_v, current_a = step(pack, state, step_w, step_s)
            time_s += step_s
            energy_j += step_w * step_s
            since_s += step_s
            since_m += length_m if drives else 0.0
            since_vs += voltage_v * step_s
            since_as += current_a * step_s
            since_j += step_w * step_s
            low_s = low_s + step_s if is_down(pack, state, voltage_v) else 0.0
            if since_s >= update_s:
                records[count, TIME_S] = time_s
                records[count, CELL] = cell
                records[count, SPEED_MPS] = since_m / since_s
                records[count, VOLTAGE_V] = since_vs / since_s
                records[count, CURRENT_A] = since_as / since_s
                records[count, POWER_W] = since_j / since_s
                records[count, ENERGY_J] = energy_j
                records[count, SHARE] = total_share(state)
                records[count, TEMPERATURE_C] = state[4]
                states[count] = state
                count += 1
                since_s = 0.0
                since_m = 0.0
                since_vs = 0.0
                since_as = 0.0
                since_j = 0.0
            if low_s >= trip_s or count == records.shape[0]:
                return count
    return count


@numba.njit(cache=True)
def _home(
    pack: Pack,
    state: Floats,
    power_w: Floats,
    cross_s: Floats,
    start_cell: int,
    standby_w: float,
    turning_s: float,
    trip_s: float,
) -> tuple[bool, float]:
    """Turn round and drive home from the end of a cell, changing `state`; return whether it
    arrived, and its energy."""
    energy_j = standby_w * turning_s
    step(pack, state, standby_w, turning_s)
    low_s = 0.0
    for cell in range(start_cell, -1, -1):
        voltage_v, _current_a = step(pack, state, power_w[cell], cross_s[cell])
        energy_j += power_w[cell] * cross_s[cell]
        low_s = low_s + cross_s[cell] if is_down(pack, state, voltage_v) else 0.0
        if low_s >= trip_s:
            return False, energy_j
    return True, energy_j


def drive_out(
    pack: Pack, state: Floats, ground: Ground, update_s: float, truth: TruthSizes
) -> WayOut:
    """Drive out until the battery is cut off or the way ends.

    Args:
        pack: The true pack.
        state: Its state at the start, shape (5,); it stays as it is.
        ground: The way.
        update_s: Time between updates of the companion, s.
        truth: Sizes of the truth.
    """
    cross_s = ground.length_m / ground.out_mps
    longest_s = float(np.sum(cross_s) + np.sum(ground.stop_s) + STAND_STEP_S * ground.stop_s.size)
    most = int(longest_s / update_s) + 2
    records = np.zeros((most, RECORD_COLUMNS))
    states = np.zeros((most, STATE_COLUMNS))
    count = _out(
        pack,
        state.copy(),
        ground.out_w,
        cross_s,
        ground.stop_s,
        ground.standby_w,
        ground.length_m,
        update_s,
        truth.trip_s,
        records,
        states,
    )
    return WayOut(records[:count], states[:count])


def drive_home(pack: Pack, way: WayOut, turn: int, ground: Ground, truth: TruthSizes) -> WayHome:
    """Turn at the update with index `turn`, and drive home along the same way."""
    state = way.states[turn].copy()
    start_cell = int(way.records[turn, CELL])
    cross_s = ground.length_m / ground.home_mps
    arrived, energy_j = _home(
        pack,
        state,
        ground.home_w,
        cross_s,
        start_cell,
        ground.standby_w,
        truth.turning_s,
        truth.trip_s,
    )
    return WayHome(arrived, energy_j, max(float(total_share(state)), 0.0))
