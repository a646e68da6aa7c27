"""Actions with a score close to the upper bound, by dynamic programming with the environment's own
step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward.agents.oracle import kernel
from homeward.agents.oracle.bound import Multipliers, lagrangian_sums, leg_w
from homeward.agents.oracle.linear_programs import Plan
from homeward.agents.oracle.problem import Problem
from homeward.agents.oracle.rates import PIECES, Array, Rates
from homeward.envs.actions import LEVELS
from homeward.envs.state import GO, RETURN, STOP

_FINE = 4.0
"""Points along the route per shortest move of a decision, and cells of energy and backlog per
greatest change in one. Chosen: finer cells cover a narrower band around the plan, as their number
is `kernel.CELLS`."""
_MOST_STEPS = 400.0
"""Most points along the route that a decision may pass. Chosen: bounds the time of a search."""
_MOST_CELLS = 40.0
"""Most cells of distance that a decision may pass. Chosen: bounds the missions kept at once."""
_NODES = 1 << 20
"""Most nodes of a search. Chosen: they take 9 MB, at 9 bytes each."""
_TRIED = 32
"""Most missions found that are repeated in the environment, best first, until one gets home.
Chosen: at `uncertain` (from seed 1000 on) 400 episodes of OutAndBack need 31 at most, 100 of Survey
26."""
_RESERVES = (1.0, 1.02, 1.05, 1.1, 1.2)
"""Factors on the energy of the way home, tried in turn: it is exact unless an effect has a state or
the weather changes. Chosen: of the same episodes 397 and 74 need only the first, and one 1.2."""
_NEVER = -1e12
"""Score of a turn that is not possible: below any, and finite, so that differences are numbers."""


@dataclass(frozen=True)
class Guide:
    """Terms of the estimated final score of a mission under way, and the plan around which it is
    searched.

    Attributes:
        multipliers: Lagrange multipliers, score per J, per s and per s of a pit stop, shape (3,).
        per_sample: Lagrange multiplier of a sample on board, score per sample, shape (points,).
        ahead: Greatest Lagrangian of the rest of the mission, away from home and towards it, score,
            shape (2, points).
        plan: Energy (J) and backlog (samples) of the plan, shape (2, points).
        cells: Size of a cell: energy (J), and backlog (samples) or pit stop (s).
    """

    multipliers: Array
    per_sample: Array
    ahead: Array
    plan: Array
    cells: tuple[float, float]


def guide_out_and_back(rates: Rates, plan: Plan, decision_s: float, points_m: Array) -> Guide:
    """Guide of a mission out and back that turns within the place of its plan."""
    sums = lagrangian_sums(rates, plan.multipliers)
    multipliers = plan.multipliers
    count = len(rates.radio_hz)
    ends = np.full(count + 1, _NEVER)  # greatest Lagrangian of a turn at a border or beyond it
    for piece in range(plan.turn * PIECES, (plan.turn + 1) * PIECES):
        near = sums.way[piece]
        far = sums.way[piece + 1]
        in_piece = max(far, near) + sums.memory[piece]
        ends[: piece + 1] = np.maximum(ends[: piece + 1], in_piece)
        ends[piece + 1] = max(ends[piece + 1], far + sums.memory[piece])
    ahead = ends - sums.way + sums.home - sums.fallen
    borders = np.arange(count + 1) * rates.piece_m
    planned = borders[: len(plan.energy_j) + 1]
    most_j = rates.out_w.max() * decision_s
    most_samples_hz = rates.samples_per_m[:, 0].max() * rates.speeds_mps[0]
    most_samples = max(most_samples_hz * decision_s, 1.0)
    planned_j = np.append(rates.energy_j, plan.energy_j)
    planned_backlog = np.append(0.0, plan.backlog)
    return Guide(
        multipliers=np.array([multipliers.per_j, multipliers.per_s, 0.0]),
        per_sample=np.interp(points_m, borders, multipliers.per_sample),
        ahead=np.tile(np.interp(points_m, borders, ahead), (2, 1)),
        plan=np.stack([
            np.interp(points_m, planned, planned_j),
            np.interp(points_m, planned, planned_backlog),
        ]),
        cells=(most_j / _FINE, most_samples / _FINE),
    )  # fmt: skip


def guide_patrol(
    rates: Rates, multipliers: Multipliers, pit_stop_s: float, points_m: Array
) -> Guide:
    """Guide of a patrol: the rest of the mission is that of the lap under way, with its pit
    stops."""
    per_m = ((multipliers.per_j * leg_w(rates) + multipliers.per_s) / rates.speeds_mps).min(axis=1)
    borders = np.arange(rates.places + 1) * rates.place_m
    out_per_m, home_per_m = np.split(per_m, 2)
    out_to_border = np.append(0.0, np.cumsum(out_per_m * rates.place_m))
    home_from_border = np.append(0.0, np.cumsum(home_per_m * rates.place_m))
    out = np.interp(points_m, borders, out_to_border)
    home = np.interp(points_m, borders, home_from_border)
    standing_per_s = multipliers.per_j * rates.pit_stop_w + multipliers.per_s
    pit_stop = standing_per_s * pit_stop_s
    # A lap is a score of 1, and its way home the second half of it.
    ahead_out = 1.0 - (out[-1] - out) - home[-1] - 2.0 * pit_stop
    ahead_home = 0.5 - home - pit_stop
    return Guide(
        multipliers=np.array([multipliers.per_j, multipliers.per_s, standing_per_s]),
        per_sample=np.zeros(len(points_m)),
        ahead=np.stack([ahead_out, ahead_home]),
        plan=np.zeros((2, len(points_m))),
        cells=(np.inf, 2.0 * max(pit_stop_s, 1.0) / (kernel.CELLS - 2)),
    )


def points_of(rates: Rates, decision_s: float) -> Array:
    """Evenly spaced points along the route, m, shape (points,), so close that a decision passes
    several."""
    least_m, most_m = rates.speeds_mps[[0, -1]] * decision_s
    step_m = max(least_m / _FINE, most_m / _MOST_STEPS)
    count = int(rates.places * rates.place_m / step_m) + 2
    return np.asarray(step_m * np.arange(count))


def best_actions(case: Problem, guide: Guide, rates: Rates, points_m: Array) -> NDArray[np.int64]:
    """Search for the best mission.

    Returns:
        Its actions, shape (decisions, 3); those of turning back at once if no other mission found
        gets home.
    """
    s = case.shared
    step_m = points_m[1]
    most_m = rates.speeds_mps[-1] * float(s["decision_s"])
    cell_m = max(_FINE * step_m, most_m / _MOST_CELLS)
    room = np.zeros((int(most_m / cell_m) + 2, kernel.CELLS**2), case.start.dtype)
    parents = np.empty(_NODES, np.int64)
    codes = np.empty(_NODES, np.int8)
    best_turns = np.empty((_TRIED, 2))
    actions = np.empty((int(s["max_decisions"]), 3), np.int64)
    per_j, per_s, _ = guide.multipliers
    j_per_s = 0.0
    if per_j > 0.0:
        j_per_s = per_s / per_j
    records = (case.constants, case.robot, case.route, case.start)
    work = case.start.copy()
    home = np.full((2, len(points_m)), np.inf)  # energy (J) and time (s)
    kernel.way_home(*records, work, step_m, j_per_s, home[0], home[1])
    # Without a score for samples, sensing only consumes.
    sensing_levels = LEVELS if s["senses"] else 1
    cells = np.array([cell_m, *guide.cells])
    for reserve in _RESERVES:
        kernel.search(
            *records, room, sensing_levels, guide.multipliers, guide.per_sample, guide.ahead, guide.plan,
            reserve * home[0], home[1], step_m, cells, parents, codes, best_turns,
        )  # fmt: skip
        for score, node in best_turns:
            if score <= 0.0:
                continue
            out = _actions_to(int(node), parents, codes)
            count = kernel.follow(*records, work, out, home[0], home[1], j_per_s, step_m, actions)
            if count > 0:
                return actions[:count].copy()
    return np.array([[0, 0, RETURN]])


def best_shuttle(case: Problem, rates: Rates, points_m: Array) -> NDArray[np.int64]:
    """The best of the patrols at one speed that charge at docks as little as they can
    (`kernel.shuttle`).

    Returns:
        Its actions, shape (decisions, 3), each patrol with the latest turn after which it comes
        home.
    """
    step_m = points_m[1]
    records = (case.constants, case.robot, case.route, case.start)
    work = np.repeat(case.start, 2)
    out = np.empty((int(case.shared["max_decisions"]), 3), np.int64)
    actions = np.empty_like(out)
    home = np.full((2, len(points_m)), np.inf)  # energy (J) and time (s)
    kernel.way_home(*records, work, step_m, 0.0, home[0], home[1])
    best_laps = 0.0
    best_patrol = np.array([[0, 0, RETURN]])
    for level in range(LEVELS):
        turn = kernel.shuttle(*records, work, level, home[0], step_m, out)
        count = -1
        while count < 0 and turn > 0:  # the latest turn after which it comes home
            count = kernel.follow(
                *records, work, out[:turn], home[0], home[1], 0.0, step_m, actions
            )
            turn -= 1
        laps = work["legs"][0] // 2.0
        if count > 0 and laps > best_laps:
            best_laps = laps
            best_patrol = actions[:count].copy()
    return best_patrol


def _actions_to(
    node: int, parents: NDArray[np.int64], codes: NDArray[np.int8]
) -> NDArray[np.int64]:
    """Actions that led to a node, shape (n, 3): speed level, sensing level and mode."""
    path = []
    while parents[node] >= 0:
        path.append(int(codes[node]))
        node = int(parents[node])
    code = np.array(path[::-1], np.int64)
    moving = code >= 0
    speed_level = np.where(moving, code % LEVELS, 0)
    sensing_level = np.where(moving, code // LEVELS, 0)
    mode = np.where(moving, GO, STOP)
    return np.stack([speed_level, sensing_level, mode], axis=1)
