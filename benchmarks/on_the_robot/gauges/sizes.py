"""Sizes of all faults, noises and spreads, read from `gauge_faults.toml`, where each has its source
or reason."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FILE = Path(__file__).with_name("gauge_faults.toml")


@dataclass(frozen=True)
class TruthSizes:
    """By how much the true robot, weather and pack differ from the robot file: section
    `[truth]`."""

    rolling_factor: list[float]
    capacity_share: list[float]
    label_hours: float
    payload_share: list[float]
    drag_factor: list[float]
    standby_factor: list[float]
    standby_wander: float
    standby_wander_s: float
    gear_loss_factor: list[float]
    resistance_factor: list[float]
    temperature_c: list[float]
    wind_mps: list[float]
    gust_share: float
    gust_s: float
    start_share: list[float]
    pack_shares: list[float]
    cutoff_known_share: float
    trip_s: float
    turning_s: float
    speed_wander: float
    uphill_slowdown: float


@dataclass(frozen=True)
class GroundSizes:
    """Patches, hills, bends and stops: section `[ground]`."""

    patch_sd: float
    patch_s: float
    waves: int
    wave_s: list[float]
    bend_rad: float
    stops_per_hour: float
    stop_s: list[float]


@dataclass(frozen=True)
class RobotSizes:
    """A robot: its preset, its pace, its slopes and its cells in series: section
    `[robots.NAME]`."""

    preset: str
    cruise_mps: list[float]
    grade_sd_rad: list[float]
    cells: dict[str, int]


@dataclass(frozen=True)
class CellSizes:
    """A chemistry, per cell at 25 C: section `[cells.NAME]`."""

    curve: str
    curve_v: list[float]
    label_v: float
    cutoff_v: float
    ohm_sag_v: float
    slow_sag_v: float
    diffusion_sag_v: float
    activation_k: list[float]
    cold_loss_per_k: float
    heat_j_per_k_wh: float
    well_share: float
    well_per_h: float


@dataclass(frozen=True)
class CircuitSizes:
    """What all chemistries share: section `[circuit]`."""

    slow_s: float
    diffusion_s: float
    knee_c: float
    low_charge_rise: float
    low_charge_share: float
    cooling_s: float


@dataclass(frozen=True)
class GaugeSizes:
    """Errors and faults of gauges: section `[gauge]`."""

    counter_step: float
    counter_start_sd: float
    counter_gain_sd: float
    counter_offset_per_h: float
    voltage_step: float
    voltage_average_s: float
    coarse_steps: list[float]
    late_lag_s: list[float]
    late_hold_s: list[float]
    late_held_share: float
    reset_when: list[float]
    reset_jumps: list[float]
    reset_full_share: float
    reset_rest_map_share: float
    stuck_when: list[float]
    stuck_s: list[float]
    stuck_for_ever_share: float


@dataclass(frozen=True)
class InstrumentSizes:
    """Errors of the other instruments: section `[instruments]`."""

    voltage_gain_sd: float
    voltage_noise_share: float
    current_gain_sd: float
    current_offset_share_sd: float
    current_noise_share: float
    speed_gain_sd: float
    speed_noise_share: float
    position_noises_m: list[float]
    grade_offset_sd_deg: float
    grade_noise_deg: float
    heading_offset_sd_deg: float
    heading_noise_deg: float
    temperature_offset_sd_c: float
    dropouts_per_h: float
    single_dropouts_per_h: float
    dropout_s: list[float]
    clock_step_share: float
    clock_step_s: float
    clock_when: list[float]
    without_current_with_voltage_share: float


@dataclass(frozen=True)
class CurveSizes:
    """How the user measured the curve that the robot file states: section `[curve]`."""

    measured_points: int
    measured_sd_v: float


@dataclass(frozen=True)
class CompanionSizes:
    """How often the companion reads: section `[companion]`."""

    updates_per_battery: int
    update_s: list[float]


@dataclass(frozen=True)
class RuleSizes:
    """Rules beside the companion: section `[rules]`."""

    turn_share: float
    reserve_factor: float
    mirror_sd_share: float
    mirror_sd_floor_share: float
    paired_share: float


@dataclass(frozen=True)
class VoltageMap:
    """Share of charge that a gauge shows for a voltage per cell, straight between its points."""

    v: list[float]
    share: list[float]


@dataclass(frozen=True)
class Sizes:
    """All sections of the file."""

    truth: TruthSizes
    ground: GroundSizes
    robots: dict[str, RobotSizes]
    cells: dict[str, CellSizes]
    circuit: CircuitSizes
    gauge: GaugeSizes
    linear_map: dict[str, VoltageMap]
    pieces_map: dict[str, VoltageMap]
    instruments: InstrumentSizes
    curve: CurveSizes
    companion: CompanionSizes
    rules: RuleSizes


def read_sizes(path: Path = FILE) -> Sizes:
    """Read the file; an unknown or missing name raises a TypeError or KeyError.

    >>> read_sizes().gauge.counter_step
    0.01
    """
    sections: dict[str, Any] = tomllib.loads(path.read_text())
    return Sizes(
        truth=TruthSizes(**sections["truth"]),
        ground=GroundSizes(**sections["ground"]),
        robots={name: RobotSizes(**values) for name, values in sections["robots"].items()},
        cells={name: CellSizes(**values) for name, values in sections["cells"].items()},
        circuit=CircuitSizes(**sections["circuit"]),
        gauge=GaugeSizes(**sections["gauge"]),
        linear_map={
            name: VoltageMap(ends, [0.0, 1.0]) for name, ends in sections["linear_map"].items()
        },
        pieces_map={name: VoltageMap(**values) for name, values in sections["pieces_map"].items()},
        instruments=InstrumentSizes(**sections["instruments"]),
        curve=CurveSizes(**sections["curve"]),
        companion=CompanionSizes(**sections["companion"]),
        rules=RuleSizes(**sections["rules"]),
    )


def between(rng_value: float, ends: list[float]) -> float:
    """Value at a share of 0 to 1 of a range.

    >>> between(0.5, [2.0, 4.0])
    3.0
    """
    low, high = ends
    return low + rng_value * (high - low)
