"""Episodes of several agents at once, on this machine or on a Ray cluster."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

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
    """Episodes that run side by side, the same for any number of jobs, so that the results are
    equal."""

    policy: Policy
    options: Options
    seeds: list[int]
    keeps_traces: bool


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
    starts = range(0, len(seeds), SIDE_BY_SIDE)
    carried = self_contained(options)
    tasks: dict[str, _Task] = {}
    for label, policies in agents.items():
        for index, policy in enumerate(policies):
            for start in starts:
                tasks[_name(label, index, start)] = _Task(
                    policy=policy,
                    options=carried,
                    seeds=list(seeds[start : start + SIDE_BY_SIDE]),
                    keeps_traces=start == 0,
                )
    runs = run_tasks(
        _run, tasks, jobs=jobs, cluster=cluster, title="episodes", size=lambda task: len(task.seeds)
    )

    def joined(label: str, index: int) -> Run:
        """All episodes of a training seed as one run."""
        parts = [runs[_name(label, index, start)] for start in starts]
        return parts[0].followed_by(parts[1:])

    return {
        label: [joined(label, index) for index in range(len(policies))]
        for label, policies in agents.items()
    }


def self_contained(options: Options) -> Options:
    """The same environment with the contents of files instead of their paths, for other machines.

    Raises:
        RobotError, RouteError, OptionError: An option is invalid.
    """
    route = options.route
    if not isinstance(route, Route) and route not in (GENERATED, HIDDEN_WIND):
        route = load_route(route, float(known_of(options).shared["place_m"][0]))
    contents: dict[str, Any] = {"robot": load_robot(options.robot), "route": route}
    if options.instruments is not None:
        contents["instruments"] = load_instruments(options.instruments)
    if options.true_robot is not None:
        contents["true_robot"] = load_robot(options.true_robot)
    if options.scaled_for is not None:
        contents["scaled_for"] = load_robot(options.scaled_for)
    return dataclasses.replace(options, **contents)


def _name(label: str, index: int, start: int) -> str:
    return f"{label}, training seed {index}, episodes from {start}"


def _run(task: _Task) -> Run:
    # A copy, as in other processes: what a policy draws must not depend on earlier tasks.
    run = run_episodes(copy.deepcopy(task.policy), task.options, task.seeds)
    if task.keeps_traces:
        return run
    return run.without_traces()
