"""Readings of a robot: state of charge, power, speed and grade, with the errors of instruments."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from homeward.envs.conditions import gauges
from homeward.envs.conditions.draws import GRADE, POWER, SOC, SPEED, normal
from homeward.envs.conditions.gauges import COUNTER, GAUGES
from homeward.files import read_toml
from homeward.physics import battery
from homeward.physics import thresholds as physics_thresholds
from homeward.physics.intervals import Bounds
from homeward.physics.jit import inline
from homeward.physics.kernel import CHARGER


class InstrumentError(ValueError):
    """Invalid instruments; the message says what is allowed."""


@dataclass(frozen=True)
class Instruments:
    """Sizes of the errors of a robot's instruments; 0 throughout is exact. Its position is known
    exactly.

    Each mission draws a gain and an offset of the power meter, uniformly within the given limits,
    and keeps them. Noise is normal with the given standard deviation, and independent for each
    reading. That of the grade belongs to the place, because the pitch is averaged over the way
    through it.

    Attributes:
        soc_step: Step in which the state of charge is shown, as a share of a full battery.
        soc_noise: Noise of the state of charge before it is rounded, as a share of a full battery.
        soc_lag_s: Time constant with which the state of charge follows the battery, s.
        power_gain: Largest gain error of the power meter, as a share of the power.
        power_offset: Largest offset of the power meter, as a share of the robot's power at top
            speed, sensing fastest.
        power_noise: Noise of a reading of the power, as a share of the power.
        speed_noise: Noise of a reading of the speed, as a share of the speed.
        grade_noise: Noise of the sine of a place's grade.
        gauges: Gauges of the state of charge (`homeward.envs.conditions.gauges`), of which each
            mission has one, all equally likely. A robot of constant voltage has none that maps the
            voltage.

    Raises:
        InstrumentError: A size is not within its bounds, or a gauge is unknown.
    """

    soc_step: float = 0.0
    soc_noise: float = 0.0
    soc_lag_s: float = 0.0
    power_gain: float = 0.0
    power_offset: float = 0.0
    power_noise: float = 0.0
    speed_noise: float = 0.0
    grade_noise: float = 0.0
    gauges: tuple[str, ...] = (COUNTER,)

    def __post_init__(self) -> None:
        object.__setattr__(self, "gauges", _checked_gauges(self.gauges))
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name == "gauges":
                continue
            bounds = Bounds(
                0.0,
                physics_thresholds.MOST_LAG_S
                if field.name == "soc_lag_s"
                else physics_thresholds.MOST_ERROR,
            )
            if (
                isinstance(value, bool)
                or not isinstance(value, int | float)
                or not bounds.hold(value)
            ):
                raise InstrumentError(
                    f"{field.name} = {value!r} is not allowed; give a number in {bounds}"
                )

    @property
    def soc_variance(self) -> float:
        """Variance of a reading of the state of charge: its noise, and a twelfth of the square of a
        step."""
        return self.soc_noise**2 + self.soc_step**2 / 12.0


def _checked_gauges(names: Any) -> tuple[str, ...]:
    """Names of gauges, in the order of their table."""
    are_names = (
        isinstance(names, list | tuple)
        and bool(names)
        and all(isinstance(name, str) for name in names)
    )
    if not are_names or not set(names) <= set(GAUGES):
        raise InstrumentError(
            f"gauges = {names!r} is not allowed; give a list of {', '.join(GAUGES)}"
        )
    return tuple(name for name in GAUGES if name in names)


INSTRUMENTS: dict[str, Instruments] = {
    # Exact, as in a simulator.
    "exact": Instruments(),
    # A battery monitor with a shunt: state of charge in steps of 0.1 % and a current within 0.4 %
    # (Victron BMV-700 manual, technical data), by a shunt of class 0.5 (IEC 60051-8): 1 % together.
    # Wheel speed and a pitch of 0.2 degrees (Xsens MTi-300 data sheet: 0.2 to 0.3 degrees RMS),
    # averaged over the ten and more seconds of a place. Chosen: noise of power and speed, half of
    # the gain error, as means over a decision have little.
    "meter": Instruments(
        soc_step=1e-3, power_gain=0.01, power_noise=0.005, speed_noise=0.005, grade_noise=0.001
    ),
    # The management system of a battery pack: relative state of charge in whole per cent, filtered
    # (Smart Battery Data Specification 1.1, RelativeStateOfCharge), and a current within 3 % and
    # 0.5 % of the range, as sensors without calibration have it (Allegro ACS712 data sheet: 1.5 %
    # at 25 C, with temperature 3 % and more). Chosen: noise and lag of the state of charge (a third
    # of a step, and a decision), noise of power and speed (twice those of the meter) and of the
    # grade (three times, for a low-cost IMU).
    "gauge": Instruments(
        soc_step=1e-2, soc_noise=3e-3, soc_lag_s=30.0, power_gain=0.03, power_offset=0.005, power_noise=0.01,
        speed_noise=0.01, grade_noise=0.003,
    ),
}  # fmt: skip
INSTRUMENTS["any_gauge"] = dataclasses.replace(INSTRUMENTS["gauge"], gauges=tuple(GAUGES))
"""Instruments by name. The last are those of `gauge`, with any of the gauges that robots have."""


def load_instruments(instruments: str | Path | Instruments) -> Instruments:
    """Instruments by name, or from a TOML file with their sizes; `Instruments` are returned as they
    are.

    Raises:
        InstrumentError: The name is unknown, or the file is invalid.

    >>> load_instruments("meter").soc_step
    0.001
    """
    if isinstance(instruments, Instruments):
        return instruments
    if isinstance(instruments, str) and instruments in INSTRUMENTS:
        return INSTRUMENTS[instruments]
    if not isinstance(instruments, str | Path) or Path(instruments).suffix != ".toml":
        shown = str(instruments) if isinstance(instruments, Path) else instruments
        raise InstrumentError(
            f"instruments = {shown!r}; choose {', '.join(INSTRUMENTS)} or name a TOML file"
        )
    path = Path(instruments)
    try:
        sizes = read_toml(path)
    except (OSError, ValueError) as error:  # not TOML, not UTF-8, or a name that no file can have
        raise InstrumentError(f"{path}: {error}") from None
    allowed = [field.name for field in dataclasses.fields(Instruments)]
    for name in sizes:
        if name not in allowed:
            raise InstrumentError(f"{path}: unknown size {name!r}; allowed: {', '.join(allowed)}")
    try:
        return Instruments(**sizes)
    except InstrumentError as error:
        raise InstrumentError(f"{path}: {error}") from None


@inline
def begin(mission: Any, shared: Any, gain: float, offset: float) -> None:
    """Reset the readings: no energy is metered yet, and the state of charge is 1.

    Args:
        mission: Mission record.
        shared: Shared record.
        gain: Position of the meter's gain in its range, from 0 to 1.
        offset: The same of its offset.
    """
    mission.meter_gain = 1.0 + shared.power_gain * (2.0 * gain - 1.0)
    mission.meter_offset_w = shared.power_offset_w * (2.0 * offset - 1.0)
    mission.soc = mission.soc_followed = mission.soc_lowest = mission.metered = 1.0
    mission.metered_j = mission.metered_followed = mission.read_w = mission.read_mps = 0.0
    mission.sum_used_metered = mission.sum_metered_squared = 0.0
    mission.supplied_j = mission.charged = 0.0
    gauges.choose(mission, shared)


@inline
def read(mission: Any, shared: Any, used_j: float) -> None:
    """Read the instruments after a decision that consumed a given energy."""
    soc = mission.energy_j / mission.capacity_j
    power_w = used_j * shared.per_decision
    if not shared.inexact:
        mission.soc = soc
        mission.read_w = power_w
        mission.read_mps = mission.speed_mps
        meter(mission, shared)
        return
    mission.read_mps = mission.speed_mps * (
        1.0 + shared.speed_noise * normal(mission.key, mission.decisions, SPEED)
    )
    noise = shared.power_noise * normal(mission.key, mission.decisions, POWER)
    mission.read_w = power_w * (mission.meter_gain + noise) + mission.meter_offset_w
    # A gauge shows a share of charge, and lags by a first order behind one that falls evenly over
    # the decision.
    share_before = (mission.energy_j + used_j) / mission.capacity_j
    if shared.curved:
        soc = battery.charge_share(shared.curve, soc)
        share_before = battery.charge_share(shared.curve, share_before)
    gauge = shared.gauges[mission.gauge]
    lag_share = (share_before - soc) * gauge.lag_decisions
    mission.soc_followed = (
        soc + lag_share + (mission.soc_followed - share_before - lag_share) * gauge.keeps
    )
    shown = mission.soc_followed
    if gauge.maps or gauge.resets:
        shown = gauges.shown_by(mission, shared, shown, soc, power_w)
    if shared.soc_noise > 0.0:
        shown += shared.soc_noise * normal(mission.key, mission.decisions, SOC)
    if gauge.step > 0.0:
        shown = gauge.step * np.floor(shown * gauge.per_step + 0.5)
    mission.soc = in_energy(shared, min(max(shown, 0.0), 1.0))
    meter(mission, shared)


@inline
def in_energy(shared: Any, soc: Any) -> Any:
    """Share of the usable energy that a state of charge is, by the robot's file."""
    if shared.curved:
        return battery.energy_share(shared.curve, soc)
    return soc


@inline
def meter(mission: Any, shared: Any) -> None:
    """Estimate the state of charge by the power meter, from its readings and those of the state of
    charge.

    This estimate also changes between the steps of the state-of-charge reading. It is the metered
    energy over the metered energy of a full battery. Regularised least squares estimate the latter
    from all state-of-charge readings, with the robot's file as the prior. Each is compared with the
    metered energy at the same lag. A gauge that has risen (`gauges.RISE`) counts no more.
    """
    mission.metered_j += mission.read_w * shared.decision_s
    charged_j = -mission.ledger_j[CHARGER] - mission.supplied_j
    mission.supplied_j = -mission.ledger_j[CHARGER]
    if not shared.inexact:
        mission.metered = mission.soc
        mission.charged += charged_j / mission.capacity_j
        return
    metered = mission.metered_j * shared.per_usable_j
    step = mission.read_w * shared.decision_s * shared.per_usable_j
    lag = step * shared.soc_lag_decisions
    mission.metered_followed = (
        metered - lag + (mission.metered_followed - metered + step + lag) * shared.soc_keeps
    )
    mission.soc_lowest = gauges.lowest_believed(mission.soc_lowest, mission.soc)
    if mission.soc_lowest != gauges.LOST:
        mission.sum_used_metered += (1.0 - mission.soc) * mission.metered_followed
        mission.sum_metered_squared += mission.metered_followed * mission.metered_followed
    per_metered = shared.soc_prior * shared.soc_per_metered + mission.sum_used_metered
    per_metered /= shared.soc_prior + mission.sum_metered_squared
    mission.metered = min(max(1.0 - metered * per_metered, 0.0), 1.0)
    mission.charged += charged_j * shared.per_usable_j * per_metered


@inline
def sine_read(key: Any, place: int, sin_grade: float, shared: Any) -> Any:
    """Sine of a place's grade as read by the robot."""
    if shared.grade_noise > 0.0:
        return min(
            max(sin_grade + shared.grade_noise * normal(key, place, GRADE), -STEEPEST_READ),
            STEEPEST_READ,
        )
    return sin_grade


STEEPEST_READ = 0.8
"""Largest sine that can be read. Chosen: above that of the steepest slope of a route (0.7), with
room for noise."""
