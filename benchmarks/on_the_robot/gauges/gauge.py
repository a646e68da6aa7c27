"""What a battery gauge shows, given what the battery truly does."""

from __future__ import annotations

from typing import Literal, Protocol, get_args

import numpy as np
from numpy.random import Generator
from scipy.signal import lfilter

from benchmarks.on_the_robot.gauges.cell import Floats
from benchmarks.on_the_robot.gauges.sizes import GaugeSizes, Sizes, VoltageMap, between
from benchmarks.on_the_robot.gauges.way import CURRENT_A, TIME_S, VOLTAGE_V, WayOut

Gauge = Literal[
    "counter", "linear_voltage", "pieces_voltage", "coarse", "late", "reset", "stuck", "none"
]
GAUGES: tuple[Gauge, ...] = get_args(Gauge)


class Gauged(Protocol):
    """What a gauge knows of its battery, see `battery.Battery`."""

    @property
    def cells(self) -> int:
        """Cells in series."""

    @property
    def learned_ah(self) -> float:
        """Charge that it gives at 25 C before it is cut off, Ah."""


def shown_shares(
    gauge: Gauge,
    chemistry: str,
    pack: Gauged,
    start_share: float,
    way: WayOut,
    sizes: Sizes,
    rng: Generator,
) -> tuple[Floats, str]:
    """Share of charge that the gauge shows at each update, and what its fault was.

    Returns:
        Shares of 0 to 1, shape (updates,), NaN without a gauge; and the fault in words.
    """
    counted = _count(way, start_share, pack.learned_ah, sizes.gauge, rng)
    cell_v = way.column(VOLTAGE_V) / pack.cells
    # an update waits for the end of a cell, so they are further apart than asked
    update_s = way.empty_s / counted.size
    if gauge == "none":
        return np.full(counted.size, np.nan), ""
    if gauge == "linear_voltage":
        return _by_voltage(cell_v, sizes.linear_map[chemistry], update_s, sizes.gauge), ""
    if gauge == "pieces_voltage":
        return _by_voltage(cell_v, sizes.pieces_map[chemistry], update_s, sizes.gauge), ""
    if gauge == "coarse":
        coarse_step = float(rng.choice(sizes.gauge.coarse_steps))
        return _rounded(counted, coarse_step), f"steps of {coarse_step:.0%}"
    if gauge == "late":
        return _late(counted, update_s, sizes.gauge, rng)
    if gauge == "reset":
        return _reset(counted, cell_v, sizes.pieces_map[chemistry], way, sizes.gauge, rng)
    if gauge == "stuck":
        return _stuck(counted, way, sizes.gauge, rng)
    return _rounded(counted, sizes.gauge.counter_step), ""


def _count(
    way: WayOut, start_share: float, learned_ah: float, gauge: GaugeSizes, rng: Generator
) -> Floats:
    """A coulomb counter before rounding, shape (updates,): right at 25 C, but for a start, a gain
    and a drift."""
    lengths_s = np.diff(way.column(TIME_S), prepend=0.0)
    drawn_ah = np.cumsum(way.column(CURRENT_A) * lengths_s) / 3600.0
    start = start_share + rng.normal(0.0, gauge.counter_start_sd)
    gain = 1.0 + rng.normal(0.0, gauge.counter_gain_sd)
    drift_per_h = rng.normal(0.0, gauge.counter_offset_per_h)
    counted: Floats = (
        start - gain * drawn_ah / learned_ah - drift_per_h * way.column(TIME_S) / 3600.0
    )
    return counted


def _rounded(share: Floats, step: float) -> Floats:
    """Shares rounded to a step, within 0 and 1."""
    rounded: Floats = np.clip(np.round(share / step) * step, 0.0, 1.0)
    return rounded


def _by_voltage(
    cell_v: Floats, voltage_map: VoltageMap, update_s: float, gauge: GaugeSizes
) -> Floats:
    """Share by a map of the voltage under load, averaged as drivers do."""
    window = max(round(gauge.voltage_average_s / update_s), 1)
    padded_v = np.concatenate([np.full(window - 1, cell_v[0]), cell_v])
    mean_v = np.convolve(padded_v, np.full(window, 1.0 / window), mode="valid")
    return _rounded(np.interp(mean_v, voltage_map.v, voltage_map.share), gauge.voltage_step)


def _late(
    counted: Floats, update_s: float, gauge: GaugeSizes, rng: Generator
) -> tuple[Floats, str]:
    """A counter that lags, or that is read every few minutes."""
    if rng.random() < gauge.late_held_share:
        hold_s = between(rng.random(), gauge.late_hold_s)
        every = max(round(hold_s / update_s), 1)
        last_read = np.arange(counted.size) // every * every
        return _rounded(counted[last_read], gauge.counter_step), f"read every {hold_s:.0f} s"
    lag_s = between(rng.random(), gauge.late_lag_s)
    share_kept = np.exp(-update_s / lag_s)
    lagged = counted[0] + lfilter([1.0 - share_kept], [1.0, -share_kept], counted - counted[0])
    return _rounded(lagged, gauge.counter_step), f"lags {lag_s:.0f} s"


def _reset(
    counted: Floats,
    cell_v: Floats,
    rest_map: VoltageMap,
    way: WayOut,
    gauge: GaugeSizes,
    rng: Generator,
) -> tuple[Floats, str]:
    """A counter that is set anew on the way, to full, by a map of the voltage, or by some percent,
    and counts on."""
    moment_s = between(rng.random(), gauge.reset_when) * way.empty_s
    reset = int(np.searchsorted(way.column(TIME_S), moment_s))
    kind = rng.random()
    if kind < gauge.reset_full_share:
        jump = 1.0 - counted[reset]
        words = "set to 100%"
    elif kind < gauge.reset_full_share + gauge.reset_rest_map_share:
        jump = float(np.interp(cell_v[reset], rest_map.v, rest_map.share)) - counted[reset]
        words = f"set by the voltage, {jump:+.0%}"
    else:
        jump = float(rng.choice(gauge.reset_jumps))
        words = f"set {jump:+.0%}"
    jumped = np.where(np.arange(counted.size) >= reset, counted + jump, counted)
    return _rounded(jumped, gauge.counter_step), words


def _stuck(counted: Floats, way: WayOut, gauge: GaugeSizes, rng: Generator) -> tuple[Floats, str]:
    """A counter that stays where it is, for minutes or for ever."""
    times_s = way.column(TIME_S)
    from_s = between(rng.random(), gauge.stuck_when) * way.empty_s
    stuck_s = between(rng.random(), gauge.stuck_s)
    words = f"stuck for {stuck_s:.0f} s"
    if rng.random() < gauge.stuck_for_ever_share:
        stuck_s = np.inf
        words = "stuck for ever"
    first = int(np.searchsorted(times_s, from_s))
    held = (times_s >= from_s) & (times_s < from_s + stuck_s)
    shown = np.where(held, counted[first], counted)
    return _rounded(shown, gauge.counter_step), words
