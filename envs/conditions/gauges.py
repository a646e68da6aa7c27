"""Gauges: what robots show as their state of charge, one entry each, of which a mission has one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.conditions.draws import GAUGE, RESET, uniform
from homeward.physics import Robot, battery
from homeward.physics.jit import inline

Points = tuple[tuple[float, float], ...]
"""Points of a map: (V of a cell, share that is shown)."""

MOST_POINTS = 12
"""Most points of a map. Chosen: those of vendors have up to 11."""

_LINEAR: Mapping[str, Points] = {
    # Husarion Panther, battery_publisher: 32.0 to 41.4 V of 10 cells
    "nmc": ((3.2, 0.0), (4.14, 1.0)),
    "lipo": ((3.5, 0.0), (4.2, 1.0)),  # AryanRai/WarehouseTurtlebot: 10.5 to 12.6 V of 3 cells
    "lfp": ((2.8, 0.0), (3.4, 1.0)),  # chosen: cut-off, and rest after charging
    # UbiquityRobotics/ubiquity_motor: (V - 20) / 8 of 12 cells
    "lead_acid": ((1.667, 0.0), (2.333, 1.0)),
}
_PIECES: Mapping[str, Points] = {
    # UbiquityRobotics/ubiquity_motor, LI_ION.
    "nmc": (
        (3.3, 0.0), (3.49, 0.1), (3.53, 0.2), (3.55, 0.3), (3.6, 0.4), (3.64, 0.5), (3.7, 0.6), (3.8, 0.7), (3.85, 0.8),
        (4.05, 0.9), (4.2, 1.0),
    ),
    # A flight controller's driver, "piecewise function based on gathered data", joined up.
    "lipo": ((3.5, 0.0), (3.7, 0.05), (3.85, 0.5), (4.2, 1.0)),
    # Chosen: after the charts that vendors print, at rest.
    "lfp": ((2.5, 0.0), (3.0, 0.1), (3.2, 0.2), (3.25, 0.4), (3.3, 0.7), (3.35, 0.9), (3.4, 1.0)),
    # UbiquityRobotics/ubiquity_motor, SLA_AGM.
    "lead_acid": (
        (1.8, 0.0), (1.837, 0.1), (1.875, 0.2), (1.912, 0.3), (1.95, 0.4), (2.01, 0.5), (2.025, 0.6), (2.062, 0.7),
        (2.1, 0.8), (2.137, 0.9), (2.175, 1.0),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Gauge:
    """One gauge: how it departs from a counter of charge with the sizes of its instruments.

    Attributes:
        meaning: What it shows.
        source: Where its sizes come from.
        step: Step in which it shows the state of charge, a share; 0: that of the instruments.
        lag_s: Time constant with which it follows the battery, s; 0: that of the instruments.
        map: Map of the voltage under load by chemistry, empty: it counts charge.
        reset_left: Share of charge at which it is set anew, uniform within these limits; (0, 0):
            never. It is set to full, or by its map, and counts on.
    """

    meaning: str
    source: str
    step: float = 0.0
    lag_s: float = 0.0
    map: Mapping[str, Points] = field(default_factory=dict)
    reset_left: tuple[float, float] = (0.0, 0.0)


_RESET_LEFT = (0.55, 0.95)
"""Charge left at a reset. Chosen: before most robots turn back."""

GAUGES: dict[str, Gauge] = {
    "counter": Gauge(
        "counts charge, with steps, noise and lag of the instruments", "see the instruments"
    ),
    "linear_voltage": Gauge(
        "maps the voltage under load by a straight line from empty to full, in steps of 1 %",
        "Husarion Panther, WarehouseTurtlebot, ubiquity_motor; of LFP chosen",
        step=0.01,
        map=_LINEAR,
    ),
    "pieces_voltage": Gauge(
        "maps the voltage under load by up to ten straight pieces, in steps of 1 %",
        "ubiquity_motor, a flight controller's driver; of LFP chosen",
        step=0.01,
        map=_PIECES,
    ),
    "coarse": Gauge(
        "counts charge and shows it in steps of 5 %",
        "chosen: displays with few bars have up to 25 %",
        step=0.05,
    ),
    "late": Gauge(
        "counts charge and shows it late, by a first-order lag of 3 minutes",
        "drivers that update every 1 to 5 minutes: Husqvarna's ROS driver, Victron's time to go",
        lag_s=180.0,
    ),
    "reset_full": Gauge(
        "counts charge, is set to full once with 55 to 95 % left, and counts on",
        "ArduPilot 1434, LuaTelemetry 130, diyBMS 117: 100 % after a restart, whatever the battery holds",
        reset_left=_RESET_LEFT,
    ),
    "reset_voltage": Gauge(
        "counts charge, is set by a map of the voltage in pieces once with 55 to 95 % left, and counts on",
        "davega 13: set from the voltage after a restart; maps as `pieces_voltage`",
        map=_PIECES,
        reset_left=_RESET_LEFT,
    ),
}
"""Gauges by name."""

COUNTER = "counter"

RISE = 0.07
"""Rise of a state of charge beyond its lowest, as a share, after which robots believe their gauge
no more: a battery that drives does not fill. Chosen: above a bar of 5 % and noise, so that no gauge
without a reset does it."""
LOST = -1.0
"""Lowest reading of a gauge that is believed no more."""

GAUGE_DTYPE = np.dtype(
    [
        ("maps", np.bool_),
        ("resets", np.bool_),
        ("step", np.float64),
        ("per_step", np.float64),
        ("lag_decisions", np.float64),
        ("keeps", np.float64),  # share of a difference that is left after a decision
        ("reset_low", np.float64),
        ("reset_span", np.float64),
        ("map_v", np.float64, (MOST_POINTS,)),  # of the pack
        ("map_share", np.float64, (MOST_POINTS,)),
    ],
    align=True,
)
"""A gauge as a record."""


def resistance_ohm(robot: Robot) -> float:
    """Internal resistance of the battery by the robot's file, 0 without the effect."""
    return float(robot.effects.get("internal_resistance", {}).get("ohm", 0.0))


def suits(gauge: Gauge, robot: Robot) -> bool:
    """Whether a robot can have a gauge: a map of the voltage needs one that changes with the
    charge."""
    return not gauge.map or robot.curve.mean_v > 0.0


def pack_map(gauge: Gauge, robot: Robot) -> Points:
    """Map of a gauge for a robot: (V of the pack, share).

    For a curve of the robot's own it is that curve at rest, in as many points as the gauge's first
    map has.
    """
    if robot.chemistry == battery.FLAT:
        points = len(next(iter(gauge.map.values())))
        shares = np.linspace(0.0, 1.0, points)
        volts = battery.open_circuit_v(robot.curve, shares)
        return tuple(zip(volts.tolist(), shares.tolist(), strict=True))
    return tuple(
        (robot.cells_in_series * volts, share) for volts, share in gauge.map[robot.chemistry]
    )


def write_gauge(
    gauge: Gauge, robot: Robot, step: float, lag_s: float, decision_s: float, record: Any
) -> None:
    """Write a gauge's record.

    Args:
        gauge: The gauge.
        robot: The robot of the file.
        step: Step of the instruments, which holds unless the gauge has its own.
        lag_s: The same of the lag, s.
        decision_s: Time between decisions, s.
        record: `GAUGE_DTYPE`, written.
    """
    lag_s = gauge.lag_s or lag_s
    record["step"] = gauge.step or step
    record["per_step"] = 0.0
    if record["step"]:
        record["per_step"] = 1.0 / record["step"]
    record["lag_decisions"] = lag_s / decision_s
    record["keeps"] = 0.0
    if lag_s:
        record["keeps"] = np.exp(-decision_s / lag_s)
    low, high = gauge.reset_left
    record["reset_low"] = low
    record["reset_span"] = high - low
    record["resets"] = high > 0.0
    record["maps"] = bool(gauge.map)
    if gauge.map:
        volts, shares = np.transpose(pack_map(gauge, robot))
        # Unused points follow the last one: a volt apart, with its share.
        unused = MOST_POINTS - len(volts)
        rising_v = np.pad(np.arange(unused) + 1.0, (len(volts), 0))
        record["map_v"] = np.pad(volts, (0, unused), mode="edge") + rising_v
        record["map_share"] = np.pad(shares, (0, unused), mode="edge")


def rms_error(gauge: Gauge, robot: Robot, lasts_s: float, most_reset: float = np.inf) -> float:
    """Root mean square of what a gauge shows beyond what a counter shows, over an even discharge, a
    share.

    Args:
        gauge: The gauge.
        robot: The robot of the file.
        lasts_s: Time of a full discharge, s.
        most_reset: Rise at a reset beyond which it is noticed, and the error counts no more.
    """
    charge = np.linspace(0.0, 1.0, 201)
    target = np.ones_like(charge)
    if gauge.map:
        volts, shares = np.transpose(pack_map(gauge, robot))
        rest_v = battery.open_circuit_v(robot.curve, charge)
        sag_v = resistance_ohm(robot) * robot.usable_energy_j / lasts_s / rest_v
        target = np.interp(rest_v - sag_v, volts, shares)
    low, high = gauge.reset_left
    counts = (target - charge <= most_reset) | (high == 0.0)
    squares: NDArray[np.float64] = np.where(counts, np.square(target - charge), 0.0)
    if high > 0.0:  # the error at the reset lasts for the charge that was left
        at_reset = np.linspace(low, high, 201)
        mean_square = float(np.mean(at_reset * np.interp(at_reset, charge, squares)))
    elif gauge.map:
        mean_square = float(squares.mean())
    else:
        mean_square = 0.0
    return float(np.sqrt(mean_square + gauge.step**2 / 12.0 + (gauge.lag_s / lasts_s) ** 2))


@inline
def lowest_believed(lowest: Any, soc: Any) -> Any:
    """Lowest reading of a gauge so far, or `LOST` once it has risen.

    >>> [float(lowest_believed(*readings)) for readings in ((0.6, 0.65), (0.6, 0.5), (0.6, 0.68), (LOST, 0.4))]
    [0.6, 0.5, -1.0, -1.0]
    """
    lowest = np.minimum(lowest, soc)
    risen = soc > lowest + RISE
    return risen * LOST + (1.0 - risen) * lowest


@inline
def expect_rise(mission: Any) -> None:
    """Let a robot at a charger believe a gauge that rises."""
    if mission.soc_lowest != LOST:
        mission.soc_lowest = 1.0


@inline
def choose(mission: Any, shared: Any) -> None:
    """Draw the gauge of a mission, and when it is set anew, by the mission's key."""
    mission.gauge = np.int64(uniform(mission.key, 0, GAUGE) * shared.gauge_count)
    gauge = shared.gauges[mission.gauge]
    mission.gauge_reset_left = gauge.reset_low + gauge.reset_span * uniform(mission.key, 0, RESET)
    mission.gauge_shift = 0.0


@inline
def shown_by(mission: Any, shared: Any, counted: float, charge: float, power_w: float) -> Any:
    """State of charge that a gauge shows beyond steps, noise and lag.

    Args:
        mission: Mission record.
        shared: Shared record.
        counted: What a counter shows.
        charge: True share of charge.
        power_w: Power out of the battery.
    """
    gauge = shared.gauges[mission.gauge]
    if gauge.resets and charge >= mission.gauge_reset_left:
        return counted + mission.gauge_shift
    target = 1.0
    if gauge.maps:
        rest_v = battery.open_circuit_v(shared.curve, charge)
        target = _mapped(gauge, rest_v - shared.resistance_ohm * power_w / rest_v)
    if gauge.resets:
        mission.gauge_shift = target - counted
        mission.gauge_reset_left = 0.0
    return target


@inline
def _mapped(gauge: Any, volts: float) -> Any:
    """Share that a map shows; as `np.interp`, which takes ten times as long of one number."""
    k = 1
    while k < MOST_POINTS - 1 and volts > gauge.map_v[k]:
        k += 1
    low_v = gauge.map_v[k - 1]
    low_share = gauge.map_share[k - 1]
    weight = (volts - low_v) / (gauge.map_v[k] - low_v)
    return low_share + (gauge.map_share[k] - low_share) * min(max(weight, 0.0), 1.0)
