"""A real Ray cluster gives the local results to tasks and commands, and loses nothing with a
node."""

from __future__ import annotations

import dataclasses
import functools
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import evaluate
from homeward import load_robot
from homeward.agents.evaluation import tasks as evaluation_tasks
from homeward.parallel import TaskError, run_tasks
from tests.parallel_cases import (
    TASKS,
    assert_equal,
    draws,
    draws_slowly,
    fails,
)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A head without cores and two nodes of one core each, as processes of this machine."""
    pytest.importorskip("ray")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        from ray.cluster_utils import Cluster

        head = {
            "num_cpus": 0,
            "object_store_memory": 80_000_000,
            "include_dashboard": False,
            # A lost node is noticed within seconds.
            "_system_config": {
                "health_check_initial_delay_ms": 1000,
                "health_check_period_ms": 1000,
            },
        }
        cluster: Any = Cluster(initialize_head=True, head_node_args=head)
        for _ in range(2):
            cluster.add_node(num_cpus=1, object_store_memory=80_000_000)
        yield cluster
        cluster.shutdown()


@pytest.fixture(scope="module")
def expected() -> dict[str, NDArray[np.float64]]:
    return {name: draws(seed) for name, seed in TASKS.items()}


def adds(task: tuple[int, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Change what came with the task, which is the task's own."""
    seed, values = task
    values[:4] += draws(seed)
    return values[:4]


def test_tasks_give_the_local_results_and_may_change_what_they_are_given(
    cluster: Any, expected: dict[str, NDArray[np.float64]]
) -> None:
    values = np.zeros(200_000)  # more than Ray sends along with a task
    tasks = {name: (seed, values) for name, seed in TASKS.items()}
    assert_equal(run_tasks(adds, tasks, cluster=cluster.address), expected)
    assert not values.any()


def test_a_task_that_fails_is_named_in_one_line(cluster: Any) -> None:
    with pytest.raises(TaskError) as caught:
        run_tasks(fails, TASKS, cluster=cluster.address)
    assert str(caught.value) == "seed 3: LocalError: 1 and 2"


def test_other_code_on_a_node_is_refused(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("homeward.parallel.code_hash", lambda: "other")
    with pytest.raises(
        TaskError, match="has other code of homeward than this machine: install the same"
    ):
        run_tasks(draws, {"one": 1}, cluster=cluster.address)


def test_an_evaluation_is_the_local_one(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # where no node looks for the files
    Path("mine.toml").write_text(load_robot("rusti").to_toml())
    Path("hill.csv").write_text("distance_m,elevation_m\n0,0\n700,31\n1500,7\n")
    monkeypatch.setattr(evaluation_tasks, "SIDE_BY_SIDE", 4)  # so that there are several tasks
    args = evaluate.Args(
        ("random", "dmax+shield"), "homeward/OutAndBack-v0", episodes=8, robot="mine.toml", route="hill.csv",
        decision_s=300.0, optimum=True,
    )  # fmt: skip
    for out, address in (("local", None), ("cluster", cluster.address)):
        evaluate.main(dataclasses.replace(args, out=tmp_path / out, cluster=address))
    assert Path("cluster/episodes.csv").read_bytes() == Path("local/episodes.csv").read_bytes()


def test_a_lost_node_loses_nothing(
    cluster: Any,
    expected: dict[str, NDArray[np.float64]],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    kept: list[str] = []

    def begun() -> set[str]:
        return {entry.name.removeprefix("begun-") for entry in tmp_path.glob("begun-*")}

    def running() -> set[str]:
        return begun() - {entry.name.removeprefix("ended-") for entry in tmp_path.glob("ended-*")}

    def lose_a_node(name: str, result: NDArray[np.float64]) -> None:
        if not kept:
            while len(running()) < 2:
                time.sleep(0.01)  # until both nodes are at work
            _, worker, raylet = max(running()).split("-")
            (lost,) = (
                node
                for node in cluster.list_all_nodes()
                if node.all_processes["raylet"][0].process.pid == int(raylet)
            )
            cluster.remove_node(lost, allow_graceful=False)
            os.kill(int(worker), signal.SIGKILL)  # all of the machine is gone at once
        kept.append(name)

    function = functools.partial(draws_slowly, folder=tmp_path, wait_s=1.0)
    assert_equal(run_tasks(function, TASKS, cluster=cluster.address, keep=lose_a_node), expected)
    assert sorted(kept) == list(expected)  # each once
    assert len(begun()) == len(TASKS) + 1  # what the lost node was at began anew
    out, err = capfd.readouterr()
    assert (out, "will be retried" in err) == ("", True)
