"""Threads of a vector step: several where they are faster, one where they would wait for each other."""

from collections.abc import Callable, Iterator

import numba
import numpy as np
import pytest

from homeward.envs.threads import Threads

ONE_S = {4096: 400e-6, 256: 25e-6}
Load = Callable[[np.random.Generator], Iterator[tuple[float, float]]]


def quiet(rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    """Several threads take 0.6 of the time of one, and both now and then wait for the system."""
    while True:
        pause = 20.0 * (rng.random() < 1e-3)
        yield 1.0 + pause, 0.6 + pause


def busy(rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    """Several wait for the one that is kept from running: four times as long on average, some steps a hundred times."""
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
    """Seconds of so many steps as chosen and on one thread, and the share of them that several took."""
    threads, costs = Threads(missions), load(np.random.default_rng(missions))
    chosen_s = one_s = several = 0.0
    for one, many in (next(costs) for _ in range(steps)):
        took_s = ONE_S[missions] * (many if threads.number > 1 else one)
        several += threads.number > 1
        threads.took(took_s)
        chosen_s, one_s = chosen_s + took_s, one_s + ONE_S[missions] * one
    return chosen_s, one_s, several / steps


@pytest.fixture(autouse=True)
def two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba, "get_num_threads", lambda: 2)


@pytest.mark.parametrize("missions", ONE_S)
@pytest.mark.parametrize("load", [quiet, busy, crowded, a_little_slower, in_turn])
def test_it_takes_hardly_longer_than_one_thread_beside_any_load(missions: int, load: Load) -> None:
    chosen_s, one_s, _ = drive(missions, load, 200_000)
    assert chosen_s < one_s / 0.9


@pytest.mark.parametrize("missions", ONE_S)
def test_on_a_quiet_machine_several_step(missions: int) -> None:
    chosen_s, one_s, several = drive(missions, quiet, 100_000)
    assert several > 0.9
    assert chosen_s < 0.7 * one_s


@pytest.mark.parametrize("missions", ONE_S)
def test_several_are_tried_again_when_a_load_is_gone(missions: int) -> None:
    def gone(rng: np.random.Generator) -> Iterator[tuple[float, float]]:
        source = busy(rng)
        yield from (next(source) for _ in range(50_000))
        yield from quiet(rng)

    *_, several = drive(missions, gone, 500_000)
    assert several > 0.7


@pytest.mark.parametrize(("missions", "most"), [(256, 2), (4096, 16), (1000, 7)])
def test_a_machine_of_many_cores_gives_no_more_threads_than_a_batch_is_worth(
    missions: int, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba, "get_num_threads", lambda: 16)
    threads = Threads(missions)
    while threads.number == 1:
        threads.took(1e-4)
    assert (threads.number, threads.restricted) == (most, most < 16)


def test_one_thread_is_all_there_is_where_numba_has_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba, "get_num_threads", lambda: 1)
    threads = Threads(4096)
    for _ in range(10_000):
        threads.took(1e-3)
        assert threads.number == 1
