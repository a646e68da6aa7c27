"""Blocks of windows, which count as independent in a bootstrap, and folds, which cross-validation
holds out."""

from typing import Literal

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.autocorrelation import correlation_windows
from homeward.logs.channels import Array, Index

_MOST_BLOCKS = 2000  # about; chosen: signs of so many in 8,000 draws (residual_test) take 128 MB
_MOST_FOLDS = 10  # of whole runs; chosen: ten, as is common
FOLDS = 5
"""Of blocks or stretches, where whole runs are too few or not held out. Chosen: as is common, a
fifth is held out."""


def cut_blocks(run: Index, residual: Array | None = None) -> Index:
    """Block number of each window, shape (windows,): within one run, and longer than the residual's
    autocorrelation.

    Blocks are shortened where fewer than `FEWEST_BLOCKS` would remain.
    """
    correlation = 0.0 if residual is None else correlation_windows(residual, run)
    uncorrelated = int(np.ceil(thresholds.CORRELATION_TIMES * correlation))
    wanted = max(thresholds.SHORTEST_BLOCK, len(run) // _MOST_BLOCKS, uncorrelated)
    # The number of blocks is rounded in each run, which may lose one.
    longest = len(run) // (thresholds.FEWEST_BLOCKS + len(np.unique(run)))
    length = max(thresholds.SHORTEST_BLOCK, min(wanted, longest))
    _, start, number, windows = np.unique(
        run, return_index=True, return_inverse=True, return_counts=True
    )
    blocks = np.maximum(np.rint(windows / length), 1).astype(np.intp)  # of each run
    previous_blocks = np.cumsum(blocks) - blocks
    since_start = np.arange(len(run)) - start[number]
    block_of_run = since_start * blocks[number] // windows[number]
    return np.asarray(previous_blocks[number] + block_of_run)


def per_block(values: Array, block: Index) -> Array:
    """Sums over blocks of `values`, shape (windows, columns): (blocks, columns)."""
    sums = np.zeros((int(block.max()) + 1, values.shape[1]))
    np.add.at(sums, block, values)
    return sums


def cut_stretches(run: Index) -> Index:
    """Number within its run of each window's stretch of `SHORTEST_LEVEL` windows, shape
    (windows,)."""
    start = np.searchsorted(run, run)
    return (np.arange(len(run)) - start) // thresholds.SHORTEST_LEVEL


def cut_folds(runs: Runs, block: Index) -> tuple[Index, Literal["run", "block"]]:
    """Fold of each window, shape (windows,), and its kind: whole runs or, of fewer than three,
    series of blocks."""
    count = len(runs.signals)
    if count > _MOST_FOLDS:
        return runs.run % _MOST_FOLDS, "run"
    if count >= thresholds.FEWEST_RUNS:
        return runs.run, "run"
    blocks = int(block.max()) + 1
    folds = min(FOLDS, blocks)
    return block * folds // blocks, "block"
