"""Upper and lower bound of the optimal score of a mission, with full knowledge of its route and
hidden variables.

No policy on the same action grid exceeds the upper bound, see `homeward.agents.oracle.bound`. The
lower bound is the score of a sequence of actions in the environment. Dynamic programming with the
environment's own step finds it, around the plan and with the Lagrange multipliers of the upper
bound, see `homeward.agents.oracle.kernel.search`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward.agents.evaluation.tasks import self_contained
from homeward.agents.oracle.linear_programs import bound_out_and_back, bound_patrol
from homeward.agents.oracle.problem import Problem, problem_of
from homeward.agents.oracle.rates import REFUSED, measure_rates
from homeward.agents.oracle.search import (
    best_actions,
    best_shuttle,
    guide_out_and_back,
    guide_patrol,
    points_of,
)
from homeward.envs.missions import MISSIONS
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv
from homeward.parallel import run_tasks
from homeward.physics import load_robot

__all__ = ["Optimum", "OracleError", "check", "score_of", "solve"]


class OracleError(ValueError):
    """An environment whose optimum the oracle cannot bound; the message says why."""


_TOGETHER = 20
"""Episodes of one parallel task. Chosen: 0.2 to 8 s of work (docs/results.md: 0.01 to 0.4 s an
episode), far more than a task takes to start."""


@dataclass(frozen=True)
class Optimum:
    """Bounds of the optimal score of each episode.

    Attributes:
        lower: Lower bound: score of the actions in the environment, shape (episodes,).
        upper: Upper bound of the score of any policy on the action grid, shape (episodes,).
        actions: Speed level, sensing level and mode of each decision, one array of shape
            (decisions, 3) per episode.
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    actions: tuple[NDArray[np.int64], ...]


def solve(
    options: Options, seeds: Sequence[int], jobs: int = 1, cluster: str | None = None
) -> Optimum:
    """Bound the optimal score of episodes: those of an environment reset with the same seeds.

    Args:
        options: Keyword arguments of the environment.
        seeds: Seed of each episode, as in `homeward.agents.evaluation.run_episodes`.
        jobs: Processes at once on this machine.
        cluster: HOST:PORT of a Ray cluster to use instead.

    Raises:
        TaskError, ClusterError: See `homeward.parallel.run_tasks`.
        OracleError: The action space is continuous, or there is no bound for the mission, or for an
            effect or a cut-off of the robot.

    >>> optimum = solve(Options("OutAndBack", weather="still"), [7])
    >>> bool(0.98 * optimum.upper[0] < optimum.lower[0] <= optimum.upper[0])
    True
    """
    check(options)
    carried = self_contained(options)
    tasks: dict[str, tuple[Options, list[int]]] = {}
    for start in range(0, len(seeds), _TOGETHER):
        some_seeds = list(seeds[start : start + _TOGETHER])
        tasks[f"episodes {start} to {start + len(some_seeds) - 1}"] = carried, some_seeds
    parts = run_tasks(
        _solve_some,
        tasks,
        jobs=jobs,
        cluster=cluster,
        title="optimum",
        size=lambda task: len(task[1]),
    ).values()
    return Optimum(
        lower=np.concatenate([part.lower for part in parts]),
        upper=np.concatenate([part.upper for part in parts]),
        actions=tuple(actions for part in parts for actions in part.actions),
    )


def check(options: Options) -> None:
    """Refuse an environment for which there is no bound.

    Raises:
        OracleError: The action space is continuous, or there is no bound for the mission, or for an
            effect or a cut-off of the robot.
    """
    if options.action_type != "discrete":
        raise OracleError(
            f"the oracle acts on a grid, but action_type is {options.action_type!r}; choose 'discrete'"
        )
    if not MISSIONS[options.mission].adds_up:
        raise OracleError(
            f"the oracle has no bound for {options.mission}: its score is neither a sum over the metres reached nor a "
            "number of laps; leave out --optimum"
        )
    if options.docks and not MISSIONS[options.mission].shuttles:
        raise OracleError(
            f"the oracle has no bound for {options.mission} with docks, for Patrol only; leave out --optimum"
        )
    robot = load_robot(options.robot)
    for effect in REFUSED:
        if effect in robot.active_effects:
            raise OracleError(
                f"the oracle has no bound for a robot with the effect {effect}; switch it off"
            )
    if robot.has_cutoff:
        raise OracleError(
            f"the oracle does not model that a battery is cut off at {robot.cutoff_v:g} V; leave out its cutoff_v"
        )


def _solve_some(task: tuple[Options, list[int]]) -> Optimum:
    options, seeds = task
    env = HomewardVectorEnv(len(seeds), autoreset_mode="Disabled", **vars(options))
    env.reset(seed=seeds)
    upper = np.empty(len(seeds))
    actions = []
    for i in range(len(seeds)):
        upper[i], sequence = _solve(problem_of(env.batch, i))
        actions.append(sequence)
    return Optimum(score_of(options, seeds, actions), upper, tuple(actions))


def _solve(case: Problem) -> tuple[float, NDArray[np.int64]]:
    rates = measure_rates(case)
    decision_s = float(case.shared["decision_s"])
    pit_stop_s = float(case.shared["pit_stop_s"])
    points_m = points_of(rates, decision_s)
    if case.shared["shuttles"]:
        upper, multipliers = bound_patrol(rates, pit_stop_s)
        if case.shared["dock_count"]:
            return upper, best_shuttle(case, rates, points_m)
        guide = guide_patrol(rates, multipliers, pit_stop_s, points_m)
    else:
        upper, plan = bound_out_and_back(rates)
        guide = guide_out_and_back(rates, plan, decision_s, points_m)
    return upper, best_actions(case, guide, rates, points_m)


def score_of(
    options: Options, seeds: Sequence[int], actions: Sequence[NDArray[np.int64]]
) -> NDArray[np.float64]:
    """Scores of given actions in the environment, 0 if the robot does not come home, shape
    (episodes,).

    Args:
        options: Keyword arguments of the environment.
        seeds: Seed of each episode.
        actions: Actions of each episode, shape (decisions, 3); after the last one the robot
            returns.
    """
    count = len(seeds)
    env = HomewardVectorEnv(count, autoreset_mode="Disabled", **vars(options))
    observations, _ = env.reset(seed=list(seeds))
    batch = env.batch
    records = batch.records
    rewards = np.empty(count)
    terminated = np.empty(count, np.bool_)
    truncated = np.empty(count, np.bool_)
    commands = np.empty((count, 3), np.int64)
    while not records["over"].all():
        for i, sequence in enumerate(actions):
            # The last action of a sequence is a return, which is repeated until the mission is
            # over.
            decision = min(int(records["decisions"][i]), len(sequence) - 1)
            commands[i] = sequence[decision]
        batch.step(commands, observations, rewards, terminated, truncated)
    return np.where(records["home"], records["score"], 0.0)
