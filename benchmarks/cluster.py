"""Print what a task costs on a cluster, and that a lost node loses nothing, on two real Ray nodes of this machine.

    python benchmarks/cluster.py

A head without cores and nodes of one core each are started as processes of this machine, so the times are those of
Ray without a network between. Needs homeward[ray].
"""

from __future__ import annotations

import contextlib
import itertools
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script, it does not see the folder above its own
os.environ["RAY_USAGE_STATS_ENABLED"] = "0"

from benchmarks.tables import table
from homeward.agents import make_policy
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv
from homeward.parallel import run_tasks

OBJECT_STORE_BYTES = 80_000_000
EMPTY, TASKS, EPISODES = 300, 12, 512
"""Tasks that do nothing, tasks of missions, and missions in each."""
REPEATS = 3
"""Measurements, of which the median is printed."""


def nothing(task: int) -> int:
    """Do nothing."""
    return task


def missions(seeds: list[int]) -> list[float]:
    """Scores of missions of homeward/Survey-v0 that `dmax_adaptive` drives."""
    options = Options("Survey")
    policy = make_policy("dmax_adaptive", HomewardVectorEnv(**vars(options)))
    return list(run_episodes(policy, options, seeds).episodes.score.tolist())


@contextlib.contextmanager
def cluster(nodes: int) -> Iterator[Any]:
    """A Ray cluster of nodes with one core each, as processes of this machine."""
    from ray.cluster_utils import Cluster

    head = {"num_cpus": 0, "object_store_memory": OBJECT_STORE_BYTES, "include_dashboard": False}
    started: Any = Cluster(initialize_head=True, head_node_args=head)
    try:
        for _ in range(nodes):
            started.add_node(num_cpus=1, object_store_memory=OBJECT_STORE_BYTES)
        yield started
    finally:
        started.shutdown()


def timed(function: Callable[[], Any]) -> tuple[float, Any]:
    """Median time of a call, s, and what it returned last."""
    times_s = []
    for _ in range(REPEATS):
        start_s = time.perf_counter()
        result = function()
        times_s.append(time.perf_counter() - start_s)
    return statistics.median(times_s), result


def main() -> None:
    """Measure and print."""
    empty = {str(index): index for index in range(EMPTY)}
    seeds = iter(episode_seeds(0, TASKS * EPISODES))
    work = {str(index): list(itertools.islice(seeds, EPISODES)) for index in range(TASKS)}
    expected = {name: missions(task) for name, task in work.items()}  # and the kernels are compiled
    shown = table("", ("where",), ("empty task, ms", "connecting, s", f"{TASKS} tasks of missions, s", "equal"))

    def measure(where: str, **how: Any) -> None:
        once_s, _ = timed(lambda: run_tasks(nothing, {"one": 0}, **how))
        empty_s, _ = timed(lambda: run_tasks(nothing, empty, **how))
        work_s, found = timed(lambda: run_tasks(missions, work, **how))
        per_task_ms = 1e3 * (empty_s - once_s) / (EMPTY - 1)
        shown.add_row(where, f"{per_task_ms:.2f}", f"{once_s:.2f}", f"{work_s:.2f}", str(found == expected))

    measure("this process")
    measure("two processes (joblib)", jobs=2)
    for nodes in (1, 2):
        with cluster(nodes) as running:
            measure(f"Ray, {nodes} node{'s' * (nodes > 1)}", cluster=running.address)
    console = Console()
    console.print(shown)
    with cluster(2) as running:
        start_s = time.perf_counter()
        found = lose_a_node(running, work)
        console.print(
            f"A node killed after the first of {TASKS} tasks: {len(found)} results after "
            f"{time.perf_counter() - start_s:.1f} s, equal to the local ones: {found == expected}"
        )


def lose_a_node(running: Any, work: Mapping[str, list[int]]) -> dict[str, list[float]]:
    """Carry out tasks of missions, and kill a node when the first is done."""
    ended: list[str] = []

    def kill_once(name: str, result: list[float]) -> None:
        if not ended:
            running.remove_node(running.list_all_nodes()[-1], allow_graceful=False)
        ended.append(name)

    return run_tasks(missions, work, cluster=running.address, keep=kill_once)


if __name__ == "__main__":
    main()
