"""The observation: one table of named features, without hidden variables.

Energies are readings of the robot's instruments (`homeward.envs.conditions.instruments`). Ways and
loads are predicted by its own model.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.envs.conditions.instruments import STEEPEST_READ
from homeward.envs.sensing import fading
from homeward.envs.state import AHEAD, IN_SIGHT
from homeward.physics import model
from homeward.physics.jit import inline

GAINS = (10.0, 40.0, 100.0)
"""Gains at which margins are observed again, clipped to -1 and 1: a hundredth of the battery
decides about the turn, which a network hardly resolves on the scale of the whole battery. Chosen:
full scale is a tenth, a fortieth and a hundredth of the battery."""
SINE_UNIT = 0.1
INTEREST_UNIT = 2.0
WIND_UNIT_MPS = 10.0
"""Units of slopes (sine), interest and wind (m/s) in the observation, which agents multiply by."""
_PER_SINE = 1.0 / SINE_UNIT
_PER_INTEREST = 1.0 / INTEREST_UNIT
_PER_WIND = 1.0 / WIND_UNIT_MPS
_DRAWN = 0.05
"""Share of the battery, added to both used and modelled energy, that draws the consumption towards
the model's. Chosen: ten decisions at cruise, so that the first ones change it little."""
_STRETCHES = tuple(
    (
        start,
        f"places {start} to {stop - 1} from here outwards, {'in sight' if k < IN_SIGHT else 'known or forecast'}",
    )
    for k, (start, stop) in enumerate(AHEAD)
)

FEATURES: tuple[tuple[str, str, str], ...] = (
    ("energy", "usable energy", "state-of-charge reading"),
    (
        "metered",
        "usable energy",
        "state of charge by the power meter, which estimates the capacity from the state-of-charge reading",
    ),
    ("power", "cruise power", "mean power of the last decision by the power meter"),
    ("distance", "reach", "distance from home"),
    (
        "home_cost",
        "usable energy",
        "energy to get home over the driven ground, by the robot's own model, with what stays below a cut-off",
    ),
    ("margin", "usable energy", "metered minus home_cost: the d_max margin"),
    *(
        (f"margin_{gain:g}", "-1 to 1", f"the same times {gain:g}, clipped to -1 and 1")
        for gain in GAINS
    ),
    ("corrected", "usable energy", "metered minus (1 + consumption) times home_cost"),
    *(
        (f"corrected_{gain:g}", "-1 to 1", f"the same times {gain:g}, clipped to -1 and 1")
        for gain in GAINS
    ),
    (
        "consumption",
        "1",
        "metered over modelled energy used, each plus 0.05, minus 1, within [-1, 1]",
    ),
    ("modelled", "usable energy", "energy used so far by the robot's own model"),
    (
        "returning",
        "1",
        "1 once the return is final; before, the share of the required decisions in a row",
    ),
    ("outbound", "1", "1 if the next metre leads away from home, -1 if towards it"),
    ("speed", "top speed", "speed reading of the last decision"),
    ("sensing", "top rate", "sensing rate of the last decision"),
    ("grade", "sine 0.1", "slope reading here in the direction of travel"),
    *((f"grade_{start}", "sine 0.1", f"mean slope of {where}") for start, where in _STRETCHES),
    ("grade_mean", "sine 0.1", "mean slope of the whole route, known beforehand"),
    ("interest", "2", "interest here"),
    *((f"interest_{start}", "2", f"mean interest of {where}") for start, where in _STRETCHES),
    ("backlog", "memory", "samples on board"),
    ("link", "1", "share of the radio's rate at this distance"),
    ("headwind", "10 m/s", "wind against the direction of travel, by the forecast"),
    (
        "forecast_east",
        "10 m/s",
        "forecast of the wind at the start, towards where it comes from: east component",
    ),
    ("forecast_north", "10 m/s", "its north component"),
    ("east", "1", "direction of travel by compass: east component"),
    ("north", "1", "its north component"),
    ("temperature", "20 K", "air temperature above 10 C"),
    ("score", "good score", "score if the robot were home now"),
    ("time", "time limit", "decisions taken"),
    ("pit_stop", "decision", "time left of a pit stop"),
)
"""Name, unit and meaning of each observed feature."""

DOCK_FEATURES: tuple[tuple[str, str, str], ...] = (
    ("dock_out", "reach", "distance to the next dock outwards, 10 if there is none"),
    ("dock_back", "reach", "distance to the next dock towards home or, if there is none, to home"),
    (
        "dock_cost",
        "usable energy",
        "energy to get there over the driven ground, by the robot's own model",
    ),
    (
        "supplied",
        "usable energy",
        "energy that chargers have supplied so far, by their own meters, which are exact",
    ),
    ("charged", "usable energy", "state of charge that this is, by the estimate of metered"),
)
"""Further features of missions with docks, after the others; at a dock both distances are 0."""

NAMES = tuple(name for name, _, _ in FEATURES)
DOCK_NAMES = tuple(name for name, _, _ in DOCK_FEATURES)
INDEX = {name: index for index, name in enumerate(NAMES + DOCK_NAMES)}


def names_of(docks: bool) -> tuple[str, ...]:
    """Names of the features of an environment, with or without docks."""
    if docks:
        return NAMES + DOCK_NAMES
    return NAMES


LIMIT = 10.0
"""Bound of every feature; values are clipped to it. Chosen: ten times the unit of each, which are
typical sizes."""

_STEEPEST = 10.0 * STEEPEST_READ  # in units of a sine of 0.1
_SHARE = (0.0, 1.0)
_SIGNED = (-1.0, 1.0)
_POSITIVE = (0.0, LIMIT)

RANGES: dict[str, tuple[float, float]] = {
    **dict.fromkeys(NAMES, (-LIMIT, LIMIT)),
    **dict.fromkeys(
        ("energy", "metered", "returning", "sensing", "backlog", "link", "time"), _SHARE
    ),
    **dict.fromkeys(
        (f"{name}_{gain:g}" for name in ("margin", "corrected") for gain in GAINS), _SIGNED
    ),
    **dict.fromkeys(("consumption", "outbound", "east", "north"), _SIGNED),
    **dict.fromkeys(("distance", "modelled", "score", "pit_stop"), _POSITIVE),
    **dict.fromkeys((name for name in NAMES if name.startswith("interest")), _POSITIVE),
    **dict.fromkeys(("grade", "grade_mean"), (-_STEEPEST, _STEEPEST)),
}
"""Lowest and highest value of each feature, in its units: the allowed interval if nothing narrower
is certain."""

_AT = {name: INDEX[f"{name}_{AHEAD[0][0]}"] for name in ("grade", "interest")}


def _row_dtype() -> np.dtype[np.void]:
    """One observation as a record: a field for each feature, and one for each profile of the way
    ahead."""
    fields: list[Any] = []
    for name in NAMES:
        kind, _, start = name.rpartition("_")
        if kind in _AT and start.isdigit():
            if start == str(AHEAD[0][0]):
                fields.append((f"{kind}_ahead", np.float32, (len(AHEAD),)))
        else:
            fields.append((name, np.float32))
    return np.dtype(fields, align=True)


OBSERVATION_DTYPE = _row_dtype()
"""One observation as a record; as an array it has shape (len(FEATURES),)."""


@inline
def home_cost(mission: Any, shared: Any) -> Any:
    """Energy that the battery must hold to get home over the driven ground, J, predicted by the
    robot's own model."""
    return (
        mission.here.home_cost_j
        + (mission.position_m - mission.place * shared.place_m) * mission.here.home_j_per_m
    )


@inline
def _cut(value: Any, limit: float) -> Any:
    """A value within a limit either way."""
    return min(max(value, -limit), limit)


@inline
def observe(mission: Any, shared: Any, cost_j: float, out: Any) -> None:
    """Write the features of a mission.

    Args:
        mission: Mission record.
        shared: Shared record.
        cost_j: Energy to get home, J.
        out: Observation record, written.
    """
    place = mission.here
    cost = cost_j * shared.per_usable_j
    modelled = mission.modelled_j * shared.per_usable_j
    margin = mission.metered - cost
    consumption = (1.0 - mission.metered + mission.charged + _DRAWN) / (modelled + _DRAWN)
    corrected = mission.metered - cost * consumption
    out.energy = mission.soc
    out.metered = mission.metered
    out.power = _cut(mission.read_w * shared.per_cruise_w, LIMIT)
    out.distance = min(mission.position_m * shared.per_reach_m, LIMIT)
    out.home_cost = min(cost, LIMIT)
    out.margin = max(margin, -LIMIT)
    out.margin_10 = _cut(10.0 * margin, 1.0)
    out.margin_40 = _cut(40.0 * margin, 1.0)
    out.margin_100 = _cut(100.0 * margin, 1.0)
    out.corrected = max(corrected, -LIMIT)
    out.corrected_10 = _cut(10.0 * corrected, 1.0)
    out.corrected_40 = _cut(40.0 * corrected, 1.0)
    out.corrected_100 = _cut(100.0 * corrected, 1.0)
    out.consumption = _cut(consumption - 1.0, 1.0)
    out.modelled = min(modelled, LIMIT)
    out.returning = mission.asked * shared.per_return_decisions
    if mission.returning:
        out.returning = 1.0
    out.outbound = mission.direction
    out.speed = mission.read_mps * shared.per_max_speed
    out.sensing = mission.sensing_hz * shared.per_max_sensing
    out.grade = _PER_SINE * mission.direction * place.sine_read
    for k in range(len(AHEAD)):
        out.grade_ahead[k] = _PER_SINE * place.sine_ahead[k]
        out.interest_ahead[k] = min(_PER_INTEREST * place.interest_ahead[k], LIMIT)
    out.grade_mean = _PER_SINE * mission.mean_grade
    out.interest = min(_PER_INTEREST * place.interest, LIMIT)
    out.backlog = mission.backlog * shared.per_backlog
    out.link = 1.0 / fading(mission.position_m, shared.per_link_m)
    against_mps = model.headwind(
        mission.forecast_east_mps, mission.forecast_north_mps, place.east, place.north
    )
    out.headwind = _cut(_PER_WIND * mission.direction * against_mps, LIMIT)
    out.forecast_east = _cut(_PER_WIND * mission.forecast_east_mps, LIMIT)
    out.forecast_north = _cut(_PER_WIND * mission.forecast_north_mps, LIMIT)
    out.east = mission.direction * place.east
    out.north = mission.direction * place.north
    out.temperature = 0.05 * (mission.temperature_c - 10.0)
    out.score = min(mission.score * shared.per_score, LIMIT)
    out.time = mission.decisions * shared.per_max_decisions
    out.pit_stop = min(mission.dwell_s * shared.per_decision, LIMIT)
