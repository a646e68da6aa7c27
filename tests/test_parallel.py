"""Tasks give the same results in this process and in others; `test_parallel_cluster` has those of a
cluster."""

from __future__ import annotations

import functools
import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from homeward.parallel import ClusterError, TaskError, run_tasks
from tests.parallel_cases import TASKS, assert_equal, draws, draws_slowly, fails


def dies(seed: int) -> int:
    """End the process without a word, at one seed."""
    if seed == 3:
        os._exit(1)
    return seed


@pytest.fixture(scope="module")
def expected() -> dict[str, NDArray[np.float64]]:
    return {name: draws(seed) for name, seed in TASKS.items()}


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_the_order_of_the_tasks(
    jobs: int, expected: dict[str, NDArray[np.float64]]
) -> None:
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
    with pytest.raises(
        TaskError, match=r"a process died.* before these were done: .*seed 3.*; try fewer jobs"
    ):
        run_tasks(dies, TASKS, jobs=2)


@pytest.mark.parametrize("jobs", [0, -1, 99_999])
def test_bad_jobs_are_refused(jobs: int) -> None:
    with pytest.raises(ClusterError, match=f"jobs = {jobs} is not allowed; give 1 to "):
        run_tasks(draws, TASKS, jobs=jobs)


def test_no_tasks_are_no_results() -> None:
    assert run_tasks(draws, {}, jobs=2) == {}


@pytest.mark.parametrize("address", ["127.0.0.1:1", "nowhere.invalid:6379", "auto", "127.0.0.1"])
def test_a_cluster_that_does_not_answer_is_refused(address: str) -> None:
    pytest.importorskip("ray")
    with pytest.raises(ClusterError, match=r"no Ray cluster answers at .*give HOST:PORT"):
        run_tasks(draws, TASKS, cluster=address)
