"""Episodes of several agents at once, on this machine or on a Ray cluster."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from homeward.agents.base import Policy
from homeward.agents.evaluation.episodes import SIDE_BY_SIDE, Run, run_episodes
from homeward.envs.conditions.instruments import load_instruments
from homeward.envs.options import Options, known_of
from homeward.envs.routes import load_route
from homeward.envs.routes.route import GENERATED, HIDDEN_WIND, Route
from homeward.parallel import run_tasks
from homeward.physics import load_robot


@dataclass(frozen=True)
class _Task:
    """Episodes that run side by side, the same for any number of jobs, so that the results are equal."""

    policy: Policy
    options: Options
    seeds: list[int]
    first: bool


def run_agents(
    agents: Mapping[str, Sequence[Policy]],
    options: Options,
    seeds: Sequence[int],
    *,
    jobs: int = 1,
    cluster: str | None = None,
) -> dict[str, list[Run]]:
    """Run agents on the same episodes, with the same results wherever they run.

    Args:
        agents: Policies of each training seed by label, made for such an environment.
        options: Keyword arguments of the environment.
        seeds: Seed of each episode, at least one.
        jobs: Processes at once on this machine.
        cluster: HOST:PORT of a Ray cluster to use instead.

    Returns:
        Runs of each training seed by label.

    Raises:
        TaskError: An agent failed.
        ClusterError: The cluster cannot be reached.
    """
    starts, carried = range(0, len(seeds), SIDE_BY_SIDE), self_contained(options)
    tasks = {
        _name(label, index, start): _Task(policy, carried, list(seeds[start : start + SIDE_BY_SIDE]), start == 0)
        for label, policies in agents.items()
        for index, policy in enumerate(policies)
        for start in starts
    }
    done = run_tasks(_run, tasks, jobs=jobs, cluster=cluster, title="episodes", size=lambda task: len(task.seeds))

    def whole(label: str, index: int) -> Run:
        head, *rest_of_parts = (done[_name(label, index, start)] for start in starts)
        return head.followed_by(rest_of_parts)

    return {label: [whole(label, index) for index in range(len(policies))] for label, policies in agents.items()}


def self_contained(options: Options) -> Options:
    """The same environment with the contents of files instead of their paths, for other machines.

    Raises:
        RobotError, RouteError, OptionError: An option is invalid.
    """
    route = options.route
    if not isinstance(route, Route) and route not in (GENERATED, HIDDEN_WIND):
        route = load_route(route, float(known_of(options).shared["place_m"][0]))
    truth = None if options.true_robot is None else load_robot(options.true_robot)
    scale = None if options.scaled_for is None else load_robot(options.scaled_for)
    instruments = None if options.instruments is None else load_instruments(options.instruments)
    return dataclasses.replace(
        options, robot=load_robot(options.robot), route=route, instruments=instruments, true_robot=truth,
        scaled_for=scale,
    )  # fmt: skip


def _name(label: str, index: int, start: int) -> str:
    return f"{label}, training seed {index}, episodes from {start}"


def _run(task: _Task) -> Run:
    # A copy, as in other processes: what a policy draws must not depend on earlier tasks.
    run = run_episodes(copy.deepcopy(task.policy), task.options, task.seeds)
    return run if task.first else run.without_traces()
