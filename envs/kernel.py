"""The compiled step and reset of missions: one decision is driven place by place through the physics kernel."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from homeward.envs import difficulty, missions
from homeward.envs.difficulty import KNOWN
from homeward.envs.features import gauge_energy, home_cost, observe
from homeward.envs.routes import generate
from homeward.envs.state import RETURN, STOP, SURVEY
from homeward.physics import model
from homeward.physics.jit import compiled, inline
from homeward.physics.kernel import Conditions, advance, demand

LEVELS = 5
"""Levels of speed and of sensing rate that a discrete action chooses from."""


@inline
def _conditions(
    m: Any, place: Any, speed_mps: float, sensing_hz: float, accel_mps2: float, headwind_mps: float, ahead: float
) -> Any:
    """Conditions at a place; `ahead` is 1 away from home and -1 towards it, the headwind that of the way out."""
    sine, roughness = ahead * place.sin_grade, float(place.roughness)
    return Conditions(
        speed_mps,
        sensing_hz,
        accel_mps2,
        sine,
        np.sqrt(1.0 - sine * sine),
        ahead * place.curvature_per_m * speed_mps,
        roughness,
        ahead * headwind_mps,
        m.temperature_c,
        m.position_m,
        ahead,
    )


@inline
def _map_place(m: Any, route: Any, believed: Any, b: Any, shared: Any) -> None:
    """See the place that the robot comes to for the first time, and cost it by its own model, with `b` to work in."""
    place, seen = route.places[m.mapped], route.seen[m.mapped]
    seen.headwind_mps = 0.0
    if m.wind_mps > 0.0:
        seen.headwind_mps = m.wind_mps * np.cos(m.wind_from_rad - place.heading_rad)
    seen.grade_near, seen.interest_near = _mean_ahead(route, shared, m.mapped + 1, m.mapped + 3)
    seen.grade_far = seen.interest_far = 0.0
    if shared.difficulty == KNOWN:
        seen.grade_far, seen.interest_far = _mean_ahead(route, shared, m.mapped + 3, m.mapped + 11)
    cruise = shared.cruise_mps
    headwind = float(seen.headwind_mps) if shared.difficulty == KNOWN else 0.0
    b.speed_mps, b.step_s = cruise, shared.decision_s
    standing_w = demand(believed, b, _conditions(m, place, 0.0, 0.0, 0.0, headwind, 1.0))
    out_w = demand(believed, b, _conditions(m, place, cruise, 0.0, 0.0, headwind, 1.0))
    home_w = demand(believed, b, _conditions(m, place, cruise, 0.0, 0.0, headwind, -1.0))
    seen.standing_w = standing_w
    seen.out_j_per_m = (out_w - standing_w) / cruise
    seen.back_j_per_m = (home_w - standing_w) / cruise
    seen.home_j_per_m = home_w / cruise
    m.mapped += 1
    if m.mapped < shared.places:
        route.seen[m.mapped].home_cost_j = seen.home_cost_j + seen.home_j_per_m * shared.place_m


@inline
def _potential(m: Any, shared: Any, spare_j: float) -> Any:
    """Potential of a state, from d_max: the score so far and what spare energy may add, if the way home still fits.

    It fades to nothing as the energy falls short of the way home by a tenth of the battery.
    """
    fits = min(max(1.0 + 10.0 * spare_j * shared.per_usable_j, 0.0), 1.0)
    return fits * (m.score + missions.hope(m, shared, spare_j)) * shared.per_score


@inline
def _reset(m: Any, p: Any, route: Any, rng: Any, nominal: Any, b: Any, shared: Any, fixed: Any, day: Any) -> None:
    """Begin a mission: draw the day, the route and the true robot."""
    m.time_s = m.distance_m = m.speed_mps = m.winding_k = m.step_s = 0.0
    m.traction_n = m.drive_w = m.power_w = 0.0
    m.position_m = m.furthest_m = m.dwell_s = m.legs = 0.0
    m.backlog = m.backlog_information = m.delivered = m.lost = m.modelled_j = m.sensing_hz = 0.0
    m.place = m.mapped = m.decisions = 0
    m.score = m.cost = 0.0
    m.returning = m.home = m.over = m.depleted = False
    m.direction = 1.0
    m.ledger_j[:] = 0.0
    difficulty.draw(rng, p, nominal, m, shared)
    if shared.generated:
        generate(rng, route, m, shared.places, shared.length_m, shared.hidden_wind)
    else:
        for k in range(shared.places):
            route.places[k] = fixed.places[k]
        m.temperature_c, m.wind_mps, m.wind_from_rad = day[0], day[1], day[2]
    if p.effects == 0:
        m.wind_mps = 0.0  # the paper's robot feels none
    rise = 0.0
    for k in range(shared.places):
        rise += route.places[k].sin_grade
    m.mean_grade = rise / shared.places
    route.seen[0].home_cost_j = 0.0
    _map_place(m, route, nominal, b, shared)
    m.here, m.seen = route.places[0], route.seen[0]
    m.potential = _potential(m, shared, gauge_energy(m, shared)) if shared.shaped else 0.0


@inline
def _mean_ahead(route: Any, shared: Any, start: int, stop: int) -> Any:
    grade, interest = 0.0, 0.0
    stop = min(stop, shared.places)
    for k in range(start, stop):
        grade += route.places[k].sin_grade
        interest += route.places[k].interest
    count = max(stop - start, 1)
    return grade / count, interest / count


@inline
def _cross(m: Any, route: Any, nominal: Any, b: Any, shared: Any) -> None:
    """Pass the border ahead: into the next place, or to an end of the route."""
    ahead = m.place + (1 if m.direction > 0.0 else -1)
    if ahead < 0 or ahead == shared.places:
        missions.arrive(m, shared)
        return
    m.place = ahead
    if m.place == m.mapped:
        _map_place(m, route, nominal, b, shared)
    m.here, m.seen = route.places[ahead], route.seen[ahead]


@inline
def _account(m: Any, nominal: Any, shared: Any, x: Any, passed_s: float, new_m: float) -> None:
    """Book what the robot's own model says of a stretch, and what was sensed and sent on it."""
    seen = m.seen
    drive_j_per_m = seen.out_j_per_m if x.direction > 0.0 else seen.back_j_per_m
    drive_j_per_m += shared.drag_j_per_m * (x.speed_mps * x.speed_mps - shared.cruise_mps * shared.cruise_mps)
    sensing_w = model.ancillary_power(nominal, x.sensing_hz) - model.ancillary_power(nominal, 0.0)
    m.modelled_j += (max(drive_j_per_m, 0.0) * x.speed_mps + seen.standing_w + sensing_w) * passed_s
    if shared.mission == SURVEY:
        missions.sense(m, m.here, shared, x.sensing_hz * passed_s, x.speed_mps * passed_s, new_m)
        missions.transmit(m, shared, x.speed_mps > 0.0, passed_s)


@inline
def _decide(
    m: Any,
    p: Any,
    route: Any,
    nominal: Any,
    b: Any,
    shared: Any,
    speed_mps: float,
    sensing_hz: float,
    mode: int,
) -> None:
    """Carry out one decision, place by place, until its time is over, the battery is empty or the robot is home."""
    if mode == RETURN and not m.returning:
        m.returning, m.direction, m.dwell_s = True, -1.0, 0.0
        m.home = m.position_m <= 0.0
    m.decisions += 1
    m.sensing_hz = sensing_hz
    # The change of speed is spread over the decision.
    accel = (speed_mps - m.speed_mps) * shared.per_decision
    left_s = shared.decision_s
    while left_s > 0.0 and not m.home and not m.depleted:
        speed, dt_s, border_m, crossing = 0.0, left_s, 0.0, False
        if m.dwell_s > 0.0:
            dt_s = min(left_s, m.dwell_s)
        elif mode != STOP and (m.direction < 0.0 or m.position_m < shared.length_m):
            border_m = (m.place + (m.direction > 0.0)) * shared.place_m
            ahead_m = m.direction * (border_m - m.position_m)
            if ahead_m <= 0.0:
                _cross(m, route, nominal, b, shared)
                continue
            speed = speed_mps
            crossing = ahead_m <= speed * left_s
            if crossing:
                dt_s = ahead_m / speed
        x = _conditions(m, m.here, speed, sensing_hz, accel, m.seen.headwind_mps, m.direction)
        passed_s = advance(p, m, x, dt_s)
        left_s -= passed_s
        m.dwell_s = max(m.dwell_s - passed_s, 0.0)
        crossing = crossing and not m.depleted
        m.position_m = border_m if crossing else m.position_m + m.direction * speed * passed_s
        new_m = max(m.position_m - m.furthest_m, 0.0)
        m.furthest_m = max(m.furthest_m, m.position_m)
        _account(m, nominal, shared, x, passed_s, new_m)
        if crossing:
            _cross(m, route, nominal, b, shared)


@inline
def _level(action: int, low: float, high: float) -> float:
    return low + (high - low) * action / (LEVELS - 1)


@inline
def _first_bad_action(choices: Any, levels: Any, shared: Any) -> int:
    if shared.discrete:
        for i in range(len(choices)):
            if not (0 <= choices[i, 0] < LEVELS and 0 <= choices[i, 1] < LEVELS and 0 <= choices[i, 2] < 3):
                return i
    else:
        for i in range(len(levels)):
            if not (abs(levels[i, 0]) <= 1.0 and abs(levels[i, 1]) <= 1.0 and abs(levels[i, 2]) <= 1.0):
                return i
    return -1


def _step(
    choices: Any,
    levels: Any,
    records: Any,
    robots: Any,
    routes: Any,
    nominals: Any,
    beliefs: Any,
    shareds: Any,
    observations: Any,
    rewards: Any,
    terminated: Any,
    truncated: Any,
) -> int:
    """Step every mission by one decision; those that are over are left as they are, without an observation.

    Args:
        choices: Discrete actions, int64, shape (n, 3): speed level, sensing level, stop / go / return; or (0, 3).
        levels: Continuous actions, float32, shape (n, 3), within [-1, 1]; or (0, 3).
        records: `MISSION_DTYPE`, shape (n,).
        robots: True robots, `ROBOT_DTYPE`, shape (n,).
        routes: `ROUTE_DTYPE`, shape (n,).
        nominals: The robot as its file says, shape (1,).
        beliefs: States to work in, `ROBOT_STATE_DTYPE`, shape (n,).
        shareds: `SHARED_DTYPE`, shape (1,).
        observations: Written, `OBSERVATION_DTYPE`, shape (n,).
        rewards: Written, shape (n,).
        terminated: Written, shape (n,).
        truncated: Written, shape (n,).

    Returns:
        Number of missions that ended in this step, or -1 - i if action i is not in the action space: then nothing
        was done.
    """
    bad = _first_bad_action(choices, levels, shareds[0])
    if bad >= 0:
        return -1 - bad
    ended = 0
    for i in numba.prange(len(records)):
        m, route, shared, nominal = records[i], routes[i], shareds[0], nominals[0]
        rewards[i], terminated[i], truncated[i] = 0.0, False, False
        if not m.over:
            if shared.discrete:
                speed = _level(choices[i, 0], shared.min_speed_mps, shared.max_speed_mps)
                sensing_hz = _level(choices[i, 1], 0.0, shared.max_sensing_hz)
                mode = choices[i, 2]
            else:
                speed = _level(2.0 * (levels[i, 0] + 1.0), shared.min_speed_mps, shared.max_speed_mps)
                sensing_hz = _level(2.0 * (levels[i, 1] + 1.0), 0.0, shared.max_sensing_hz)
                mode = min(int(1.5 * (levels[i, 2] + 1.0)), 2)
            # Where nothing is hidden, all missions have the robot of the file: one record, always in the cache.
            p = robots[i] if shared.difficulty > KNOWN else nominal
            _decide(m, p, route, nominal, beliefs[i], shared, speed, sensing_hz, mode)
            done = m.home or m.depleted
            m.score = 0.0 if m.depleted else missions.score(m, shared)
            m.cost = 1.0 if m.depleted else 0.0
            reward = m.score * shared.per_score if m.home else 0.0
            energy_j, cost_j = gauge_energy(m, shared), home_cost(m, shared)
            if shared.shaped:
                potential = 0.0 if done else _potential(m, shared, energy_j - cost_j)
                reward += shared.discount * potential - m.potential
                m.potential = potential
            rewards[i] = reward
            terminated[i] = done
            truncated[i] = not done and m.decisions >= shared.max_decisions
            m.over = done or truncated[i]
            ended += m.over
            observe(m, shared, energy_j, cost_j, observations[i])
    return ended


step_in_turn = compiled(_step)
step_in_parallel = compiled(_step, parallel=True)


@compiled
def reset_missions(
    indices: Any,
    generators: Any,
    records: Any,
    robots: Any,
    routes: Any,
    nominals: Any,
    beliefs: Any,
    shareds: Any,
    observations: Any,
    fixed: Any,
    day: Any,
) -> None:
    """Begin new missions at some indices, with arguments as in the step and some more.

    Args:
        indices: Which missions, int64, shape (k,).
        generators: One `numpy.random.Generator` a mission, a typed list of length n.
        fixed: The route of every mission unless routes are generated, `ROUTE_DTYPE`, shape (1,).
        day: Temperature (C), wind (m/s) and its direction (rad) of that route.
    """
    for i in indices:
        if shareds[0].difficulty > KNOWN:
            robots[i] = nominals[0]
        _reset(records[i], robots[i], routes[i], generators[i], nominals[0], beliefs[i], shareds[0], fixed[0], day)
        m, shared = records[i], shareds[0]
        observe(m, shared, gauge_energy(m, shared), 0.0, observations[i])
