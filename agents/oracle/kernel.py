"""What the oracle computes in compiled code: every decision in it is rolled by the environment's own `decide`."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.envs.actions import LEVELS, at_level
from homeward.envs.conditions import weather
from homeward.envs.driving import decide, map_place
from homeward.envs.reward import score
from homeward.envs.state import GO, RETURN, STOP
from homeward.physics import model
from homeward.physics.jit import compiled

_HAIR_M = 1e-6
"""Way of a roll that stays where it is."""
_NONE = -1e300  # score of what was not reached: below any, and finite
CELLS = 16
"""Cells of energy, and of backlog, around a plan. Chosen: memory and time grow with the product of both."""


@compiled
def _roll(m: Any, p: Any, route: Any, c: Any, speed_level: int, sensing_level: int, mode: int) -> None:
    """One decision of the environment, from the action grid."""
    s = c.shared
    speed_mps = at_level(speed_level, s.min_speed_mps, s.max_speed_mps)
    sensing_hz = at_level(sensing_level, 0.0, s.max_sensing_hz)
    decide(m, p if c.hidden.own_robots else c.nominal, route, c.nominal, s, speed_mps, sensing_hz, mode)
    weather.change(m)


@compiled
def see_route(constants: Any, missions_begun: Any, routes: Any) -> None:
    """Let the robot have seen every place of its route."""
    c, m, route = constants[0], missions_begun[0], routes[0]
    for k in range(1, c.shared.places):
        before = route.places[k - 1]
        cost_j = before.home_cost_j + before.home_j_per_m * c.shared.place_m
        map_place(m, c.nominal, route.places[k], c.nominal, c.shared, cost_j, 0.0)


@compiled
def measure(
    constants: Any,
    robots: Any,
    routes: Any,
    starts: Any,
    works: Any,
    pieces: int,
    out_w: Any,
    home_w: Any,
    standing_w: Any,
    gain_per_m: Any,
    samples_per_m: Any,
    radio_hz: Any,
) -> None:
    """Roll decisions of every kind in every place.

    Args:
        constants: `CONSTANTS_DTYPE`, shape (1,); its shared record is changed: decisions are short, and memory and
            radio are switched off and on.
        robots: True robot, shape (1,).
        routes: Route, shape (1,), every place of it seen.
        starts: Mission that has just begun, `MISSION_DTYPE`, shape (1,).
        works: Room for another.
        pieces: Pieces of a place.
        out_w: Written, and all that follow, as in `homeward.agents.oracle.rates.Rates`.
    """
    c, p, route, m = constants[0], robots[0], routes[0], works[0]
    s, radio = c.shared, c.shared.radio_hz
    s.backlog_limit = np.inf
    winds = np.empty((s.max_decisions + 1, 2))
    warmest_c = _weather(works, starts, winds)
    for k in range(s.places):
        near_m = k * s.place_m
        least, most = _headwinds(winds, route.places[k])
        for i in range(LEVELS):
            speed_mps = at_level(i, s.min_speed_mps, s.max_speed_mps)
            for j in range(LEVELS):
                _set_out(works, starts, route, k, near_m, speed_mps)
                _blow(m, least, warmest_c)
                s.decision_s, s.radio_hz = 0.5 * s.place_m / speed_mps, 0.0
                before = score(m, s)
                _roll(m, p, route, c, i, j, GO)
                out_w[k, i, j] = m.power_w
                gain_per_m[k, i, j] = (score(m, s) - before) / (m.position_m - near_m)
                samples_per_m[k, i, j] = m.backlog / (m.position_m - near_m)
                _set_out(works, starts, route, k, near_m + _HAIR_M, speed_mps)
                _blow(m, most, warmest_c)
                m.returning, m.direction = True, -1.0
                s.decision_s = 0.5 * _HAIR_M / speed_mps
                _roll(m, p, route, c, i, j, RETURN)
                home_w[k, i, j] = m.power_w
        for j in range(LEVELS):
            _set_out(works, starts, route, k, near_m, 0.0)
            _blow(m, least, warmest_c)
            _roll(m, p, route, c, 0, j, STOP)
            standing_w[k, j] = m.power_w
        s.decision_s, s.radio_hz = _HAIR_M / s.min_speed_mps, radio
        for piece in range(pieces):
            for moving in range(2):
                _set_out(works, starts, route, k, near_m + piece * s.place_m / pieces, 0.0)
                m.backlog = 2.0 * radio * s.decision_s
                before = m.backlog
                _roll(m, p, route, c, 0, 0, GO if moving else STOP)
                radio_hz[k * pieces + piece, moving] = (before - m.backlog) / s.decision_s
        s.radio_hz = 0.0


@compiled
def _weather(works: Any, starts: Any, winds: Any) -> Any:
    """Winds of a mission, decision by decision, east and north; and how warm it gets."""
    works[0] = starts[0]
    m = works[0]
    warmest_c = m.temperature_c
    for n in range(len(winds)):
        winds[n, 0], winds[n, 1] = m.mean_east_mps + m.gust_east_mps, m.mean_north_mps + m.gust_north_mps
        warmest_c = max(warmest_c, m.temperature_c)
        m.decisions += 1
        weather.change(m)
    return warmest_c


@compiled
def _headwinds(winds: Any, place: Any) -> Any:
    """Least and most wind against the way out at a place, of all that blow during the mission."""
    least, most = np.inf, -np.inf
    for n in range(len(winds)):
        headwind_mps = model.headwind(winds[n, 0], winds[n, 1], place.east, place.north)
        least, most = min(least, headwind_mps), max(most, headwind_mps)
    return least, most


@compiled
def _blow(m: Any, headwind_mps: float, temperature_c: float) -> None:
    """Let one wind blow against the way out where the robot is, for good, and the air be so warm."""
    m.mean_east_mps, m.mean_north_mps = headwind_mps * m.here.east, headwind_mps * m.here.north
    m.gust_east_mps = m.gust_north_mps = m.gust_kick = m.warming_k = 0.0
    m.temperature_c = temperature_c


@compiled
def _set_out(works: Any, starts: Any, route: Any, k: int, position_m: float, speed_mps: float) -> None:
    """Put a robot as at its start into a place that it comes to for the first time."""
    works[0] = starts[0]
    m = works[0]
    m.place, m.position_m, m.furthest_m, m.speed_mps = k, position_m, position_m, speed_mps
    m.here = route.places[k]


@compiled
def way_home(
    constants: Any,
    robots: Any,
    routes: Any,
    starts: Any,
    works: Any,
    step_m: float,
    j_per_s: float,
    home_j: Any,
    home_s: Any,
) -> None:
    """Least energy home, and the time that it takes, from multiples of a step along the route: dynamic programming.

    Args:
        step_m: Distance between the points, m.
        j_per_s: What a second is worth, J.
        home_j: Written, shape (points,).
        home_s: Written, shape (points,).
    """
    c, p, route, m = constants[0], robots[0], routes[0], works[0]
    s = c.shared
    home_j[0] = home_s[0] = 0.0
    for point in range(1, len(home_j)):
        best = np.inf
        at_m = point * step_m
        for i in range(LEVELS):
            _set_out(works, starts, route, min(int(at_m / s.place_m), s.places - 1), at_m, 0.0)
            m.returning, m.direction = True, -1.0
            had_j = m.energy_j
            _roll(m, p, route, c, i, 0, RETURN)
            if m.depleted:
                continue
            spent_j = had_j - m.energy_j + _at(home_j, m.position_m, step_m)
            took_s = m.time_s - starts[0].time_s + _at(home_s, m.position_m, step_m)
            if spent_j + j_per_s * took_s < best:
                best = spent_j + j_per_s * took_s
                home_j[point], home_s[point] = spent_j, took_s


@compiled
def _at(values: Any, position_m: float, step_m: float) -> Any:
    """Linear interpolation between points."""
    share = min(max(position_m, 0.0) / step_m, len(values) - 1.0)
    point = min(int(share), len(values) - 2)
    beyond = share - point
    return values[point] + (beyond * (values[point + 1] - values[point]) if beyond > 0.0 else 0.0)


@compiled
def search(
    constants: Any,
    robots: Any,
    routes: Any,
    starts: Any,
    room: Any,
    rates: int,
    prices: Any,
    worth: Any,
    ahead: Any,
    plan: Any,
    home_j: Any,
    home_s: Any,
    step_m: float,
    cells: Any,
    parents: Any,
    actions: Any,
    found: Any,
) -> int:
    """Search for the best way out, keeping of all missions in one cell the most promising: dynamic programming.

    Cells are of distance driven, energy and backlog (on a patrol, time left of a pit stop) around a plan, and each
    keeps a mission as the environment left it, so that what is found can be done. Distances are worked through in
    order, with room for as many as a move may lead ahead.

    Args:
        room: Room for missions, `MISSION_DTYPE`, shape (distances, CELLS * CELLS).
        rates: Sensing levels that are tried.
        prices: Score that a joule and a second are worth, and a second of a pit stop costs, shape (3,).
        worth: What a sample on board costs, at points along the route, shape (points,).
        ahead: What lies ahead is worth away from home and towards it, shape (2, points).
        plan: Energy (J) and backlog (samples) by plan, shape (2, points).
        home_j: Least energy home, J, shape (points,).
        home_s: Time that it takes, s, shape (points,).
        step_m: Distance between points, m.
        cells: Size of a cell: distance (m), energy (J), backlog (samples, or s), shape (3,).
        parents: Written, the node before, shape (nodes,).
        actions: Written, action that led there as speed + 5 * sensing, or -1 for a stop, shape (nodes,).
        found: Written, the best missions found: score at home by estimate, and node, shape (kept, 2).

    Returns:
        Number of nodes.
    """
    c, p, route = constants[0], robots[0], routes[0]
    s = c.shared
    ring, width = room.shape
    values = np.full((ring, width), _NONE)
    fresh = np.zeros((ring, width), np.bool_)
    origin, action = np.empty((ring, width), np.int64), np.empty((ring, width), np.int64)
    spare = np.empty(2, starts.dtype)
    found[:] = _NONE
    room[0, 0], values[0, 0], fresh[0, 0], origin[0, 0] = starts[0], 0.0, True, -1
    nodes, near, last = 0, 0, 0
    while near <= last and nodes < len(parents):
        row, again = near % ring, True
        while again and nodes < len(parents):
            again = False
            for slot in range(width):
                if not fresh[row, slot] or values[row, slot] <= found[0, 0] or nodes == len(parents):
                    continue
                fresh[row, slot] = False
                again = True
                parents[nodes], actions[nodes] = origin[row, slot], action[row, slot]
                here = nodes
                nodes += 1
                spare[0] = room[row, slot]
                m = spare[0]
                # On its way home a patrol completes the lap under way.
                _note(found, score(m, s) + 0.5 * (m.legs % 2.0), here)
                left_s = (s.max_decisions - m.decisions - 1) * s.decision_s
                for code in range(-1, LEVELS * rates):
                    m = spare[1]
                    spare[1] = spare[0]
                    if code < 0:
                        _roll(m, p, route, c, 0, 0, STOP)
                    else:
                        _roll(m, p, route, c, code % LEVELS, code // LEVELS, GO)
                    short = m.energy_j < _at(home_j, m.position_m, step_m)
                    if m.depleted or m.home or short or left_s < _at(home_s, m.position_m, step_m):
                        continue
                    value = (
                        score(m, s)
                        + prices[0] * m.energy_j
                        + prices[1] * left_s
                        - prices[2] * m.dwell_s
                        - m.backlog * _at(worth, m.position_m, step_m)
                        + _at(ahead[0 if m.direction > 0.0 else 1], m.position_m, step_m)
                    )
                    distance = int(m.distance_m / cells[0])
                    to = distance % ring
                    off_j = _cell(m.energy_j - _at(plan[0], m.position_m, step_m), cells[1])
                    off_load = _cell(m.backlog + m.dwell_s - _at(plan[1], m.position_m, step_m), cells[2])
                    if off_j < 0 or off_load < 0:
                        continue
                    at = off_j + CELLS * off_load
                    if value > values[to, at] and value > found[0, 0]:
                        room[to, at], values[to, at], fresh[to, at] = m, value, True
                        origin[to, at], action[to, at] = here, code
                        last = max(last, distance)
        values[row, :] = _NONE
        fresh[row, :] = False
        near += 1
    return nodes


@compiled
def _cell(offset: float, size: float) -> int:
    """Cell of an offset from the plan, of which there are as many on either side, or -1 beyond them."""
    cell = int(np.floor(offset / size + 0.5 * CELLS))
    return cell if 0 <= cell < CELLS else -1


@compiled
def _note(found: Any, score: float, node: int) -> None:
    """Keep a mission that may turn back now among the best; the list is sorted."""
    last = len(found) - 1
    if not score > found[last, 0]:
        return
    while last > 0 and found[last - 1, 0] < score:
        found[last] = found[last - 1]
        last -= 1
    found[last, 0], found[last, 1] = score, node


@compiled
def follow(
    constants: Any,
    robots: Any,
    routes: Any,
    starts: Any,
    works: Any,
    out: Any,
    home_j: Any,
    home_s: Any,
    j_per_s: float,
    step_m: float,
    actions: Any,
) -> int:
    """Drive out by given actions and home by the way that costs least.

    Args:
        out: Actions of the way out, int64, shape (n, 3).
        actions: Written, all actions, int64, shape (decisions, 3).

    Returns:
        Number of actions, or -1 if the robot does not come home.
    """
    c, p, route, m = constants[0], robots[0], routes[0], works[0]
    s = c.shared
    m_before = starts.copy()
    works[0] = starts[0]
    for n in range(s.max_decisions):
        if n < len(out):
            actions[n] = out[n]
        else:
            best, best_level = np.inf, LEVELS - 1
            m_before[0] = works[0]
            for i in range(LEVELS):
                works[0] = m_before[0]
                _roll(m, p, route, c, i, 0, RETURN)
                cost_j = m_before[0].energy_j - m.energy_j + _at(home_j, m.position_m, step_m)
                cost_j += j_per_s * (m.time_s - m_before[0].time_s + _at(home_s, m.position_m, step_m))
                if not m.depleted and cost_j < best:
                    best, best_level = cost_j, i
            works[0] = m_before[0]
            actions[n, 0], actions[n, 1], actions[n, 2] = best_level, 0, RETURN
        _roll(m, p, route, c, actions[n, 0], actions[n, 1], actions[n, 2])
        if m.home:
            return n + 1
        if m.depleted:
            return -1
    return -1
