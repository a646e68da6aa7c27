"""The observation: one table of named features, and nothing in it that the robot cannot know."""

from __future__ import annotations

from typing import Any

from homeward.envs.difficulty import KNOWN
from homeward.envs.missions import link
from homeward.physics.jit import inline

FEATURES: tuple[tuple[str, str, str], ...] = (
    ("energy", "usable energy", "energy left by the fuel gauge"),
    ("distance", "reach", "distance from home"),
    ("home_cost", "usable energy", "energy to get home over the ground already driven, by the robot's own model"),
    ("margin", "usable energy", "energy minus home_cost: the d_max margin"),
    ("consumption", "1", "used by the gauge over used by the robot's own model, minus 1, within [-1, 1]"),
    ("modelled", "usable energy", "used so far by the robot's own model"),
    ("returning", "1", "1 once the return has begun"),
    ("outbound", "1", "1 if the next metre leads away from home, -1 if towards it"),
    ("speed", "top speed", "speed of the last decision"),
    ("sensing", "top rate", "sensing rate of the last decision"),
    ("grade", "sine 0.1", "slope here in the direction of travel"),
    ("grade_near", "sine 0.1", "mean slope of the next two places outwards"),
    ("grade_far", "sine 0.1", "mean slope of the eight places beyond, 0 unless the route is known"),
    ("grade_mean", "sine 0.1", "mean slope of the whole route, known beforehand"),
    ("interest", "2", "interest here"),
    ("interest_near", "2", "mean interest of the next two places outwards"),
    ("interest_far", "2", "mean interest of the eight places beyond, 0 unless the route is known"),
    ("sampled", "1", "share of the information here that is taken"),
    ("backlog", "memory", "samples on board"),
    ("link", "1", "share of its rate that the radio keeps here"),
    ("headwind", "10 m/s", "wind against the direction of travel, 0 unless known"),
    ("temperature", "20 K", "air temperature above 10 C"),
    ("score", "good score", "score if the robot were home now"),
    ("time", "time limit", "decisions taken"),
    ("pit_stop", "decision", "time left of a pit stop"),
)
"""Name, unit and meaning of each observed feature."""

NAMES = tuple(name for name, _, _ in FEATURES)
INDEX = {name: index for index, name in enumerate(NAMES)}
LIMIT = 10.0
"""Bound of every feature; values are cut there."""


(_ENERGY, _DISTANCE, _HOME_COST, _MARGIN, _CONSUMPTION, _MODELLED, _RETURNING, _OUTBOUND, _SPEED, _SENSING, _GRADE,
 _GRADE_NEAR, _GRADE_FAR, _GRADE_MEAN, _INTEREST, _INTEREST_NEAR, _INTEREST_FAR, _SAMPLED, _BACKLOG, _LINK, _HEADWIND,
 _TEMPERATURE, _SCORE, _TIME, _PIT_STOP) = range(len(FEATURES))  # fmt: skip


@inline
def gauge_energy(m: Any, shared: Any) -> float:
    """Energy that the robot believes to have left, J: the gauge's share times what a full battery should hold."""
    used = (1.0 - m.energy_j / m.capacity_j) * (1.0 + m.gauge_bias)
    return shared.usable_j * max(1.0 - used, 0.0)


@inline
def home_cost(m: Any, place: Any, shared: Any) -> float:
    """Energy to get home over the ground already driven, J, an estimate by the robot's own model."""
    return place.home_cost_j + (m.position_m - m.place * shared.place_m) * place.home_j_per_m


@inline
def observe(m: Any, place: Any, shared: Any, out: Any) -> None:
    """Write the features of a mission at a place into a row of shape (len(FEATURES),), float32."""
    energy_j = gauge_energy(m, shared)
    cost_j = home_cost(m, place, shared)
    modelled_j = m.modelled_j
    out[_ENERGY] = energy_j / shared.usable_j
    out[_DISTANCE] = min(m.position_m / shared.reach_m, LIMIT)
    out[_HOME_COST] = min(cost_j / shared.usable_j, LIMIT)
    out[_MARGIN] = max((energy_j - cost_j) / shared.usable_j, -LIMIT)
    consumption = 0.0
    if modelled_j > 0.0:
        consumption = min(max((shared.usable_j - energy_j) / modelled_j - 1.0, -1.0), 1.0)
    out[_CONSUMPTION] = consumption
    out[_MODELLED] = min(modelled_j / shared.usable_j, LIMIT)
    out[_RETURNING] = m.returning
    out[_OUTBOUND] = m.direction
    out[_SPEED] = m.speed_mps / shared.max_speed_mps
    out[_SENSING] = m.sensing_hz / shared.max_sensing_hz
    out[_GRADE] = 10.0 * m.direction * place.sin_grade
    out[_GRADE_NEAR] = 10.0 * place.grade_near
    out[_GRADE_MEAN] = 10.0 * m.mean_grade
    out[_INTEREST] = min(0.5 * place.interest, LIMIT)
    out[_INTEREST_NEAR] = min(0.5 * place.interest_near, LIMIT)
    if shared.difficulty == KNOWN:
        out[_GRADE_FAR] = 10.0 * place.grade_far
        out[_INTEREST_FAR] = min(0.5 * place.interest_far, LIMIT)
        out[_HEADWIND] = min(max(0.1 * m.direction * place.headwind_mps, -LIMIT), LIMIT)
    else:
        out[_GRADE_FAR] = 0.0
        out[_INTEREST_FAR] = 0.0
        out[_HEADWIND] = 0.0
    out[_SAMPLED] = place.samples_per_m / (place.samples_per_m + shared.saturation_per_m)
    out[_BACKLOG] = m.backlog / shared.backlog_limit
    out[_LINK] = link(m.position_m, shared.link_m)
    out[_TEMPERATURE] = min(max(0.05 * (m.temperature_c - 10.0), -LIMIT), LIMIT)
    out[_SCORE] = min(m.score / shared.score_scale, LIMIT)
    out[_TIME] = m.decisions / shared.max_decisions
    out[_PIT_STOP] = min(m.dwell_s / shared.decision_s, LIMIT)
