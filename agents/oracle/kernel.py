"""Compiled part of the oracle: dynamic programming and measurements with the environment's own
step, `decide`.

Arguments that functions share:

    constants: `CONSTANTS_DTYPE`, shape (1,).
    robots: True robot, `ROBOT_DTYPE`, shape (1,).
    routes: `ROUTE_DTYPE`, shape (1,), with every place seen.
    starts: Mission at its start, `MISSION_DTYPE`, shape (1,); not changed.
    works: Work space, `MISSION_DTYPE`, shape (1,).
    step_m: Distance between points along the route, from home on, m.
    j_per_s: Energy equivalent to a second: ratio of the Lagrange multipliers of time and energy,
    J/s. home_j, home_s: Energy (J) and time (s) of the best way home from every point, shape
    (points,).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.envs import docks
from homeward.envs.actions import LEVELS, at_level
from homeward.envs.conditions import weather
from homeward.envs.driving import decide, map_place
from homeward.envs.reward import score
from homeward.envs.state import GO, RETURN, STOP
from homeward.physics import model
from homeward.physics.jit import called, compiled, inline

_HAIR_M = 1e-6
"""Distance of a decision that measures at one point, m. Chosen: far below the length of a place."""
_NONE = -1e300  # value of an empty cell: below any, and finite
CELLS = 16
"""Number of cells of energy, and of backlog, around a plan. Chosen: memory and time grow with its
square."""


@called
def _roll(
    m: Any, p: Any, route: Any, c: Any, speed_level: int, sensing_level: int, mode: int
) -> None:
    """Apply one decision to a mission.

    Args:
        m: Mission record, changed.
        p: Record of the true robot.
        route: Route record.
        c: Record of the constants.
        speed_level: Level of the action grid, 0 to 4.
        sensing_level: The same of the sensing rate.
        mode: `STOP`, `GO` or `RETURN`.
    """
    s = c.shared
    speed_mps = at_level(speed_level, s.min_speed_mps, s.max_speed_mps)
    sensing_hz = at_level(sensing_level, 0.0, s.max_sensing_hz)
    true_robot = p if c.hidden.own_robots else c.nominal
    decide(m, true_robot, route, c.nominal, s, speed_mps, sensing_hz, mode)
    weather.change(m)


@compiled
def see_route(constants: Any, missions_begun: Any, routes: Any) -> None:
    """Enter every place of the route into the robot's map, as if it had driven there. `routes` is
    changed."""
    c = constants[0]
    m = missions_begun[0]
    route = routes[0]
    for k in range(1, c.shared.places):
        nearer = route.places[k - 1]
        cost_j = nearer.home_cost_j + nearer.home_j_per_m * c.shared.place_m
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
    """Measure powers, score, samples and radio in every place, by one short decision of each kind.

    The weather is the most favourable of the mission: the least headwind out, the strongest tail
    wind home, and the warmest air.

    Args:
        constants: Shared record changed: decisions are short, the memory is unlimited, and the
            radio is off except when it is measured.
        pieces: Pieces of a place.
        out_w: Written, as are the following ones; shapes and units as in
            `homeward.agents.oracle.rates.Rates`.
    """
    c = constants[0]
    p = robots[0]
    route = routes[0]
    m = works[0]
    s = c.shared
    radio = s.radio_hz
    s.backlog_limit = np.inf
    winds = np.empty((s.max_decisions + 1, 2))
    warmest_c = _weather(works, starts, winds)
    for k in range(s.places):
        near_m = k * s.place_m
        least_mps, most_mps = _headwinds(winds, route.places[k])
        for i in range(LEVELS):
            speed_mps = at_level(i, s.min_speed_mps, s.max_speed_mps)
            for j in range(LEVELS):
                _set_out(works, starts, route, k, near_m, speed_mps)
                _set_weather(m, least_mps, warmest_c)
                s.decision_s = 0.5 * s.place_m / speed_mps
                s.radio_hz = 0.0
                score_before = score(m, s)
                _roll(m, p, route, c, i, j, GO)
                way_m = m.position_m - near_m
                out_w[k, i, j] = m.power_w
                gain_per_m[k, i, j] = (score(m, s) - score_before) / way_m
                samples_per_m[k, i, j] = m.backlog / way_m
                # A hair beyond the border, so that the way home still begins in this place.
                _set_out(works, starts, route, k, near_m + _HAIR_M, speed_mps)
                _set_weather(m, most_mps, warmest_c)
                m.returning = True
                m.direction = -1.0
                s.decision_s = 0.5 * _HAIR_M / speed_mps
                _roll(m, p, route, c, i, j, RETURN)
                home_w[k, i, j] = m.power_w
        for j in range(LEVELS):
            _set_out(works, starts, route, k, near_m, 0.0)
            _set_weather(m, least_mps, warmest_c)
            _roll(m, p, route, c, 0, j, STOP)
            standing_w[k, j] = m.power_w
        s.decision_s = _HAIR_M / s.min_speed_mps
        s.radio_hz = radio
        for piece in range(pieces):
            for moving in range(2):
                _set_out(works, starts, route, k, near_m + piece * s.place_m / pieces, 0.0)
                m.backlog = 2.0 * radio * s.decision_s  # more than the radio can send
                backlog_before = m.backlog
                mode = GO if moving else STOP
                _roll(m, p, route, c, 0, 0, mode)
                radio_hz[k * pieces + piece, moving] = (backlog_before - m.backlog) / s.decision_s
        s.radio_hz = 0.0


@compiled
def charge(
    constants: Any, robots: Any, routes: Any, starts: Any, works: Any, charge_w: Any
) -> None:
    """Measure the power into the battery at every dock, by one short decision each, in the warmest
    air of the mission.

    Args:
        constants: Shared record changed: decisions are short.
        charge_w: Written, W, shape (docks,).
    """
    c = constants[0]
    s = c.shared
    m = works[0]
    winds = np.empty((s.max_decisions + 1, 2))
    warmest_c = _weather(works, starts, winds)
    s.decision_s = _HAIR_M / s.min_speed_mps
    for k in range(s.dock_count):
        at_m = s.docks[k].position_m
        _set_out(works, starts, routes[0], min(int(at_m / s.place_m), s.places - 1), at_m, 0.0)
        _set_weather(m, 0.0, warmest_c)
        _roll(m, robots[0], routes[0], c, 0, 0, STOP)
        charge_w[k] = -m.power_w


@called
def _weather(works: Any, starts: Any, winds: Any) -> Any:
    """Simulate the weather of a mission, and return its highest air temperature, C.

    Args:
        winds: Written, east and north component of the wind at every decision, m/s, shape
            (decisions, 2).
    """
    works[0] = starts[0]
    m = works[0]
    warmest_c = m.temperature_c
    for n in range(len(winds)):
        winds[n, 0] = m.mean_east_mps + m.gust_east_mps
        winds[n, 1] = m.mean_north_mps + m.gust_north_mps
        warmest_c = max(warmest_c, m.temperature_c)
        m.decisions += 1
        weather.change(m)
    return warmest_c


@called
def _headwinds(winds: Any, place: Any) -> Any:
    """Least and greatest headwind of the way out at a place, m/s, of winds of shape (decisions,
    2)."""
    least_mps = np.inf
    most_mps = -np.inf
    for n in range(len(winds)):
        headwind_mps = model.headwind(winds[n, 0], winds[n, 1], place.east, place.north)
        least_mps = min(least_mps, headwind_mps)
        most_mps = max(most_mps, headwind_mps)
    return least_mps, most_mps


@called
def _set_weather(m: Any, headwind_mps: float, temperature_c: float) -> None:
    """Set a constant headwind of the way out (m/s) and a constant air temperature (C)."""
    m.mean_east_mps = headwind_mps * m.here.east
    m.mean_north_mps = headwind_mps * m.here.north
    m.gust_east_mps = 0.0
    m.gust_north_mps = 0.0
    m.gust_kick = 0.0
    m.warming_k = 0.0
    m.temperature_c = temperature_c


@compiled
def _set_out(
    works: Any, starts: Any, route: Any, k: int, position_m: float, speed_mps: float
) -> None:
    """Copy the start into `works`, moved to a position in place `k` that is reached for the first
    time, at a speed."""
    works[0] = starts[0]
    m = works[0]
    m.place = k
    m.position_m = position_m
    m.furthest_m = position_m
    m.speed_mps = speed_mps
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
    """Find the best way home from every point by dynamic programming, from home outwards.

    With x' the position after one decision from x towards home at the speed v,

        J(0) = 0,  J(x) = min over v of energy(x, v) + j_per_s * time(x, v) + J(x').

    J(x') is interpolated linearly between points. Battery and weather are those of the start at
    every point.

    Args:
        home_j: Written, the energy in J(x); left as it is where no speed gets there before the
            battery is empty.
        home_s: Written, the time in J(x), likewise.
    """
    c = constants[0]
    p = robots[0]
    route = routes[0]
    m = works[0]
    s = c.shared
    home_j[0] = home_s[0] = 0.0
    for point in range(1, len(home_j)):
        best_cost_j = np.inf
        at_m = point * step_m
        for i in range(LEVELS):
            _set_out(works, starts, route, min(int(at_m / s.place_m), s.places - 1), at_m, 0.0)
            m.returning = True
            m.direction = -1.0
            had_j = m.energy_j
            _roll(m, p, route, c, i, 0, RETURN)
            if m.depleted:
                continue
            spent_j = had_j - m.energy_j + _at(home_j, m.position_m, step_m)
            took_s = m.time_s - starts[0].time_s + _at(home_s, m.position_m, step_m)
            cost_j = spent_j + j_per_s * took_s
            if cost_j < best_cost_j:
                best_cost_j = cost_j
                home_j[point] = spent_j
                home_s[point] = took_s


@compiled
def _at(values: Any, position_m: float, step_m: float) -> Any:
    """Interpolate values at points, shape (points,), linearly at a position; constant beyond the
    ends."""
    share = min(max(position_m, 0.0) / step_m, len(values) - 1.0)
    point = min(int(share), len(values) - 2)
    beyond = share - point
    if beyond > 0.0:
        return values[point] + beyond * (values[point + 1] - values[point])
    return values[point]  # without the next value, which may be infinite


@compiled
def search(
    constants: Any,
    robots: Any,
    routes: Any,
    starts: Any,
    room: Any,
    rates: int,
    multipliers: Any,
    sample_multiplier: Any,
    ahead: Any,
    plan: Any,
    home_j: Any,
    home_s: Any,
    step_m: float,
    cells: Any,
    parents: Any,
    actions: Any,
    best_turns: Any,
) -> int:
    """Search for the best way out by forward dynamic programming, with one mission in each cell of
    the state space.

    Cells divide distance driven, and energy and backlog (on a patrol, time left of a pit stop)
    relative to a plan. Of the missions in a cell the one with the greatest value is kept, as the
    exact record that the environment left:

        value = score + p_0 * energy + p_1 * time left - p_2 * pit stop left - p_3(x) * backlog + ahead(x)

    This estimates the final score by the Lagrange multipliers of the bound. Cells are expanded by
    increasing distance, with all actions. A successor is discarded if its energy or time do not
    suffice for the way home, if it is outside the cells, or if its value is no greater than the
    best score found. A ring buffer holds the distances that one decision can reach.

    Args:
        room: Work space for missions, `MISSION_DTYPE`, shape (distances, CELLS * CELLS).
        rates: Number of sensing levels that are tried.
        multipliers: Lagrange multipliers p, in score per J, per s and per s of a pit stop, shape
            (3,).
        sample_multiplier: That of a sample on board, p_3, score per sample, shape (points,).
        ahead: Greatest Lagrangian of the rest of the mission, away from home and towards it, score,
            shape (2, points).
        plan: Energy (J) and backlog (samples) of the plan, shape (2, points).
        cells: Size of a cell: distance (m), energy (J), backlog (samples, or s of a pit stop),
            shape (3,).
        parents: Written, the node before, -1 at the start, shape (nodes,).
        actions: Written, action that led there as speed + 5 * sensing level, or -1 for a stop,
            shape (nodes,).
        best_turns: Written, the best missions in descending order: estimated score if it turns back
            now, and node, shape (kept, 2).

    Returns:
        Number of nodes.
    """
    c = constants[0]
    p = robots[0]
    route = routes[0]
    s = c.shared
    ring, width = room.shape
    values = np.full((ring, width), _NONE)
    fresh = np.zeros((ring, width), np.bool_)
    origin = np.empty((ring, width), np.int64)
    action = np.empty((ring, width), np.int64)
    work = np.empty(2, starts.dtype)
    best_turns[:] = _NONE
    room[0, 0] = starts[0]
    values[0, 0] = 0.0
    fresh[0, 0] = True
    origin[0, 0] = -1
    nodes = 0
    near = 0
    last_distance = 0
    while near <= last_distance and nodes < len(parents):
        row = near % ring
        # A stop stays at its distance, so a row is expanded until nothing in it is new.
        repeats = True
        while repeats and nodes < len(parents):
            repeats = False
            for slot in range(width):
                if (
                    not fresh[row, slot]
                    or values[row, slot] <= best_turns[0, 0]
                    or nodes == len(parents)
                ):
                    continue
                fresh[row, slot] = False
                repeats = True
                parents[nodes] = origin[row, slot]
                actions[nodes] = action[row, slot]
                node = nodes
                nodes += 1
                work[0] = room[row, slot]
                m = work[0]
                # On its way home a patrol completes the lap under way.
                _note(best_turns, score(m, s) + 0.5 * (m.legs % 2.0), node)
                left_s = (s.max_decisions - m.decisions - 1) * s.decision_s
                for code in range(-1, LEVELS * rates):
                    m = work[1]
                    work[1] = work[0]
                    if code < 0:
                        _roll(m, p, route, c, 0, 0, STOP)
                    else:
                        _roll(m, p, route, c, code % LEVELS, code // LEVELS, GO)
                    short = m.energy_j < _at(home_j, m.position_m, step_m)
                    late = left_s < _at(home_s, m.position_m, step_m)
                    if m.depleted or m.home or short or late:
                        continue
                    value = _value(m, s, left_s, multipliers, sample_multiplier, ahead, step_m)
                    distance = int(m.distance_m / cells[0])
                    to = distance % ring
                    off_j = _cell(m.energy_j - _at(plan[0], m.position_m, step_m), cells[1])
                    off_load = _cell(
                        m.backlog + m.dwell_s - _at(plan[1], m.position_m, step_m), cells[2]
                    )
                    if off_j < 0 or off_load < 0:  # far from the plan
                        continue
                    cell = off_j + CELLS * off_load
                    if value > values[to, cell] and value > best_turns[0, 0]:
                        room[to, cell] = m
                        values[to, cell] = value
                        fresh[to, cell] = True
                        origin[to, cell] = node
                        action[to, cell] = code
                        last_distance = max(last_distance, distance)
        values[row, :] = _NONE
        fresh[row, :] = False
        near += 1
    return nodes


@inline
def _value(
    m: Any,
    s: Any,
    left_s: float,
    multipliers: Any,
    sample_multiplier: Any,
    ahead: Any,
    step_m: float,
) -> Any:
    """Estimated final score of a mission under way, see `search`; `left_s` is the time left, s."""
    heading = 0 if m.direction > 0.0 else 1
    return (
        score(m, s)
        + multipliers[0] * m.energy_j
        + multipliers[1] * left_s
        - multipliers[2] * m.dwell_s
        - m.backlog * _at(sample_multiplier, m.position_m, step_m)
        + _at(ahead[heading], m.position_m, step_m)
    )


@compiled
def shuttle(
    constants: Any, robots: Any, routes: Any, starts: Any, works: Any, speed_level: int, home_j: Any, step_m: float,
    actions: Any,
) -> int:  # fmt: skip
    """Shuttle at one speed until the time limit, and charge at docks only as much as the way to the
    next stop needs.

    So no time is lost at a dock, as long as the battery is not full there. Before every dock the
    robot looks ahead, with the environment's own step, whether it would come to the next one with
    the energy for the way home from there.

    Args:
        works: Work space, `MISSION_DTYPE`, shape (2,).
        speed_level: Level of the speed.
        actions: Written, int64, shape (decisions, 3): speed level, sensing level and mode.

    Returns:
        Number of actions until the battery is empty or the time is over.
    """
    c = constants[0]
    p = robots[0]
    route = routes[0]
    s = c.shared
    way_m = at_level(speed_level, s.min_speed_mps, s.max_speed_mps) * s.decision_s
    works[0] = starts[0]
    m = works[0]
    for n in range(s.max_decisions):
        mode = GO
        if _may_dock(m, s, way_m):
            works[1] = works[0]
            ahead = works[1]
            _roll(ahead, p, route, c, speed_level, 0, GO)
            while not (ahead.depleted or _may_dock(ahead, s, way_m)):
                _roll(ahead, p, route, c, speed_level, 0, GO)
            _roll(ahead, p, route, c, speed_level, 0, STOP)
            short = ahead.energy_j < _at(home_j, ahead.position_m, step_m)
            if ahead.depleted or short:
                mode = STOP
        actions[n, 0] = speed_level
        actions[n, 1] = 0
        actions[n, 2] = mode
        _roll(m, p, route, c, speed_level, 0, mode)
        if m.depleted:
            return n
    return int(s.max_decisions)


@called
def _may_dock(m: Any, s: Any, way_m: float) -> bool:
    """Whether a robot that stops comes to a dock in this decision."""
    return bool(0.0 <= m.direction * (docks.next_dock_m(m, s) - m.position_m) <= way_m)


@compiled
def _cell(offset: float, size: float) -> int:
    """Index of the cell of an offset from the plan, 0 to `CELLS` - 1 with the plan in the middle,
    or -1 outside."""
    cell = int(np.floor(offset / size + 0.5 * CELLS))
    if 0 <= cell < CELLS:
        return cell
    return -1


@compiled
def _note(best_turns: Any, score: float, node: int) -> None:
    """Insert the score of a mission that turns back now into the best, sorted in descending order,
    shape (kept, 2)."""
    row = len(best_turns) - 1
    if not score > best_turns[row, 0]:
        return
    while row > 0 and best_turns[row - 1, 0] < score:
        best_turns[row] = best_turns[row - 1]
        row -= 1
    best_turns[row, 0] = score
    best_turns[row, 1] = node


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
    """Drive out by given actions, and then home, at every decision at the speed that minimises the
    J of `way_home`.

    Args:
        out: Actions of the way out, int64, shape (n, 3).
        actions: Written, all actions, int64, shape (decisions, 3): speed level, sensing level and
            mode.

    Returns:
        Number of actions, or -1 if the robot does not come home.
    """
    c = constants[0]
    p = robots[0]
    route = routes[0]
    m = works[0]
    s = c.shared
    m_before = starts.copy()
    works[0] = starts[0]
    for n in range(s.max_decisions):
        if n < len(out):
            actions[n] = out[n]
        else:
            best_cost_j = np.inf
            best_level = LEVELS - 1  # the fastest, where every speed empties the battery
            m_before[0] = works[0]
            for i in range(LEVELS):
                works[0] = m_before[0]
                _roll(m, p, route, c, i, 0, RETURN)
                cost_j = m_before[0].energy_j - m.energy_j + _at(home_j, m.position_m, step_m)
                cost_j += j_per_s * (
                    m.time_s - m_before[0].time_s + _at(home_s, m.position_m, step_m)
                )
                if not m.depleted and cost_j < best_cost_j:
                    best_cost_j = cost_j
                    best_level = i
            works[0] = m_before[0]
            actions[n, 0] = best_level
            actions[n, 1] = 0
            actions[n, 2] = RETURN
        _roll(m, p, route, c, actions[n, 0], actions[n, 1], actions[n, 2])
        if m.home:
            return n + 1
        if m.depleted:
            return -1
    return -1
