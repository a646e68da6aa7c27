"""Episodes of several agents at once, on this machine or on a Ray cluster."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from homeward.agents.base import Policy
from homeward.agents.evaluation import Episodes, Run, run_episodes
from homeward.envs.options import Options
from homeward.parallel import run_tasks

EPISODES_A_TASK = 512
"""As many as run side by side; the same for any number of jobs, so that the outcome is."""

_Task = tuple[Policy, Options, list[int]]


def run_agents(
    agents: Mapping[str, Sequence[Policy]],
    options: Options,
    seeds: Sequence[int],
    *,
    jobs: int = 1,
    cluster: str | None = None,
) -> dict[str, list[Run]]:
    """Run agents on the same episodes, with the same outcome wherever they run.

    Args:
        agents: By label the policy of each training seed, made for such an environment.
        options: Keyword arguments of the environment.
        seeds: Seed of each episode.
        jobs: Processes at once on this machine.
        cluster: HOST:PORT of a Ray cluster to use instead.

    Returns:
        By label the run of each training seed.

    Raises:
        TaskError: An agent failed.
        ClusterError: The cluster cannot be used.
    """
    starts = range(0, len(seeds), EPISODES_A_TASK)
    tasks: dict[str, _Task] = {
        _name(label, index, start): (policy, options, list(seeds[start : start + EPISODES_A_TASK]))
        for label, policies in agents.items()
        for index, policy in enumerate(policies)
        for start in starts
    }
    done = run_tasks(_run, tasks, jobs=jobs, cluster=cluster, title="episodes")
    return {
        label: [_join([done[_name(label, index, start)] for start in starts]) for index in range(len(policies))]
        for label, policies in agents.items()
    }


def _name(label: str, index: int, start: int) -> str:
    return f"{label}, training seed {index}, episodes from {start}"


def _run(task: _Task) -> Run:
    policy, options, seeds = task
    # A copy, as other processes have: what a policy draws must not depend on the tasks before.
    return run_episodes(copy.deepcopy(policy), options, seeds)


def _join(parts: Sequence[Run]) -> Run:
    columns = [one.name for one in dataclasses.fields(Episodes)]
    whole = {name: np.concatenate([getattr(part.episodes, name) for part in parts]) for name in columns}
    decision_us = float(np.median([part.decision_us for part in parts]))
    return dataclasses.replace(parts[0], episodes=Episodes(**whole), decision_us=decision_us)
