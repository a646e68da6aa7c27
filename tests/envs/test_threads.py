"""Threads of a vector step: several where they are faster, one where they would wait for each
other."""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numba
import numpy as np
import pytest

from homeward.envs import threads as threads_module
from homeward.envs.threads import Threads
from homeward.envs.vector import HomewardVectorEnv

ONE_S = {4096: 400e-6, 256: 25e-6}
"""Time of a step of so many missions on one thread, and below, number of steps in a test: 10 s and
2 s of them."""
STEPS = {4096: 25_000, 256: 80_000}
Load = Callable[[np.random.Generator], Iterator[tuple[float, float]]]


def quiet(rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    """Several threads take 0.6 of the time of one, and both now and then wait for the system."""
    while True:
        pause = 20.0 * (rng.random() < 1e-3)
        yield 1.0 + pause, 0.6 + pause


def busy(rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    """Several wait for the one that is kept from running: four times as long on average, some steps
    a hundred times."""
    while True:
        yield 1.0, 1.0 + 100.0 * (rng.random() < 0.03)


def crowded(rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    """One thread is kept from running too; several nearly always."""
    while True:
        yield 1.0 + 60.0 * (rng.random() < 0.02), 0.6 + 120.0 * (rng.random() < 0.5)


def a_little_slower(rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    """Waking the others takes as long as they save, and a fifth more."""
    while True:
        yield rng.uniform(0.9, 1.1), rng.uniform(1.1, 1.3)


def in_turn(rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    """Loads that come and go, some as soon as several threads are trusted."""
    while True:
        for load in (quiet, busy, crowded, quiet, a_little_slower):
            source = load(rng)
            yield from (next(source) for _ in range(int(rng.integers(300, 3000))))


def drive(missions: int, load: Load, steps: int) -> tuple[float, float, float]:
    """Seconds of so many steps as chosen and on one thread, and the share of them that several
    took."""
    threads, costs = Threads(missions), load(np.random.default_rng(missions))
    chosen_s = one_s = several = 0.0
    for one, many in (next(costs) for _ in range(steps)):
        took_s = ONE_S[missions] * (many if threads.number > 1 else one)
        several += threads.number > 1
        threads.record(took_s)
        chosen_s, one_s = chosen_s + took_s, one_s + ONE_S[missions] * one
    return chosen_s, one_s, several / steps


@pytest.fixture(autouse=True)
def two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba, "get_num_threads", lambda: 2)


@pytest.mark.parametrize("missions", ONE_S)
@pytest.mark.parametrize("load", [quiet, busy, crowded, a_little_slower, in_turn])
def test_it_takes_hardly_longer_than_one_thread_beside_any_load(missions: int, load: Load) -> None:
    chosen_s, one_s, _ = drive(missions, load, STEPS[missions])
    assert chosen_s < one_s / 0.9


@pytest.mark.parametrize("missions", ONE_S)
def test_on_a_quiet_machine_several_step(missions: int) -> None:
    chosen_s, one_s, several = drive(missions, quiet, STEPS[missions])
    assert several > 0.9
    assert chosen_s < 0.7 * one_s


@pytest.mark.parametrize("missions", ONE_S)
def test_several_are_tried_again_when_a_load_is_gone(missions: int) -> None:
    def gone(rng: np.random.Generator) -> Iterator[tuple[float, float]]:
        source = busy(rng)
        yield from (next(source) for _ in range(STEPS[missions] // 4))
        yield from quiet(rng)

    *_, several = drive(missions, gone, 2 * STEPS[missions])
    assert several > 0.7


@pytest.mark.parametrize(("missions", "most"), [(256, 2), (4096, 16), (1000, 7)])
def test_a_machine_of_many_cores_gives_no_more_threads_than_a_batch_is_worth(
    missions: int, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba, "get_num_threads", lambda: 16)
    threads = Threads(missions)
    while threads.number == 1:
        threads.record(1e-4)
    assert threads.number == most


def test_one_thread_is_all_there_is_where_numba_has_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(numba, "get_num_threads", lambda: 1)
    threads = Threads(4096)
    for _ in range(10_000):
        threads.record(1e-3)
        assert threads.number == 1


def test_a_copy_finds_out_anew_what_its_machine_gives() -> None:
    env = HomewardVectorEnv(256)
    assert env.batch.threads is not None
    env.batch.threads.number = 16
    copied = pickle.loads(pickle.dumps(env))
    assert copied.batch.threads.number == 1


@pytest.mark.skipif(not hasattr(os, "fork"), reason="nothing forks here")
def test_a_forked_process_steps_on_one_thread(root: Path) -> None:
    """OpenMP would end it."""
    code = (
        "import os, sys; from homeward.envs.vector import HomewardVectorEnv; env = HomewardVectorEnv(256)\n"
        "env.reset(seed=0); env.batch.threads.number = 2; env.step(env.action_space.sample())\n"
        "child = os.fork(); env.batch.threads.number = 2; env.step(env.action_space.sample())\n"
        "sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) if child else 0)"
    )
    environment = os.environ | {"NUMBA_NUM_THREADS": "2"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=root, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("layer", ["workqueue", "omp"])
def test_envs_of_several_threads_of_a_program_step_side_by_side(root: Path, layer: str) -> None:
    code = (
        "import threading; from homeward.envs.vector import HomewardVectorEnv\n"
        "def drive():\n"
        "    env = HomewardVectorEnv(512, difficulty='known'); env.reset(seed=0)\n"
        "    for _ in range(300):\n"
        "        env.batch.threads.number = 2; env.step(env.action_space.sample())\n"
        "threads = [threading.Thread(target=drive) for _ in range(2)]\n"
        "[thread.start() for thread in threads]; [thread.join() for thread in threads]; print('home')"
    )
    environment = os.environ | {"NUMBA_NUM_THREADS": "2", "NUMBA_THREADING_LAYER": layer}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=root, env=environment, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, "home\n"), done.stderr


def test_the_start_of_threads_keeps_the_number_that_torch_was_given(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both share the OpenMP threads of a process, and numba's start sets how many there are."""
    shared = {"threads": 1}
    torch = SimpleNamespace(
        get_num_threads=lambda: shared["threads"],
        set_num_threads=lambda number: shared.update(threads=number),
    )
    started = SimpleNamespace(get_num_threads=lambda: shared.update(threads=2) or 2)
    monkeypatch.setitem(sys.modules, "torch", torch)
    monkeypatch.setattr(threads_module, "numba", started)
    Threads(4096)
    assert shared["threads"] == 1
