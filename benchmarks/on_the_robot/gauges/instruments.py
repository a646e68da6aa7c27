"""What the robot's instruments read, given what truly happens: gains, offsets, noise, dropouts, a
clock that steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from benchmarks.on_the_robot.gauges.cell import Floats
from benchmarks.on_the_robot.gauges.ground import Ground
from benchmarks.on_the_robot.gauges.sizes import InstrumentSizes, between
from benchmarks.on_the_robot.gauges.way import (
    CELL,
    CURRENT_A,
    SPEED_MPS,
    TEMPERATURE_C,
    TIME_S,
    VOLTAGE_V,
    WayOut,
)

Recorded = Literal["voltage and current", "voltage", "neither"]
SINGLE = ("voltage", "current", "speed", "position", "grade", "heading", "soc", "temperature")


@dataclass(frozen=True)
class Readings:
    """Readings at each update, shape (updates,); NaN where there is none.

    Attributes:
        time_s: What the robot's clock says, s.
        there: Whether any reading came through.
        position_m: East and north, m, shape (updates, 2).
    """

    time_s: Floats
    there: NDArray[np.bool_]
    soc: Floats
    voltage_v: Floats
    current_a: Floats
    speed_mps: Floats
    position_m: Floats
    grade_rad: Floats
    heading_rad: Floats
    temperature_c: Floats


@dataclass(frozen=True)
class Conditions:
    """What is drawn for the instruments of a drive.

    Attributes:
        recorded: Which electrical quantities the robot records.
        position_noise_m: Standard deviation of white noise on east and on north, m.
        clock_step_s: By how much the clock steps, s; 0: not.
        clock_when: When it steps, share of the time to empty.
    """

    recorded: Recorded
    position_noise_m: float
    clock_step_s: float
    clock_when: float


def draw_conditions(with_current: bool, instruments: InstrumentSizes, rng: Generator) -> Conditions:
    """Draw what the robot records, the noise of its positions, and whether its clock steps."""
    has_voltage = rng.random() < instruments.without_current_with_voltage_share
    without_current: Recorded = "voltage" if has_voltage else "neither"
    steps = rng.random() < instruments.clock_step_share
    sign = rng.choice([-1.0, 1.0])
    return Conditions(
        recorded="voltage and current" if with_current else without_current,
        position_noise_m=float(rng.choice(instruments.position_noises_m)),
        clock_step_s=float(sign * instruments.clock_step_s) if steps else 0.0,
        clock_when=between(rng.random(), instruments.clock_when),
    )


def read(
    way: WayOut,
    ground: Ground,
    shown: Floats,
    conditions: Conditions,
    instruments: InstrumentSizes,
    rng: Generator,
) -> Readings:
    """Read all instruments along the way out.

    The draws do not depend on `conditions`, so the same generator gives the same errors under other
    conditions.
    """
    updates = shown.size
    cells = way.column(CELL).astype(np.int64)

    def noise(sd: float) -> Floats:
        return rng.normal(0.0, sd, updates)

    voltage_v = way.column(VOLTAGE_V) * (1.0 + rng.normal(0.0, instruments.voltage_gain_sd))
    voltage_v = voltage_v * (1.0 + noise(instruments.voltage_noise_share))
    mean_current_a = float(way.column(CURRENT_A).mean())
    current_a = way.column(CURRENT_A) * (1.0 + rng.normal(0.0, instruments.current_gain_sd))
    current_a = current_a + rng.normal(0.0, instruments.current_offset_share_sd) * mean_current_a
    current_a = current_a + noise(instruments.current_noise_share) * mean_current_a
    speed_mps = way.column(SPEED_MPS) * (1.0 + rng.normal(0.0, instruments.speed_gain_sd))
    speed_mps = speed_mps * (1.0 + noise(instruments.speed_noise_share))
    white = rng.normal(0.0, 1.0, (updates, 2))
    position_m = (
        np.column_stack([ground.east_m[cells], ground.north_m[cells]])
        + conditions.position_noise_m * white
    )
    grade_offset_rad = np.radians(rng.normal(0.0, instruments.grade_offset_sd_deg))
    grade_rad = (
        ground.grade_rad[cells] + grade_offset_rad + noise(np.radians(instruments.grade_noise_deg))
    )
    heading_offset_rad = np.radians(rng.normal(0.0, instruments.heading_offset_sd_deg))
    heading_rad = (
        ground.heading_rad[cells]
        + heading_offset_rad
        + noise(np.radians(instruments.heading_noise_deg))
    )
    temperature_c = way.column(TEMPERATURE_C) + rng.normal(0.0, instruments.temperature_offset_sd_c)
    soc = shown.copy()

    times_s = way.column(TIME_S)
    values = {
        "voltage": voltage_v,
        "current": current_a,
        "speed": speed_mps,
        "position": position_m,
        "grade": grade_rad,
        "heading": heading_rad,
        "soc": soc,
        "temperature": temperature_c,
    }
    for name, start_s, end_s in _single_dropouts(times_s[-1], instruments, rng):
        values[name][(times_s >= start_s) & (times_s < end_s)] = np.nan
    there = np.ones(updates, dtype=np.bool_)
    for start_s, end_s in _dropouts(times_s[-1], instruments.dropouts_per_h, instruments, rng):
        there[(times_s >= start_s) & (times_s < end_s)] = False
    there[0] = True  # the robot starts with all that it has

    if conditions.recorded != "voltage and current":
        current_a[:] = np.nan
    if conditions.recorded == "neither":
        voltage_v[:] = np.nan
    stepped = times_s >= conditions.clock_when * way.empty_s
    return Readings(
        time_s=times_s + conditions.clock_step_s * stepped,
        there=there,
        soc=soc,
        voltage_v=voltage_v,
        current_a=current_a,
        speed_mps=speed_mps,
        position_m=position_m,
        grade_rad=grade_rad,
        heading_rad=heading_rad,
        temperature_c=temperature_c,
    )


def _dropouts(
    seconds: float, per_hour: float, instruments: InstrumentSizes, rng: Generator
) -> list[tuple[float, float]]:
    """Start and end, s, of dropouts at random times."""
    count = int(rng.poisson(per_hour * seconds / 3600.0))
    starts_s = rng.uniform(0.0, seconds, count)
    low_s, high_s = np.log(instruments.dropout_s)
    lengths_s = np.exp(rng.uniform(low_s, high_s, count))
    ends_s = starts_s + lengths_s
    return list(zip(starts_s.tolist(), ends_s.tolist(), strict=True))


def _single_dropouts(
    seconds: float, instruments: InstrumentSizes, rng: Generator
) -> list[tuple[str, float, float]]:
    """Instrument, start and end, s, of dropouts of an instrument at a time."""
    spans_s = _dropouts(seconds, instruments.single_dropouts_per_h, instruments, rng)
    names = rng.choice(SINGLE, len(spans_s)).tolist()
    return [(name, start_s, end_s) for name, (start_s, end_s) in zip(names, spans_s, strict=True)]
