"""Blocks outlast the autocorrelation of a residual, and folds hold out whole runs where there are
enough."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward import Robot
from homeward.diagnosis import Recording
from homeward.diagnosis.fit.folds import cut_blocks, cut_folds, cut_stretches, per_block
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.thresholds import FEWEST_BLOCKS
from homeward.logs.channels import Index
from tests.diagnosis.made_up import autoregressive

ONE_RUN: Index = np.zeros(20_000, dtype=np.intp)


def in_runs(lengths: list[int]) -> Index:
    return np.repeat(np.arange(len(lengths)), lengths)


@given(
    lengths=st.lists(st.integers(1, 400), min_size=1, max_size=12), phi=st.sampled_from([0.0, 0.9])
)
def test_blocks_are_numbered_stretches_within_one_run(lengths: list[int], phi: float) -> None:
    run = in_runs(lengths)
    block = cut_blocks(run, autoregressive(phi, len(run)))
    assert block[0] == 0 and set(np.diff(block).tolist()) <= {0, 1}
    assert all(len(np.unique(run[block == one])) == 1 for one in np.unique(block))


@pytest.mark.parametrize("phi", [0.0, 0.9])
def test_sums_over_blocks_hardly_correlate(phi: float) -> None:
    residual = autoregressive(phi, len(ONE_RUN))
    sums = per_block(residual[:, None], cut_blocks(ONE_RUN, residual))[:, 0]
    assert abs(np.corrcoef(sums[1:], sums[:-1])[0, 1]) < 0.15


def test_blocks_are_as_long_as_the_autocorrelation_needs_but_not_too_few() -> None:
    longer, plain = (cut_blocks(ONE_RUN, one) for one in (autoregressive(0.95, len(ONE_RUN)), None))
    assert longer.max() < plain.max() / 3
    drifting = cut_blocks(ONE_RUN[:400], np.linspace(-1.0, 1.0, 400))
    assert int(drifting.max()) + 1 >= FEWEST_BLOCKS


def test_sums_per_block_are_those_of_its_windows() -> None:
    values, block = np.arange(12.0).reshape(6, 2), np.array([0, 0, 1, 1, 1, 2])
    np.testing.assert_allclose(per_block(values, block), [[2.0, 4.0], [18.0, 21.0], [10.0, 11.0]])


def test_stretches_begin_anew_in_each_run() -> None:
    found = cut_stretches(in_runs([9, 5]))
    assert found[[0, 9]].tolist() == [0, 0]
    for run in (found[:9], found[9:]):
        assert set(np.diff(run).tolist()) == {0, 1}
    assert found[:5].tolist() == found[9:].tolist()


@pytest.mark.parametrize("count", [3, 12])
def test_folds_are_whole_runs_where_there_are_enough(
    count: int, drive: Callable[..., list[Recording]], husky: Robot
) -> None:
    (one,) = drive(husky, runs=1, minutes=0.5)
    runs = average(
        usable_runs(
            [dataclasses.replace(one, name=f"{i}", sha256=f"{i}") for i in range(count)], husky
        )[0]
    )
    fold, held_out_by = cut_folds(runs, cut_blocks(runs.run))
    assert held_out_by == "run" and len(fold) == len(runs.observed)
    assert all(len(np.unique(fold[runs.run == run])) == 1 for run in range(count))
    assert len(np.unique(fold)) == min(count, 10)
    assert np.ptp(np.bincount(fold)) <= len(runs.observed) / count


@pytest.mark.parametrize("count", [1, 2])
def test_folds_of_one_or_two_runs_are_series_of_blocks(count: int, short_runs: Runs) -> None:
    chosen = short_runs.run < count
    runs = dataclasses.replace(
        short_runs, signals=short_runs.signals[:count], run=short_runs.run[chosen]
    )
    block = cut_blocks(runs.run)
    fold, held_out_by = cut_folds(runs, block)
    assert held_out_by == "block" and len(fold) == int(chosen.sum())
    assert all(len(np.unique(fold[block == one])) == 1 for one in np.unique(block))
    assert set(np.diff(fold).tolist()) == {0, 1}  # one after the other
    assert np.bincount(fold).max() < 1.5 * np.bincount(fold).min()


def test_a_single_block_is_a_single_fold(short_runs: Runs) -> None:
    runs = dataclasses.replace(short_runs, signals=short_runs.signals[:1])
    assert cut_folds(runs, np.zeros(5, dtype=np.intp))[0].tolist() == [0] * 5
