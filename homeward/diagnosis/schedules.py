"""When something was at work: levels that change at unknown moments or places, found from what the refit leaves.

A load that follows a known shape (constant watts, rolling force, the whole load) but changes its size is cut into
stretches of constant size by exact penalised segmentation (PELT: Killick, Fearnhead & Eckley, 2012), and stretches of
about the same size become one level.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import ruptures  # type: ignore[import-untyped]
from numpy.typing import NDArray

from homeward.diagnosis.replay import Runs
from homeward.diagnosis.signals import Array

Axis = Literal["time", "place"]

_SHORTEST = 4  # windows in a block
_MOST_BLOCKS = 1500
_FEWEST_BLOCKS = 8
_SHARES = (0.1, 0.03, 0.01, 0.003, 0.001)  # of the squared residual that a change must explain
_MOST_LEVELS = 4
_PLACES = 150
_PASSES = 1.8  # places are told from times only where the robot comes by again


@dataclass(frozen=True)
class Schedule:
    """Level of each window, shape (windows,): 0 is the level that the others are counted from."""

    axis: Axis
    level: NDArray[np.intp]
    levels: int
    changes: int  # moments or places at which it changes

    def columns(self, shape: Array) -> Array:
        """The shape at each level beyond 0, shape (windows, levels - 1)."""
        columns: Array = shape[:, None] * (self.level[:, None] == np.arange(1, self.levels))
        return columns


def in_time(shape: Array, residual: Array, runs: Runs, *, signed: bool) -> list[Schedule]:
    """Find when the size of a shape changes within or between runs: schedules of few changes to many.

    How many changes are real is for the comparison of models to say, which knows the memory of what each one leaves.

    Args:
        shape: What the size multiplies, shape (windows,).
        residual: What the refit leaves, shape (windows,).
        runs: The runs.
        signed: Whether sizes below the usual one are possible; otherwise the lowest counts as none.
    """
    length = max(_SHORTEST, -(-len(residual) // _MOST_BLOCKS))
    block = np.empty(len(residual), dtype=np.intp)
    groups: list[NDArray[np.intp]] = []
    following = 0
    for run in np.unique(runs.run):
        inside = np.flatnonzero(runs.run == run)
        count = max(1, len(inside) // length)
        block[inside] = following + np.arange(len(inside)) * count // len(inside)
        groups.append(following + np.arange(count))
        following += count
    return _schedules("time", shape, residual, block, groups, signed)


def by_place(shape: Array, residual: Array, runs: Runs, *, signed: bool) -> list[Schedule]:
    """Find where along the way from base the size of a shape changes; nothing where no place is met twice."""
    place_m = runs.context.get("base_distance_m")
    if place_m is None or not np.isfinite(place_m).all():
        return []
    driven_m = float(np.abs(runs.context["speed_mps"] * runs.duration_s).sum())
    extent_m = float(np.ptp(place_m))
    if extent_m <= 0.0 or driven_m < _PASSES * extent_m:
        return []
    bins = max(2, min(_PLACES, len(residual) // (2 * _SHORTEST)))
    block = np.minimum((place_m - place_m.min()) / extent_m * bins, bins - 1).astype(np.intp)
    return _schedules("place", shape, residual, block, [np.arange(bins)], signed)


class _Cost(ruptures.base.BaseCost):  # type: ignore[misc]
    """Squared error of one size for a stretch of blocks, from cumulative sums."""

    model = "size"
    min_size = 1

    def fit(self, signal: Array) -> _Cost:
        """Take (moment, weight) of each block, shape (blocks, 2)."""
        self.signal = signal
        self._sums = np.vstack([np.zeros(2), np.cumsum(signal, axis=0)]).tolist()
        return self

    def error(self, start: int, end: int) -> float:
        """Minus what the best size explains between two blocks."""
        (m0, w0), (m1, w1) = self._sums[start], self._sums[end]
        weight = w1 - w0
        return -((m1 - m0) ** 2) / weight if weight > 0.0 else 0.0


def _schedules(
    axis: Axis, shape: Array, residual: Array, block: NDArray[np.intp], groups: list[NDArray[np.intp]], signed: bool
) -> list[Schedule]:
    blocks = int(block.max()) + 1
    moment: Array = np.bincount(block, shape * residual, minlength=blocks).astype(np.float64)
    weight: Array = np.bincount(block, shape * shape, minlength=blocks).astype(np.float64)
    if not (weight > 0.0).any():
        return []
    weak = weight < 1e-3 * float(np.quantile(weight[weight > 0.0], 0.9))
    moment, weight = np.where(weak, 0.0, moment), np.where(weak, 0.0, weight)
    whole = float(residual @ residual)
    if np.count_nonzero(~weak) < _FEWEST_BLOCKS or whole == 0.0:
        return []
    found: list[Schedule] = []
    for share in _SHARES:
        penalty = share * whole
        stretch = _stretches(moment, weight, groups, penalty)
        sizes = np.bincount(stretch, moment).astype(np.float64), np.bincount(stretch, weight).astype(np.float64)
        level_of_stretch, levels = _cluster(*sizes, penalty, signed)
        level = level_of_stretch[stretch]
        if levels < 2 or any(np.array_equal(level[block], one.level) for one in found):
            continue
        changes = sum(int(np.count_nonzero(np.diff(level[group]))) for group in groups)
        changes += sum(int(level[group[0]] != 0) for group in groups)
        found.append(Schedule(axis, level[block], levels, changes))
    return found


def _stretches(moment: Array, weight: Array, groups: list[NDArray[np.intp]], penalty: float) -> NDArray[np.intp]:
    """Number of the stretch of constant size that each block belongs to."""
    stretch = np.zeros(len(moment), dtype=np.intp)
    following = 0
    for group in groups:
        ends = [len(group)]
        if len(group) > 1:
            search = ruptures.Pelt(custom_cost=_Cost(), min_size=1, jump=1)
            ends = search.fit(np.column_stack([moment[group], weight[group]])).predict(penalty)
        for start, end in pairwise([0, *ends]):
            stretch[group[start:end]] = following
            following += 1
    return stretch


def _cluster(moment: Array, weight: Array, penalty: float, signed: bool) -> tuple[NDArray[np.intp], int]:
    """Level of each stretch and the number of levels: stretches in order of size, cut where it pays."""
    known = np.flatnonzero(weight > 0.0)
    size = moment[known] / weight[known]
    order = known[np.argsort(size)]
    if len(order) < 2:
        return np.zeros(len(moment), dtype=np.intp), 1
    search = ruptures.Dynp(custom_cost=_Cost(), min_size=1, jump=1) if len(order) <= 200 else None
    signal = np.column_stack([moment[order], weight[order]])
    best_ends, best_cost = [len(order)], _Cost().fit(signal).error(0, len(order))
    for levels in range(2, min(_MOST_LEVELS, len(order)) + 1):
        chosen = search or ruptures.Binseg(custom_cost=_Cost(), min_size=1, jump=1)
        ends = chosen.fit(signal).predict(n_bkps=levels - 1)
        cost = sum(_Cost().fit(signal).error(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True))
        # A further level must explain a good part of what the ones so far leave, not only be beyond the noise.
        if cost + penalty < best_cost and (levels == 2 or best_cost - cost > 0.1 * abs(best_cost)):
            best_ends, best_cost = ends, cost
    number = np.zeros(len(moment), dtype=np.intp)
    for index, (start, end) in enumerate(zip([0, *best_ends[:-1]], best_ends, strict=True)):
        number[order[start:end]] = index
    levels = len(best_ends)
    if signed and levels > 1:  # the level met most is the usual one
        usual = int(np.argmax(np.bincount(number[known], weight[known], minlength=levels)))
        number = np.where(number == usual, 0, np.where(number < usual, number + 1, number))
    return number, levels
