"""The compiled step and reset of missions, one after another or on all cores."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from homeward.envs import difficulty, missions
from homeward.envs.difficulty import KNOWN
from homeward.envs.driving import decide, map_place
from homeward.envs.features import gauge_energy, home_cost, observe
from homeward.envs.routes import generate
from homeward.physics.jit import compiled, inline, prefetch

_FETCH_AHEAD = 4  # missions
LEVELS = 5
"""Levels of speed and of sensing rate that a discrete action chooses from."""


@inline
def _look_ahead(route: Any, shared: Any) -> None:
    """Note at each place the mean slope and interest ahead: of the next two places, and of the eight beyond."""
    count = shared.places
    near_grade = near_interest = far_grade = far_interest = 0.0
    for k in range(count - 1, -1, -1):
        if k + 1 < count:
            near_grade += route.places[k + 1].sin_grade
            near_interest += route.places[k + 1].interest
        if k + 3 < count:
            passed = route.places[k + 3]
            near_grade, far_grade = near_grade - passed.sin_grade, far_grade + passed.sin_grade
            near_interest, far_interest = near_interest - passed.interest, far_interest + passed.interest
        if k + 11 < count:
            far_grade -= route.places[k + 11].sin_grade
            far_interest -= route.places[k + 11].interest
        place = route.places[k]
        near = 1.0 / min(max(count - 1 - k, 1), 2)
        far = 1.0 / min(max(count - 3 - k, 1), 8) if shared.difficulty == KNOWN else 0.0
        place.grade_near, place.interest_near = near_grade * near, near_interest * near
        place.grade_far, place.interest_far = far_grade * far, far_interest * far


@inline
def _potential(m: Any, shared: Any, spare_j: float) -> Any:
    """Potential of a state, from d_max: the score so far and what spare energy may add, if the way home still fits.

    It fades to nothing as the energy falls short of the way home by a tenth of the battery.
    """
    fits = min(max(1.0 + 10.0 * spare_j * shared.per_usable_j, 0.0), 1.0)
    return fits * (m.score + missions.hope(m, shared, spare_j)) * shared.per_score


@inline
def _reset(m: Any, p: Any, route: Any, rng: Any, c: Any) -> None:
    """Begin a mission: draw the day, the route and the true robot."""
    shared, nominal = c.shared, c.nominal
    for k in range(shared.places):
        prefetch(route.places[k])
    m.time_s = m.distance_m = m.speed_mps = m.winding_k = m.step_s = 0.0
    m.traction_n = m.drive_w = m.power_w = 0.0
    m.position_m = m.furthest_m = m.dwell_s = m.legs = 0.0
    m.backlog = m.backlog_information = m.delivered = m.lost = m.modelled_j = m.sensing_hz = 0.0
    m.place = m.mapped = m.decisions = 0
    m.score = m.cost = m.score_reward = m.shaping_reward = 0.0
    m.returning = m.home = m.over = m.depleted = False
    m.direction = 1.0
    m.ledger_j[:] = 0.0
    difficulty.draw(rng, p, c.truth, m, shared)
    if shared.generated:
        generate(rng, route, m, shared.places, shared.length_m, shared.hidden_wind)
    else:
        for k in range(shared.places):
            route.places[k] = c.fixed.places[k]
        m.temperature_c, m.wind_mps, m.wind_from_rad = c.day[0], c.day[1], c.day[2]
    if p.effects == 0:
        m.wind_mps = 0.0  # the paper's robot feels none
    rise = 0.0
    for k in range(shared.places):
        rise += route.places[k].sin_grade
    m.mean_grade = rise / shared.places
    _look_ahead(route, shared)
    map_place(m, route.places[0], nominal, shared, 0.0)
    m.here = route.places[0]
    m.potential = _potential(m, shared, gauge_energy(m, shared)) if shared.shaped else 0.0


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


@inline
def _judge(m: Any, shared: Any, spare_j: float) -> Any:
    """Score a mission after a decision and return the reward."""
    m.score = 0.0 if m.depleted else missions.score(m, shared)
    m.cost = 1.0 if m.depleted else 0.0
    m.score_reward = m.score * shared.per_score if m.home else 0.0
    if shared.shaped:
        potential = 0.0 if m.home or m.depleted else _potential(m, shared, spare_j)
        m.shaping_reward = shared.discount * potential - m.potential
        m.potential = potential
    return m.score_reward + m.shaping_reward


@inline
def _begin(m: Any, p: Any, route: Any, rng: Any, c: Any, row: Any) -> None:
    """Begin a mission and observe its start."""
    _reset(m, p, route, rng, c)
    observe(m, c.shared, gauge_energy(m, c.shared), 0.0, row)


@inline
def _fetch_next_place(records: Any, routes: Any, i: int) -> None:
    """Ask for the place that a mission some turns ahead may come to: it lies far from all else and takes long."""
    if i < len(records):
        m = records[i]
        prefetch(routes[i].places[max(m.place + (1 if m.direction > 0.0 else -1), 0)])


@inline
def _command(choices: Any, levels: Any, i: int, shared: Any) -> Any:
    """Speed (m/s), sensing rate (Hz) and mode of an action."""
    if shared.discrete:
        return (
            _level(choices[i, 0], shared.min_speed_mps, shared.max_speed_mps),
            _level(choices[i, 1], 0.0, shared.max_sensing_hz),
            choices[i, 2],
        )
    return (
        _level(2.0 * (levels[i, 0] + 1.0), shared.min_speed_mps, shared.max_speed_mps),
        _level(2.0 * (levels[i, 1] + 1.0), 0.0, shared.max_sensing_hz),
        min(int(1.5 * (levels[i, 2] + 1.0)), 2),
    )


@inline
def _step(
    m: Any, robot: Any, route: Any, nominal: Any, shared: Any, row: Any, speed_mps: float, sensing_hz: float, mode: int
) -> Any:
    """Step a mission by one decision and return the reward."""
    # Where nothing is hidden, all missions have the robot of the file: one record, always in the cache.
    p = robot if shared.own_robots else nominal
    decide(m, p, route, nominal, shared, speed_mps, sensing_hz, mode)
    energy_j, cost_j = gauge_energy(m, shared), home_cost(m, shared)
    reward = _judge(m, shared, energy_j - cost_j)
    m.over = m.home or m.depleted or m.decisions >= shared.max_decisions
    observe(m, shared, energy_j, cost_j, row)
    return reward


@compiled
def step_in_turn(
    choices: Any,
    levels: Any,
    constants: Any,
    records: Any,
    robots: Any,
    routes: Any,
    observations: Any,
    rewards: Any,
    terminated: Any,
    truncated: Any,
) -> int:
    """Step every mission by one decision; those that are over are left as they are, without an observation.

    Args:
        choices: Discrete actions, int64, shape (n, 3): speed level, sensing level, stop / go / return; or (0, 3).
        levels: Continuous actions, float32, shape (n, 3), within [-1, 1]; or (0, 3).
        constants: `CONSTANTS_DTYPE`, shape (1,).
        records: `MISSION_DTYPE`, shape (n,).
        robots: True robots, `ROBOT_DTYPE`, shape (n,).
        routes: `ROUTE_DTYPE`, shape (n,).
        observations: Written, `OBSERVATION_DTYPE`, shape (n,).
        rewards: Written, shape (n,).
        terminated: Written, shape (n,).
        truncated: Written, shape (n,).

    Returns:
        Number of missions that ended in this step, or -1 - i if action i is not in the action space: then nothing
        was done.
    """
    bad = _first_bad_action(choices, levels, constants[0].shared)
    if bad >= 0:
        return -1 - bad
    ended = 0
    for i in range(len(records)):
        m, c = records[i], constants[0]
        rewards[i], terminated[i], truncated[i] = 0.0, False, False
        if not m.over:
            _fetch_next_place(records, routes, i + _FETCH_AHEAD)
            command = _command(choices, levels, i, c.shared)
            rewards[i] = _step(m, robots[i], routes[i], c.nominal, c.shared, observations[i], *command)
            terminated[i] = m.home or m.depleted
            truncated[i] = m.over and not terminated[i]
            ended += m.over
    return ended


@compiled(parallel=True)
def step_in_parallel(
    begin: Any,
    generators: Any,
    choices: Any,
    levels: Any,
    constants: Any,
    records: Any,
    robots: Any,
    routes: Any,
    observations: Any,
    rewards: Any,
    terminated: Any,
    truncated: Any,
) -> int:
    """Step missions on all cores, with arguments as in turn and in the reset, and begin others meanwhile.

    Args:
        begin: Which missions to begin anew instead, bool, shape (n,).
    """
    bad = _first_bad_action(choices, levels, constants[0].shared)
    if bad >= 0:
        return -1 - bad
    ended = 0
    for i in numba.prange(len(records)):
        m, c = records[i], constants[0]  # taken here, as records do not pass into a parallel loop
        rewards[i], terminated[i], truncated[i] = 0.0, False, False
        if begin[i]:
            if c.shared.own_robots:
                robots[i] = c.truth
            _begin(m, robots[i], routes[i], generators[np.int64(i)], c, observations[i])
        elif not m.over:
            _fetch_next_place(records, routes, i + _FETCH_AHEAD)
            command = _command(choices, levels, i, c.shared)
            rewards[i] = _step(m, robots[i], routes[i], c.nominal, c.shared, observations[i], *command)
            terminated[i] = m.home or m.depleted
            truncated[i] = m.over and not terminated[i]
            ended += m.over
    return ended


@compiled
def reset_missions(
    indices: Any, generators: Any, constants: Any, records: Any, robots: Any, routes: Any, observations: Any
) -> None:
    """Begin new missions at some indices, with arguments as in the step and some more.

    Args:
        indices: Which missions, int64, shape (k,).
        generators: One `numpy.random.Generator` a mission, a typed list of length n.
    """
    for i in indices:
        c = constants[0]
        if c.shared.own_robots:
            robots[i] = c.truth
        _begin(records[i], robots[i], routes[i], generators[i], c, observations[i])
