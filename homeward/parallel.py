"""Many tasks in parallel: processes of this machine (joblib) or the nodes of a Ray cluster, with
the same results."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import logging
import os
import platform
import socket
import sys
import traceback
import warnings
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import cloudpickle
import joblib
import numba
import numpy
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

import homeward
from homeward.installed import advice

Task = TypeVar("Task")
Result = TypeVar("Result")

_RETRIES = 5
"""Restarts of a task whose node or process died, before it counts as failed. Chosen."""
_MOST_PER_CORE = 8
"""Allowed jobs per core of this machine: more only wait for each other, and each needs memory.
Chosen."""
_ANSWER_S = 5.0
"""Time in which a cluster must respond, s. Chosen: a network takes milliseconds."""


class TaskError(RuntimeError):
    """A failed task; the message says which one and why, in one line, and a note contains the
    traceback."""


class ClusterError(RuntimeError):
    """Workers that are not available; the message says what to change."""


def run_tasks(
    function: Callable[[Task], Result],
    tasks: Mapping[str, Task],
    *,
    jobs: int = 1,
    cluster: str | None = None,
    keep: Callable[[str, Result], object] = lambda name, result: None,
    title: str = "tasks",
    size: Callable[[Task], int] = lambda task: 1,
) -> dict[str, Result]:
    """Apply a function to every task.

    Results do not depend on where they are computed, as long as a task contains everything that it
    needs: its seed, and data instead of the paths of local files. A task whose node dies restarts
    on another.

    Args:
        function: Takes a task; it, the tasks and their results can be pickled.
        tasks: Tasks by name; errors are reported under the name.
        jobs: Processes on this machine; 1 needs no further process.
        cluster: Address of a Ray cluster, HOST:PORT, whose cores are used instead.
        keep: Called here with the name and result of each task as it ends, in any order; results
            that it writes need not be computed again after an interruption.
        title: Unit that the progress bar on stderr counts.
        size: Number of units of a task.

    Returns:
        Result of each task, in the order of the tasks.

    Raises:
        TaskError: A task failed; unfinished ones are cancelled.
        ClusterError: The number of jobs is not allowed, or the cluster cannot be reached.

    >>> run_tasks(len, {"short": "ab", "long": "abcdef"})
    {'short': 2, 'long': 6}
    """
    check_workers(jobs, cluster)
    ended = (
        _on_this_machine(function, tasks, jobs)
        if cluster is None
        else _on_cluster(function, tasks, cluster)
    )
    results: dict[str, Result] = {}
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    console = Console(stderr=True)
    with (
        contextlib.closing(ended),
        Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True,
                 disable=not console.is_terminal) as bar,
    ):  # fmt: skip
        shown = bar.add_task(title, total=sum(map(size, tasks.values())))
        for name, result in ended:
            keep(name, result)
            results[name] = result
            bar.advance(shown, size(tasks[name]))
    return {name: results[name] for name in tasks}


def check_workers(jobs: int, cluster: str | None) -> None:
    """Refuse unavailable workers before anything is read or written for them.

    Args:
        jobs: Processes on this machine.
        cluster: Address of a Ray cluster, HOST:PORT, if one is used.

    Raises:
        ClusterError: The number of jobs is not allowed, Ray is not installed, or no cluster
            responds.
    """
    cores = os.cpu_count() or 1
    if not 1 <= jobs <= _MOST_PER_CORE * cores:
        noun = "core" if cores == 1 else "cores"
        raise ClusterError(
            f"jobs = {jobs} is not allowed; give 1 to {_MOST_PER_CORE * cores}, as this machine has {cores} {noun}"
        )
    if cluster is None:
        return
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        importlib.import_module("ray")
    except ModuleNotFoundError as error:
        raise ClusterError(
            f"--cluster needs {error.name}: {advice('ray', str(error.name))}"
        ) from None
    host, _, port = cluster.rpartition(":")
    try:
        # Ray itself would retry for many minutes.
        socket.create_connection((host, int(port)), timeout=_ANSWER_S).close()
    except (OSError, ValueError):
        raise ClusterError(
            f"no Ray cluster answers at {cluster!r}: give HOST:PORT as `ray start --head` printed it"
        ) from None


def _on_this_machine(
    function: Callable[[Task], Result], tasks: Mapping[str, Task], jobs: int
) -> Generator[tuple[str, Result]]:
    if jobs == 1:
        for name, task in tasks.items():
            yield name, _result(name, _attempt(function, task))
        return
    unfinished = set(tasks)
    calls = (joblib.delayed(_work)(name, order) for name, order in _orders(function, tasks))
    outcomes = joblib.Parallel(
        n_jobs=max(min(jobs, len(tasks)), 1), return_as="generator_unordered"
    )(calls)
    try:
        for name, outcome in outcomes:
            unfinished.remove(name)
            yield name, _result(name, cloudpickle.loads(outcome))
    except BrokenProcessPool:
        raise TaskError(
            f"a process died, perhaps from lack of memory, before these were done: {', '.join(sorted(unfinished))}; "
            "try fewer jobs"
        ) from None
    finally:
        with warnings.catch_warnings():
            # intended, after a failure
            warnings.filterwarnings("ignore", ".*have been cancelled", UserWarning)
            outcomes.close()


def _on_cluster(
    function: Callable[[Task], Result], tasks: Mapping[str, Task], address: str
) -> Generator[tuple[str, Result]]:
    with _connected(address) as ray:
        work = ray.remote(num_cpus=1, max_retries=_RETRIES)(_work_alone)
        code = code_hash()
        running = {work.remote(name, order, code): name for name, order in _orders(function, tasks)}
        try:
            while running:
                (ended, *_), _ = ray.wait(list(running), num_returns=1)
                name = running.pop(ended)
                try:
                    outcome = ray.get(ended)
                except ray.exceptions.RayError as error:
                    raise TaskError(f"{name}: {_last_line(error)}") from error
                yield name, _result(name, cloudpickle.loads(outcome))
        finally:
            for reference in running:
                ray.cancel(reference, force=True)


@contextlib.contextmanager
def _connected(address: str) -> Iterator[Any]:
    """Ray, connected to a cluster; its messages about lost nodes go to stderr, because stdout is
    the caller's."""
    import ray

    with contextlib.redirect_stdout(sys.stderr):
        try:
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
        except (RuntimeError, OSError) as error:  # such as another version of Ray or Python
            raise ClusterError(
                f"cannot use the Ray cluster at {address}: {_last_line(error)}"
            ) from None
        try:
            yield ray
        finally:
            ray.shutdown()


def _orders(
    function: Callable[[Task], Result], tasks: Mapping[str, Task]
) -> Iterator[tuple[str, bytes]]:
    """Each task with its function as bytes, because results then are writable copies, unlike
    Ray's."""
    for name, task in tasks.items():
        yield name, cloudpickle.dumps((function, task))


def _work(name: str, order: bytes) -> tuple[str, bytes]:
    """Run a task in another process of this machine."""
    function, task = cloudpickle.loads(order)
    outcome: bytes = cloudpickle.dumps(_attempt(function, task))
    return name, outcome


def _work_alone(name: str, order: bytes, code: str) -> bytes:
    """Run a task on one core of a cluster's node."""
    if code != code_hash():
        advice = (
            "has other code of homeward than this machine: install the same version on all nodes"
        )
        refusal: bytes = cloudpickle.dumps(_Failure(f"node {platform.node()} {advice}", ""))
        return refusal
    numba.set_num_threads(1)
    return _work(name, order)[1]


@dataclass(frozen=True)
class _Failure:
    message: str
    trace: str


def _attempt(function: Callable[[Task], Result], task: Task) -> Result | _Failure:
    # Some exceptions cannot be pickled, and none keeps its traceback: they are sent as text.
    try:
        return function(task)
    except Exception as error:
        return _Failure(
            f"{type(error).__name__}: {' '.join(str(error).split())}", traceback.format_exc()
        )


def _result(name: str, outcome: Result | _Failure) -> Result:
    if isinstance(outcome, _Failure):
        error = TaskError(f"{name}: {outcome.message}")
        error.add_note(outcome.trace)
        raise error
    return outcome


def _last_line(error: Exception) -> str:
    return str(error).strip().rpartition("\n")[2]


@functools.cache
def code_hash() -> str:
    """Hash of the package's source code, and of the versions of Python and NumPy beneath it."""
    package = Path(homeward.__file__).parent
    # the last two are links, which a search does not enter
    folders = (package, package / "envs", package / "agents")
    sources = sorted({source for folder in folders for source in folder.rglob("*.py")})
    digest = hashlib.sha256(f"{platform.python_version()} {numpy.__version__}".encode())
    for source in sources:
        digest.update(source.relative_to(package).as_posix().encode() + source.read_bytes())
    return digest.hexdigest()[:16]
