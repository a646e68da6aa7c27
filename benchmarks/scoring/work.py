"""Diagnoses of concealed cases in worker processes that see the recordings and cannot open the truth."""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
from threadpoolctl import threadpool_limits

from homeward.diagnosis import analyse
from homeward.files import write_whole


@dataclass(frozen=True)
class Alone:
    """How one hypothesis did alone; `delta_bic` and `held_out_gain` as in diagnosis.json."""

    effect: str
    axis: str
    delta_bic: float
    held_out_gain: float


@dataclass(frozen=True)
class Aside:
    """What is kept of a diagnosis beside its verdict; `error` is a line where it crashed."""

    elapsed_s: float
    cpu_s: float
    error: str | None = None
    ranking: tuple[Alone, ...] = ()

    def write(self, out: Path, name: str) -> None:
        """Write the file that says that a case is done."""
        write_whole(_aside(out, name), json.dumps(dataclasses.asdict(self)) + "\n")

    @classmethod
    def read(cls, out: Path, name: str) -> Aside:
        """Read what `write` wrote.

        Raises:
            OSError: The case was not diagnosed.
        """
        data = json.loads(_aside(out, name).read_text(encoding="utf-8"))
        return cls(**{**data, "ranking": tuple(Alone(**one) for one in data["ranking"])})


def verdict_path(out: Path, name: str) -> Path:
    """Where the diagnosis of a case is written."""
    return out / "verdicts" / f"{name}.json"


def _aside(out: Path, name: str) -> Path:
    return out / "aside" / f"{name}.json"


def is_done(out: Path, name: str) -> bool:
    """Whether a case has been diagnosed, or has crashed."""
    return _aside(out, name).exists()


def diagnose_case(out: Path, name: str) -> None:
    """Diagnose one case from what is seen of it; a crash is written down as one line."""
    verdict_path(out, name).unlink(missing_ok=True)
    folder = out / "seen" / name
    started, used = time.perf_counter(), time.process_time()
    error: str | None = None
    ranking: tuple[Alone, ...] = ()
    try:
        analysis = analyse(sorted(folder.glob("run_*")), folder / "robot.toml")
        if analysis.evidence is not None:
            ranking = tuple(
                Alone(one.effect, one.axis, float(one.delta_bic), float(one.held_out_gain))
                for one in analysis.evidence.naming.ranking
            )
        write_whole(verdict_path(out, name), analysis.diagnosis.to_json())
    except Exception as crash:  # whatever it is, the other cases go on
        error = " ".join(f"{type(crash).__name__}: {crash}".split())[:300]
    Aside(time.perf_counter() - started, time.process_time() - used, error, ranking).write(out, name)


def diagnose_all(out: Path, names: Sequence[str], jobs: int, advance: Callable[[], object]) -> None:
    """Diagnose cases in `jobs` processes.

    Args:
        out: Folder with seen/ and truth/.
        names: Cases, in the order in which they are begun.
        jobs: Number of processes; where one dies, the rest are done one at a time to find the case that kills it.
        advance: Called after each case.
    """
    left = list(names)
    while left:
        pool = _pool(out, jobs)
        try:
            for done in as_completed([pool.submit(diagnose_case, out, name) for name in left]):
                done.result()
                advance()
            return
        except BrokenProcessPool:
            left = [name for name in left if not is_done(out, name)]
            if jobs == 1 and left:  # in order, so it is the first
                Aside(0.0, 0.0, "the process that diagnosed it died").write(out, left.pop(0))
                advance()
            jobs = 1
        finally:
            pool.shutdown(cancel_futures=True)


def _pool(out: Path, jobs: int) -> ProcessPoolExecutor:
    context = multiprocessing.get_context("spawn")  # no threads of this process are copied
    return ProcessPoolExecutor(jobs, context, _prepare, (out / "truth",))


def _prepare(truth: Path) -> None:
    """One thread a process, and none of its files may be the truth."""
    numba.set_num_threads(1)
    threadpool_limits(1)
    sys.addaudithook(keep_out(truth))


def keep_out(truth: Path) -> Callable[[str, tuple[Any, ...]], None]:
    """Audit hook that refuses to open anything in a folder."""
    closed = os.path.join(os.path.abspath(truth), "")

    def hook(event: str, args: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(args[0], str) and os.path.abspath(args[0]).startswith(closed):
            raise PermissionError(f"{args[0]}: only the scorer opens the truth")

    return hook
