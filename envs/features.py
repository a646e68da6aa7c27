"""The observation: one table of named features, and nothing in it that the robot cannot know."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.envs.difficulty import KNOWN
from homeward.envs.missions import fading
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
    ("backlog", "memory", "samples on board"),
    ("link", "1", "share of its rate that the radio keeps here"),
    ("headwind", "10 m/s", "wind against the direction of travel, 0 unless known"),
    ("east", "1", "direction of travel, as the compass has it: its part towards east"),
    ("north", "1", "its part towards north"),
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


OBSERVATION_DTYPE = np.dtype([(name, np.float32) for name in NAMES], align=True)
"""One observation as a record; as an array it has shape (len(FEATURES),)."""


@inline
def gauge_energy(m: Any, shared: Any) -> Any:
    """Energy that the robot believes to have left, J: the gauge's share times what a full battery should hold."""
    used = (1.0 - m.energy_j / m.capacity_j) * (1.0 + m.gauge_bias)
    return shared.usable_j * max(1.0 - used, 0.0)


@inline
def home_cost(m: Any, shared: Any) -> Any:
    """Energy to get home over the ground already driven, J, an estimate by the robot's own model."""
    return m.here.home_cost_j + (m.position_m - m.place * shared.place_m) * m.here.home_j_per_m


@inline
def observe(m: Any, shared: Any, energy_j: float, cost_j: float, out: Any) -> None:
    """Write the features of a mission.

    Args:
        m: Mission record.
        shared: Shared record.
        energy_j: Energy by the gauge, J.
        cost_j: Energy to get home, J.
        out: Observation record, written.
    """
    place, per_usable = m.here, shared.per_usable_j
    out.energy = energy_j * per_usable
    out.distance = min(m.position_m * shared.per_reach_m, LIMIT)
    out.home_cost = min(cost_j * per_usable, LIMIT)
    out.margin = max((energy_j - cost_j) * per_usable, -LIMIT)
    consumption = 0.0
    if m.modelled_j > 0.0:
        consumption = min(max((shared.usable_j - energy_j) / m.modelled_j - 1.0, -1.0), 1.0)
    out.consumption = consumption
    out.modelled = min(m.modelled_j * per_usable, LIMIT)
    out.returning = m.returning
    out.outbound = m.direction
    out.speed = m.speed_mps * shared.per_max_speed
    out.sensing = m.sensing_hz * shared.per_max_sensing
    out.grade = 10.0 * m.direction * place.sin_grade
    out.grade_near = 10.0 * place.grade_near
    out.grade_far = 10.0 * place.grade_far
    out.grade_mean = 10.0 * m.mean_grade
    out.interest = min(0.5 * place.interest, LIMIT)
    out.interest_near = min(0.5 * place.interest_near, LIMIT)
    out.interest_far = min(0.5 * place.interest_far, LIMIT)
    out.backlog = m.backlog * shared.per_backlog
    out.link = 1.0 / fading(m.position_m, shared.per_link_m)
    out.headwind = 0.0
    if shared.difficulty == KNOWN:
        out.headwind = min(max(0.1 * m.direction * place.headwind_mps, -LIMIT), LIMIT)
    out.east = m.direction * place.east
    out.north = m.direction * place.north
    out.temperature = 0.05 * (m.temperature_c - 10.0)
    out.score = min(m.score * shared.per_score, LIMIT)
    out.time = m.decisions * shared.per_max_decisions
    out.pit_stop = min(m.dwell_s * shared.per_decision, LIMIT)
