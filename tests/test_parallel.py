"""Tasks give the same results in this process, in others, and on a cluster that loses a node."""

from __future__ import annotations

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

from homeward.parallel import ClusterError, TaskError, run_tasks

TASKS = {f"seed {seed}": seed for seed in range(6)}


def draws(seed: int) -> NDArray[np.float64]:
    """Numbers of a seed."""
    return np.random.default_rng(seed).normal(size=4)


def draws_slowly(seed: int, folder: Path, wait_s: float) -> NDArray[np.float64]:
    """The same, leaving a file in the name of the process and its parent at the beginning and one at the end."""
    for when in ("begun", "ended"):
        (folder / f"{when}-{seed}-{os.getpid()}-{os.getppid()}").touch()
        time.sleep(wait_s if when == "begun" else 0.0)
    return draws(seed)


def fails(seed: int) -> int:
    """Fail with an exception that cannot be pickled, at one seed."""
    if seed == 3:

        class LocalError(ValueError):
            def __init__(self, one: int, two: int) -> None:
                super().__init__(f"{one} and\n{two}")

        raise LocalError(1, 2)
    return seed


def dies(seed: int) -> int:
    """End the process without a word, at one seed."""
    if seed == 3:
        os._exit(1)
    return seed


def writes(values: NDArray[np.float64]) -> float:
    """Change what came with the task, which is the task's own."""
    values[0] = 7.0
    return float(values.sum())


def assert_equal(one: dict[str, Any], other: dict[str, Any]) -> None:
    assert list(one) == list(other)
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


@pytest.fixture(scope="module")
def expected() -> dict[str, NDArray[np.float64]]:
    return {name: draws(seed) for name, seed in TASKS.items()}


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_the_order_of_the_tasks(jobs: int, expected: dict[str, NDArray[np.float64]]) -> None:
    kept: dict[str, NDArray[np.float64]] = {}
    assert_equal(run_tasks(draws, TASKS, jobs=jobs, keep=kept.__setitem__), expected)
    assert_equal(dict(sorted(kept.items())), expected)


def test_processes_share_the_tasks(tmp_path: Path) -> None:
    run_tasks(functools.partial(draws_slowly, folder=tmp_path, wait_s=0.2), TASKS, jobs=2)
    assert len({entry.name.split("-")[2] for entry in tmp_path.iterdir()} - {str(os.getpid())}) == 2


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_failing_task_is_named_in_one_line(jobs: int) -> None:
    kept: dict[str, int] = {}
    with pytest.raises(TaskError) as caught:
        run_tasks(fails, TASKS, jobs=jobs, keep=kept.__setitem__)
    assert str(caught.value) == "seed 3: LocalError: 1 and 2"
    assert "in fails" in caught.value.__notes__[0]  # the traceback, for those who look
    assert "seed 3" not in kept


def test_a_process_that_dies_ends_the_run() -> None:
    with pytest.raises(TaskError, match=r"a process died.* before these were done: .*seed 3.*; try fewer jobs"):
        run_tasks(dies, TASKS, jobs=2)


@pytest.mark.parametrize("jobs", [0, -1])
def test_bad_jobs_are_refused(jobs: int) -> None:
    with pytest.raises(ClusterError, match=f"jobs = {jobs} is not allowed; give at least 1"):
        run_tasks(draws, TASKS, jobs=jobs)


def test_no_tasks_are_no_results() -> None:
    assert run_tasks(draws, {}, jobs=2) == {}


@pytest.mark.parametrize("address", ["127.0.0.1:1", "nowhere.invalid:6379", "auto", "127.0.0.1"])
def test_a_cluster_that_does_not_answer_is_refused(address: str) -> None:
    pytest.importorskip("ray")
    with pytest.raises(ClusterError, match=r"no Ray cluster answers at .*give HOST:PORT"):
        run_tasks(draws, TASKS, cluster=address)


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
            "_system_config": {"health_check_initial_delay_ms": 1000, "health_check_period_ms": 1000},
        }
        cluster: Any = Cluster(initialize_head=True, head_node_args=head)
        for _ in range(2):
            cluster.add_node(num_cpus=1, object_store_memory=80_000_000)
        yield cluster
        cluster.shutdown()


def test_a_cluster_gives_the_local_results(cluster: Any, expected: dict[str, NDArray[np.float64]]) -> None:
    assert_equal(run_tasks(draws, TASKS, cluster=cluster.address), expected)


def test_tasks_of_a_cluster_may_change_what_they_are_given(cluster: Any) -> None:
    values = np.zeros(200_000)  # more than Ray sends along with a task
    assert run_tasks(writes, {"one": values}, cluster=cluster.address) == {"one": 7.0}
    assert values[0] == 0.0


def test_a_task_that_fails_on_a_cluster_is_named_in_one_line(cluster: Any) -> None:
    with pytest.raises(TaskError) as caught:
        run_tasks(fails, TASKS, cluster=cluster.address)
    assert str(caught.value) == "seed 3: LocalError: 1 and 2"


def test_other_code_on_a_node_is_refused(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("homeward.parallel.code_hash", lambda: "other")
    with pytest.raises(TaskError, match="has homeward of other code than this machine: install the same"):
        run_tasks(draws, {"one": 1}, cluster=cluster.address)


def test_a_lost_node_loses_nothing(
    cluster: Any, expected: dict[str, NDArray[np.float64]], tmp_path: Path, capfd: pytest.CaptureFixture[str]
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
                node for node in cluster.list_all_nodes() if node.all_processes["raylet"][0].process.pid == int(raylet)
            )
            cluster.remove_node(lost, allow_graceful=False)
            os.kill(int(worker), signal.SIGKILL)  # all of the machine is gone at once
        kept.append(name)

    function = functools.partial(draws_slowly, folder=tmp_path, wait_s=2.0)
    assert_equal(run_tasks(function, TASKS, cluster=cluster.address, keep=lose_a_node), expected)
    assert sorted(kept) == list(expected)  # each once
    assert len(begun()) == len(TASKS) + 1  # what the lost node was at began anew
    out, err = capfd.readouterr()
    assert (out, "will be retried" in err) == ("", True)
