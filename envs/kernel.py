"""The compiled step and reset of missions, one after another or on several cores."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from homeward.envs.actions import command, first_bad_action
from homeward.envs.conditions import difficulty, instruments, weather
from homeward.envs.conditions.draws import FORECAST_GRADE, FORECAST_INTEREST, normal
from homeward.envs.driving import decide, map_place
from homeward.envs.features import home_cost, observe
from homeward.envs.reward import potential, reward
from homeward.envs.routes.route import generate
from homeward.envs.state import AHEAD, IN_SIGHT, MAX_PLACES
from homeward.physics.jit import compiled, inline, prefetch
from homeward.physics.kernel import BELOW_CUTOFF

_FETCH_AHEAD = 4  # missions; chosen: 0.7 us (benchmarks/speed.py), above the latency of memory
_FORECAST_PLACES = 4
"""Places that the forecast averages. Chosen: an eighth of a generated route, a piece between two
knots."""
_FORECAST_SINE = 0.01
"""Standard deviation of the forecast's error of a grade's sine: elevation models of 30 m cells are
good to some metres (Tadono and others, 2014: 5 m), on stretches of several hundred."""
_FORECAST_INTEREST = 0.3
"""Relative standard deviation of the forecast's error of the interest: chosen so that the forecast
usually ranks stretches correctly without revealing their interest."""
_SEEN, _FORECAST = range(2)
"""Rows of cumulative sums over the places."""
_KEYS = 2.0**53  # as many keys as `random` has values (53 bits)
_PER_COUNT = 1.0 / np.maximum(np.arange(MAX_PLACES + 1), 1)
"""Inverse of a number of places, because hundreds of divisions at each start are slow; that of none
is 1."""


@inline
def _add_up_interest(route: Any, shared: Any) -> None:
    """Store an offset for each place: the interest of all metres up to x is offset + interest *
    x."""
    total = 0.0
    for k in range(shared.places):
        place = route.places[k]
        place.interest_to_here = total - place.interest * k * shared.place_m
        total += place.interest * shared.place_m


@inline
def _read_route(mission: Any, route: Any, shared: Any) -> None:
    """Store for each place the mean slope and interest of the stretches ahead, as seen and
    forecast."""
    count = shared.places
    _add_up_interest(route, shared)
    # Cumulative sums to each place, as seen and as forecast.
    sines = np.zeros((2, MAX_PLACES + 1))
    interests = np.zeros((2, MAX_PLACES + 1))
    for start in range(0, count, _FORECAST_PLACES):
        end = min(start + _FORECAST_PLACES, count)
        sine = 0.0
        interest = 0.0
        for k in range(start, end):
            place = route.places[k]
            place.sine_read = instruments.sine_read(mission.key, k, place.sin_grade, shared)
            sine += place.sin_grade
            interest += place.interest
        # The forecast of these places is their mean, with an error.
        sine = sine / (end - start) + _FORECAST_SINE * normal(mission.key, start, FORECAST_GRADE)
        error = 1.0 + _FORECAST_INTEREST * normal(mission.key, start, FORECAST_INTEREST)
        interest = max(interest / (end - start) * error, 0.0)
        for k in range(start, end):
            place = route.places[k]
            sines[_SEEN, k + 1] = sines[_SEEN, k] + place.sine_read
            sines[_FORECAST, k + 1] = sines[_FORECAST, k] + sine
            interests[_SEEN, k + 1] = interests[_SEEN, k] + place.interest
            interests[_FORECAST, k + 1] = interests[_FORECAST, k] + interest
    note_ahead(route, shared, sines, interests)


@inline
def note_ahead(route: Any, shared: Any, sines: Any, interests: Any) -> None:
    """Store for each place the mean slope and interest of the stretches ahead.

    Args:
        route: Route record.
        shared: Shared record.
        sines: Cumulative sums to each place, shape (2, places + 1): as seen, and as forecast.
        interests: The same of the interest.
    """
    count = shared.places
    for k in range(count):
        place = route.places[k]
        for stretch in range(len(AHEAD)):
            start = min(k + AHEAD[stretch][0], count)
            end = min(k + AHEAD[stretch][1], count)
            row = _FORECAST
            if shared.route_is_known or stretch < IN_SIGHT:
                row = _SEEN
            per_place = _PER_COUNT[end - start]
            place.sine_ahead[stretch] = (sines[row, end] - sines[row, start]) * per_place
            place.interest_ahead[stretch] = (
                interests[row, end] - interests[row, start]
            ) * per_place


@inline
def _reset(mission: Any, robot: Any, route: Any, rng: Any, c: Any) -> None:
    """Begin a mission: draw its conditions, the route and the true robot."""
    shared = c.shared
    hidden = c.hidden
    for k in range(shared.places):
        prefetch(route.places[k])
    mission.time_s = 0.0
    mission.distance_m = 0.0
    mission.speed_mps = 0.0
    mission.winding_k = 0.0
    mission.start_left = 0.0
    mission.step_s = 0.0
    mission.traction_n = 0.0
    mission.drive_w = 0.0
    mission.power_w = 0.0
    mission.terminal_w = 0.0
    mission.position_m = 0.0
    mission.furthest_m = 0.0
    mission.dwell_s = 0.0
    mission.legs = 0.0
    mission.backlog = 0.0
    mission.backlog_information = 0.0
    mission.delivered = 0.0
    mission.lost = 0.0
    mission.modelled_j = 0.0
    mission.sensing_hz = 0.0
    mission.place = 0
    mission.mapped = 0
    mission.decisions = 0
    mission.asked = 0
    mission.score = 0.0
    mission.cost = 0.0
    mission.score_reward = 0.0
    mission.shaping_reward = 0.0
    mission.returning = False
    mission.home = False
    mission.over = False
    mission.depleted = False
    mission.direction = 1.0
    mission.ledger_j[:] = 0.0
    mission.key = np.uint64(_KEYS * rng.random())
    instruments.begin(mission, shared, rng.random(), rng.random())
    difficulty.draw(rng, robot, hidden.truth, mission, hidden)
    if hidden.generated:
        generate(rng, route, mission, shared.places, shared.length_m, hidden.hidden_wind)
    else:
        for k in range(shared.places):
            route.places[k] = hidden.fixed.places[k]
        mission.temperature_c = hidden.temperature_c
        mission.wind_mps = hidden.wind_mps
        mission.wind_from_rad = hidden.wind_from_rad
    if robot.effects == 0:
        mission.wind_mps = 0.0  # the paper's robot is not affected by wind
    weather.begin(mission, rng, shared, hidden)
    rise = 0.0
    for k in range(shared.places):
        rise += route.places[k].sin_grade
    mission.mean_grade = rise / shared.places
    _read_route(mission, route, shared)
    map_place(mission, robot, route.places[0], c.nominal, shared, 0.0, 0.0)
    mission.here = route.places[0]
    mission.potential = 0.0
    if shared.shaped:
        mission.potential = potential(mission, route, shared, _margin(mission, shared))


@inline
def _margin(mission: Any, shared: Any) -> Any:
    """True energy beyond the way home over the driven ground, J, as the true robot would drive it
    at cruise."""
    here_m = mission.position_m - mission.place * shared.place_m
    return mission.energy_j - (
        mission.here.true_home_cost_j + here_m * mission.here.true_home_j_per_m
    )


@inline
def _begin(
    i: Any,
    generators: Any,
    constants: Any,
    records: Any,
    robots: Any,
    routes: Any,
    observations: Any,
) -> None:
    """Begin mission i and observe its start; arguments as for `reset_missions`."""
    mission = records[i]
    c = constants[0]
    if c.hidden.own_robots:
        robots[i] = c.hidden.truth
    _reset(mission, robots[i], routes[i], generators[i], c)
    observe(mission, c.shared, 0.0, observations[i])


@inline
def _fetch_next_place(records: Any, routes: Any, i: int) -> None:
    """Prefetch the place that a mission to be stepped shortly may reach, because loading it takes
    time."""
    if i < len(records):
        mission = records[i]
        next_place = mission.place - 1
        if mission.direction > 0.0:
            next_place = mission.place + 1
        prefetch(routes[i].places[max(next_place, 0)])


@inline
def _step(
    mission: Any,
    robot: Any,
    route: Any,
    c: Any,
    row: Any,
    speed_mps: float,
    sensing_hz: float,
    mode: int,
) -> Any:
    """Step a mission by one decision and return the reward."""
    # If nothing is hidden, all missions have the robot of the file: one record, always in the
    # cache.
    true_robot = robot if c.hidden.own_robots else c.nominal
    shared = c.shared
    before_j = mission.energy_j
    decide(mission, true_robot, route, c.nominal, shared, speed_mps, sensing_hz, mode)
    used_j = before_j - mission.energy_j
    if mission.depleted:
        used_j -= mission.ledger_j[BELOW_CUTOFF]  # it does not pass the meter
    instruments.read(mission, shared, used_j)
    earned = reward(mission, route, shared, _margin(mission, shared))
    mission.over = mission.home or mission.depleted or mission.decisions >= shared.max_decisions
    weather.change(mission)
    observe(mission, shared, home_cost(mission, shared), row)
    return earned


@inline
def _step_if_going(
    mission: Any,
    robot: Any,
    route: Any,
    c: Any,
    row: Any,
    speed_mps: float,
    sensing_hz: float,
    mode: int,
) -> Any:
    """Step a mission, unless it is over; return its reward, whether it ended at home or stranded,
    and whether out of time.

    It takes records, because arrays that pass into it would cost as much time as the step.
    """
    earned = 0.0
    ended = False
    late = False
    if not mission.over:
        earned = _step(mission, robot, route, c, row, speed_mps, sensing_hz, mode)
        ended = mission.home or mission.depleted
        late = mission.over and not ended
    return earned, ended, late


@inline
def _step_at(
    i: Any,
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
) -> Any:
    """Step mission i, unless it is over, and return whether it ended; arguments as for
    `step_in_turn`."""
    mission = records[i]
    c = constants[0]
    _fetch_next_place(records, routes, i + _FETCH_AHEAD)
    commanded = command(choices, levels, i, c.shared)
    earned, ended, late = _step_if_going(
        mission, robots[i], routes[i], c, observations[i], *commanded
    )
    rewards[i] = earned
    terminated[i] = ended
    truncated[i] = late
    return ended or late


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
    """Step every mission by one decision; finished ones are left unchanged, without an observation.

    Args:
        choices: Discrete actions, int64, shape (n, 3): speed level, sensing level, stop / go /
            return; or (0, 3).
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
        Number of missions that ended in this step, or -1 - i if action i is not in the action
        space: then no mission was stepped.
    """
    bad = first_bad_action(choices, levels, constants[0].shared)
    if bad >= 0:
        return -1 - bad
    ended = 0
    for i in range(len(records)):
        ended += _step_at(
            i,
            choices,
            levels,
            constants,
            records,
            robots,
            routes,
            observations,
            rewards,
            terminated,
            truncated,
        )
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
    """Step missions on several cores and begin others; arguments as for `step_in_turn` and
    `reset_missions`.

    Args:
        begin: Which missions to restart instead, bool, shape (n,).
    """
    bad = first_bad_action(choices, levels, constants[0].shared)
    if bad >= 0:
        return -1 - bad
    ended = 0
    for i in numba.prange(len(records)):
        if begin[i]:
            rewards[i] = 0.0
            terminated[i] = False
            truncated[i] = False
            _begin(np.int64(i), generators, constants, records, robots, routes, observations)
        else:
            ended += _step_at(
                i,
                choices,
                levels,
                constants,
                records,
                robots,
                routes,
                observations,
                rewards,
                terminated,
                truncated,
            )
    return ended


@compiled
def reset_missions(
    indices: Any,
    generators: Any,
    constants: Any,
    records: Any,
    robots: Any,
    routes: Any,
    observations: Any,
) -> None:
    """Begin new missions at some indices; arguments as for `step_in_turn` and some more.

    Args:
        indices: Which missions, int64, shape (k,).
        generators: One `numpy.random.Generator` for each mission, a typed list of length n.
    """
    for i in indices:
        _begin(i, generators, constants, records, robots, routes, observations)
