"""Change points: levels of an effect that change at unknown moments or places, found from the residual of a refit.

A load that follows a known shape (constant watts, rolling force, the whole load) but changes its size is cut into
stretches of constant size by exact penalised segmentation (PELT: Killick, Fearnhead & Eckley, 2012), and stretches of
about the same size become one level. The search works on blocks with equal sums of the squared shape, so that all of
them have equal weight.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, pairwise
from typing import Literal

import numpy as np
import ruptures
from scipy.stats import mannwhitneyu

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import WINDOW_S
from homeward.logs.channels import Array, Index, Mask

Axis = Literal["time", "place"]
Changes = Literal["standing", "moving", "between runs", "once", "repeatedly", "in the cold"]

_AROUND = 2 * thresholds.SHORTEST_LEVEL  # windows: as far as a change is refined, and the largest error of its moment
_MOST_BLOCKS = 3000  # by time; chosen: bounds the time that a search takes
SHARES = (0.1, 0.03, 0.01, 0.003, 0.001)  # penalties: shares of the squared residual; chosen: about threefold each
_PLACES = 150  # blocks along the way; chosen: 75 or 300 change no test of change_points, proof and explanation
_KNOTS = (6, 12, 24)  # hats of the profiles; chosen: coarse to fine by factors of two


@dataclass(frozen=True)
class Schedule:
    """A piecewise constant size of an effect: level of each window, shape (windows,), 0 the reference level."""

    axis: Axis
    level: Index
    levels: int
    changes: int  # moments or places at which it changes
    apart: float  # distance of its levels, in standard deviations of their residual
    found_by: tuple[float, ...]  # penalties (see `SHARES`) with which it is found
    of_several: bool = False  # whether it is of one of several loads, whose sum has more levels

    @property
    def share(self) -> float:
        """The second largest penalty that finds it, if any: a search in a part of the windows then finds it too."""
        return self.found_by[:2][-1]

    def at_work(self) -> Array:
        """Whether each level beyond 0 is at work, shape (windows, levels - 1)."""
        return np.asarray((self.level[:, None] == np.arange(1, self.levels)).astype(np.float64))

    def from_the_first(self) -> Schedule:
        """The same with levels counted from that of the first window."""
        first = int(self.level[0])
        return replace(self, level=np.where(self.level == first, 0, self.level + (self.level < first)))


def clearly_apart(schedule: Schedule | None) -> bool:
    """Whether the levels are separate: those of a schedule that fits autocorrelated noise are not."""
    return schedule is not None and schedule.apart > thresholds.FAR_APART


def profiles(runs: Runs) -> list[Array]:
    """Hat functions along the way from base, coarse to fine, shape (windows, hats) each: a basis of smooth profiles."""
    place_m = place_of(runs)
    if place_m is None:
        return []
    passed = (place_m - place_m.min())[:, None] / float(np.ptp(place_m))
    return [np.maximum(1.0 - np.abs(passed * (knots - 1) - np.arange(knots)), 0.0) for knots in _KNOTS]


def may_change(how: Changes, schedule: Schedule, runs: Runs) -> bool:
    """Whether a schedule changes in the way that is typical for an effect."""
    if how == "in the cold":
        return may_change("repeatedly", schedule, runs) or _is_colder(schedule.level > 0, runs)
    step, run = np.diff(schedule.level), runs.run
    changes = np.flatnonzero((step != 0) & (np.diff(run) == 0))  # within runs
    most_in_a_run = int(np.bincount(run[changes], minlength=1).max())
    if how == "between runs":
        return most_in_a_run == 0
    if how == "once":
        return most_in_a_run <= 1
    if how == "repeatedly":
        runs_with_switch = len(np.unique(run[changes[step[changes] > 0]]))
        often = runs_with_switch >= thresholds.FEWEST_RUNS or len(changes) >= thresholds.FEWEST_SWITCHES
        return most_in_a_run > 1 and often
    stops = np.abs(runs.context["speed_mps"]) < thresholds.STOPS_MPS
    at_standstill = []
    for change in changes:
        near = np.abs(runs.time_s - runs.time_s[change]) <= _AROUND * WINDOW_S
        at_standstill.append(bool(stops[near & (run == run[change])].any()))
    if how == "standing":
        return all(at_standstill)
    return not at_standstill or not all(at_standstill)


def _is_colder(on: Mask, runs: Runs) -> bool:
    """Whether the air is colder in windows where a load is on, shape (windows,), than in most others."""
    temperature_c = runs.context["temperature_c"]
    ranks = mannwhitneyu(temperature_c[~on], temperature_c[on], nan_policy="omit").statistic
    return bool(ranks >= thresholds.NEARLY_ALL * np.count_nonzero(on) * np.count_nonzero(~on))


def place_of(runs: Runs) -> Array | None:
    """Way from base to each window along the route, m; None where it is unknown or no place is revisited."""
    place_m = runs.context.get("place_m")
    if place_m is None or not np.isfinite(place_m).all():
        return None
    driven_m = float(np.abs(runs.context["speed_mps"] * runs.duration_s).sum())
    extent_m = float(np.ptp(place_m))
    return place_m if extent_m > 0.0 and driven_m >= thresholds.REVISITED * extent_m else None


def search(
    axis: Axis, shape: Array, residual: Array, runs: Runs, signed: bool, shares: Sequence[float] = SHARES,
    several: bool = False,
) -> list[Schedule]:  # fmt: skip
    """Find the change points of a load's size, in time or on the way from base: schedules of few changes to many.

    The `residual`, W or A, is modelled as the size times `shape`, (windows,) each. A change must explain such `shares`
    of its square, the largest first; their number is chosen later, by BIC with the autocorrelation of each residual.
    Unless `signed`, the lowest size counts as none. By place nothing is found where no place is revisited. Of `several`
    loads that are each on or off, each schedule of more levels is followed by those that one of them may have.
    """
    if axis == "time":
        parts = [np.flatnonzero(runs.run == run) for run in np.unique(runs.run)]
        blocks = min(len(residual) // thresholds.SHORTEST_LEVEL, _MOST_BLOCKS)
    else:
        place_m = place_of(runs)
        parts = [] if place_m is None else [np.argsort(place_m, kind="stable")]
        blocks = _PLACES
    square, weight = float(residual @ residual), float(shape @ shape)
    if square == 0.0 or weight == 0.0:
        return []
    cuts = []
    for part in parts:
        share_of_weight = float(shape[part] @ shape[part]) / weight
        cuts.append(_blocks(shape[part], max(1, round(blocks * share_of_weight))))
    if sum(len(cut) for cut in cuts) < thresholds.FEWEST_VALUES:
        return []
    order = np.concatenate(parts)
    ends = np.cumsum([len(cut) for cut in cuts])[:-1]  # of the parts, among all blocks
    lengths = np.concatenate([np.diff(cut, append=len(part)) for part, cut in zip(parts, cuts, strict=True)])
    starts = np.cumsum(lengths) - lengths
    # Of each block: sums of shape times residual and of shape squared; their ratio is its best size.
    moment = np.add.reduceat((shape * residual)[order], starts)
    mass = np.maximum(np.add.reduceat((shape * shape)[order], starts), 1e-300)
    schedules: list[Schedule] = []
    for share in shares:
        penalty = share * square
        sizes = [
            _sizes(of_part, its_mass, penalty)
            for of_part, its_mass in zip(np.split(moment, ends), np.split(mass, ends), strict=True)
        ]
        level_of_block, levels = _cluster(np.concatenate(sizes), mass, penalty, signed)
        if levels < 2:
            continue
        level = np.zeros(len(residual), dtype=np.intp)
        level[order] = np.repeat(level_of_block, lengths)
        exact = _refined(level, shape, residual, parts)
        same = next((index for index, schedule in enumerate(schedules) if _is_same(schedule, exact, levels)), None)
        if same is not None:
            schedules[same] = replace(schedules[same], found_by=(*schedules[same].found_by, share))
            continue
        schedules.append(
            Schedule(
                axis=axis,
                level=exact,
                levels=levels,
                changes=_changes(exact, parts),
                apart=_apart(exact, shape, residual),
                found_by=(share,),
            )
        )
    if not several:
        return schedules
    return list(chain.from_iterable(_of_one_load(schedule, parts) for schedule in schedules))


def _is_same(schedule: Schedule, level: Index, levels: int) -> bool:
    """Whether a schedule has about these levels: a switch more may be of a few windows of the rarest."""
    rarest = np.bincount(schedule.level).min()
    differ = np.count_nonzero(schedule.level != level)
    return schedule.levels == levels and bool(differ <= thresholds.SAME_SCHEDULE * rarest)


def _of_one_load(whole: Schedule, parts: Sequence[Index]) -> Iterator[Schedule]:
    """A schedule and, of more than two levels, those of a load that is on in some of its higher levels."""
    yield whole
    higher = range(1, whole.levels)
    for chosen in chain.from_iterable(combinations(higher, count) for count in higher if whole.levels > 2):
        on = np.isin(whole.level, chosen).astype(np.intp)
        yield replace(whole, level=on, levels=2, changes=_changes(on, parts), of_several=True)


def _changes(level: Index, parts: Sequence[Index]) -> int:
    """Changes of a level within the parts, and parts that begin neither at the reference nor as the last ended."""
    changes, last = 0, 0
    for part in parts:
        changes += int(level[part[0]]) not in (0, last)
        changes += int(np.count_nonzero(np.diff(level[part])))
        last = int(level[part[-1]])
    return changes


def _blocks(shape: Array, count: int) -> Index:
    """First window of each of `count` blocks (or fewer) that hold equal parts of the squared shape."""
    reached = np.cumsum(shape * shape)
    if reached[-1] == 0.0:
        return np.zeros(1, dtype=np.intp)
    number = np.minimum((reached / reached[-1] * count).astype(np.intp), count - 1)
    return np.flatnonzero(np.diff(number, prepend=-1))


def _sizes(moment: Array, weight: Array, penalty: float) -> Array:
    """Size of each block, constant over stretches that reduce the squared error by more than their penalty."""
    ends = [len(moment)]
    if len(moment) > 1:  # the search takes no single block
        search = ruptures.KernelCPD(kernel="linear", min_size=1).fit((moment / np.sqrt(weight))[:, None])
        ends = search.predict(pen=max(penalty, 1e-300))
    size = np.empty(len(moment))
    for start, end in pairwise([0, *ends]):
        size[start:end] = moment[start:end].sum() / weight[start:end].sum()
    return size


def _cluster(size: Array, weight: Array, penalty: float, signed: bool) -> tuple[Index, int]:
    """Level of each block and the number of levels: sorted sizes, cut where the gain exceeds the penalty."""
    distinct, which, times = np.unique(size, return_inverse=True, return_counts=True)
    mean = float(np.average(size, weights=weight))
    total = float((weight * (size - mean) ** 2).sum())
    level, levels = np.zeros(len(size), dtype=np.intp), 1
    explained = 0.0
    for count, groups in enumerate(_groups(distinct, times, min(thresholds.MOST_LEVELS, len(distinct))), start=2):
        number = groups[which]
        centre = np.bincount(number, weight * size) / np.bincount(number, weight)
        remaining = float((weight * (size - centre[number]) ** 2).sum())
        gain = total - remaining - explained
        if gain <= penalty or gain < thresholds.SMALLEST_GAIN_TO_NAME * explained:
            break
        level, levels, explained = number, count, explained + gain
    if signed and levels > 1:  # the most frequent level is the reference
        reference = int(np.argmax(np.bincount(level, weight, minlength=levels)))
        level = np.where(level == reference, 0, np.where(level < reference, level + 1, level))
    return level, levels


def _groups(value: Array, times: Index, most: int) -> Iterator[Index]:
    """Group of each of n ascending values, in 2 to `most` groups: k-means, the least squared distance to their means.

    Exact, by dynamic programming over the ends of groups; `times`, shape (n,), is how often each value occurs.
    """
    centred = value - np.average(value, weights=times)
    number, first, second = (np.append(0.0, np.cumsum(times * centred**power)) for power in range(3))
    # From which value (rows) to before which (columns).
    many = np.maximum(number - number[:, None], 1.0)
    distance = second - second[:, None] - (first - first[:, None]) ** 2 / many
    distance[np.tril_indices(len(number))] = np.inf
    least, starts = distance[0], []
    for _ in range(2, most + 1):
        total = least[:, None] + distance
        starts.append(total.argmin(axis=0))
        least = total.min(axis=0)
        ends = [len(value)]
        for start in reversed(starts):
            ends.append(int(start[ends[-1]]))
        yield np.searchsorted(ends[:0:-1], np.arange(len(value)), side="right")


def _apart(level: Index, shape: Array, residual: Array) -> float:
    """Smallest distance of two levels in standard deviations of their residual."""
    working = shape != 0.0
    weight = np.maximum(np.bincount(level, shape * shape), 1e-300)
    size = np.bincount(level, shape * residual) / weight
    spread = float(np.std((residual - size[level] * shape)[working])) or 1e-300
    typical = float(np.sqrt(np.mean(shape[working] ** 2)))
    return float(np.min(np.diff(np.sort(size)))) * typical / spread


def _refined(level: Index, shape: Array, residual: Array, parts: Sequence[Index]) -> Index:
    """The levels with each change moved to the window where it fits best, half-way to the next change at most."""
    levels = int(level.max()) + 1
    weight = np.maximum(np.bincount(level, shape * shape, minlength=levels), 1e-300)
    size = np.bincount(level, shape * residual, minlength=levels) / weight
    exact = level.copy()
    for part in parts:
        changes = 1 + np.flatnonzero(np.diff(level[part]))
        if len(changes) == 0:
            continue
        limits = np.concatenate(([0], (changes[1:] + changes[:-1]) // 2, [len(part)]))
        for change, first, last in zip(changes, limits[:-1], limits[1:], strict=True):
            around = part[max(first, change - _AROUND) : min(last, change + _AROUND)]
            level_before, level_after = level[part[change - 1]], level[part[change]]
            error_before = (residual[around] - size[level_before] * shape[around]) ** 2
            error_after = (residual[around] - size[level_after] * shape[around]) ** 2
            # Error of a change at each of these windows, less that of a change at the first.
            missed = np.concatenate(([0.0], np.cumsum(error_before - error_after)))
            change_at = int(np.median(np.flatnonzero(missed == missed.min())))  # the middle of those with equal error
            exact[around[:change_at]] = level_before
            exact[around[change_at:]] = level_after
    return exact
