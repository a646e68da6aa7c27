"""Change points: levels of an effect that change at unknown moments or places, found from the
residual of a refit.

A load that follows a known shape (constant watts, rolling force, the whole load) but changes its
size is cut into stretches of constant size by exact penalised segmentation (PELT: Killick,
Fearnhead & Eckley, 2012), and stretches of about the same size become one level. The search works
on blocks with equal sums of the squared shape, so that all of them have equal weight.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, pairwise
from typing import Literal, NamedTuple

import numpy as np
import ruptures
from scipy.stats import mannwhitneyu

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import WINDOW_S
from homeward.logs.channels import Array, Index, Mask

Axis = Literal["time", "place"]
Changes = Literal[
    "standing", "moving", "between runs", "once", "repeatedly", "in the cold", "in the heat"
]

# windows: as far as a change is refined, and the largest error of its moment
_AROUND = 2 * thresholds.SHORTEST_LEVEL
_MOST_BLOCKS = 3000  # by time; chosen: bounds the time that a search takes
# penalties: shares of the squared residual; chosen: about threefold each
SHARES = (0.1, 0.03, 0.01, 0.003, 0.001)
# blocks along the way; chosen: 75 or 300 change no test of change_points, proof and explanation
_PLACES = 150
_KNOTS = (6, 12, 24)  # hats of the profiles; chosen: coarse to fine by factors of two


@dataclass(frozen=True)
class Schedule:
    """A piecewise constant size of an effect: level of each window, shape (windows,), 0 the
    reference level."""

    axis: Axis
    level: Index
    levels: int
    changes: int  # moments or places at which it changes
    apart: float  # distance of its levels, in standard deviations of their residual
    found_by: tuple[float, ...]  # penalties (see `SHARES`) with which it is found
    of_several: bool = False  # whether it is of one of several loads, whose sum has more levels

    @property
    def share(self) -> float:
        """The second largest penalty that finds it, if any: a search in a part of the windows then
        finds it too."""
        return self.found_by[:2][-1]

    def at_work(self) -> Array:
        """Whether each level beyond 0 is at work, shape (windows, levels - 1)."""
        return np.asarray((self.level[:, None] == np.arange(1, self.levels)).astype(np.float64))

    def from_the_first(self) -> Schedule:
        """The same with levels counted from that of the first window."""
        reference = int(self.level[0])
        return replace(self, level=_counted_from(reference, self.level))


def clearly_apart(schedule: Schedule | None) -> bool:
    """Whether the levels are separate: those of a schedule that fits autocorrelated noise are
    not."""
    return schedule is not None and schedule.apart > thresholds.FAR_APART


def profiles(runs: Runs) -> list[Array]:
    """Hat functions along the way from base, coarse to fine, shape (windows, hats) each: a basis of
    smooth profiles."""
    place_m = place_of(runs)
    if place_m is None:
        return []
    passed = (place_m - place_m.min())[:, None] / float(np.ptp(place_m))
    bases = []
    for knots in _KNOTS:
        from_knot = np.abs(passed * (knots - 1) - np.arange(knots))  # in distances between knots
        bases.append(np.maximum(1.0 - from_knot, 0.0))
    return bases


def may_change(how: Changes, schedule: Schedule, runs: Runs) -> bool:
    """Whether a schedule changes in the way that is typical for an effect."""
    is_on = schedule.level > 0
    if how == "in the cold":
        return may_change("repeatedly", schedule, runs) or _is_warmer(~is_on, runs)
    if how == "in the heat":
        return may_change("repeatedly", schedule, runs) or _is_warmer(is_on, runs)
    changes = _changes_within_runs(schedule, runs)
    if how == "between runs":
        return most_in_a_run(schedule, runs) == 0
    if how == "once":
        return most_in_a_run(schedule, runs) <= 1
    if how == "repeatedly":
        step = np.diff(schedule.level)
        switched_on = changes[step[changes] > 0]
        runs_with_switch = len(np.unique(runs.run[switched_on]))
        often = (
            runs_with_switch >= thresholds.FEWEST_RUNS or len(changes) >= thresholds.FEWEST_SWITCHES
        )
        return most_in_a_run(schedule, runs) > 1 and often
    stops = np.abs(runs.context["speed_mps"]) < thresholds.STOPS_MPS
    at_standstill = [_is_at_a_stop(int(change), stops, runs) for change in changes]
    if how == "standing":
        return all(at_standstill)
    return not at_standstill or not all(at_standstill)


def most_in_a_run(schedule: Schedule, runs: Runs) -> int:
    """Changes of a schedule within the run in which it changes most often."""
    changes = _changes_within_runs(schedule, runs)
    return int(np.bincount(runs.run[changes], minlength=1).max())


def _changes_within_runs(schedule: Schedule, runs: Runs) -> Index:
    """Windows before each change of a schedule but those from one run to the next."""
    changes = np.diff(schedule.level) != 0
    within_run = np.diff(runs.run) == 0
    return np.flatnonzero(changes & within_run)


def _is_at_a_stop(change: int, stops: Mask, runs: Runs) -> bool:
    """Whether the robot stops in its run as close to a window as a change is found."""
    near = np.abs(runs.time_s - runs.time_s[change]) <= _AROUND * WINDOW_S
    return bool(stops[near & (runs.run == runs.run[change])].any())


def _is_warmer(here: Mask, runs: Runs) -> bool:
    """Whether the air is warmer in some windows, shape (windows,), than in most others."""
    temperature_c = runs.context["temperature_c"]
    # The Mann-Whitney statistic counts the pairs of which the window here is the warmer one.
    pairs_warmer = mannwhitneyu(
        temperature_c[here], temperature_c[~here], nan_policy="omit"
    ).statistic
    all_pairs = np.count_nonzero(here) * np.count_nonzero(~here)
    return bool(pairs_warmer >= thresholds.NEARLY_ALL * all_pairs)


def place_of(runs: Runs) -> Array | None:
    """Way from base to each window along the route, m; None where it is unknown or no place is
    revisited."""
    place_m = runs.context.get("place_m")
    if place_m is None or not np.isfinite(place_m).all():
        return None
    driven_m = float(np.abs(runs.context["speed_mps"] * runs.duration_s).sum())
    extent_m = float(np.ptp(place_m))
    is_revisited = extent_m > 0.0 and driven_m >= thresholds.REVISITED * extent_m
    return place_m if is_revisited else None


def search(
    axis: Axis, shape: Array, residual: Array, runs: Runs, signed: bool, shares: Sequence[float] = SHARES,
    several: bool = False,
) -> list[Schedule]:  # fmt: skip
    """Find the change points of a load's size, in time or on the way from base: schedules of few
    changes to many.

    The `residual`, W or A, is modelled as the size times `shape`, (windows,) each. A change must
    explain such `shares` of its square, the largest first; their number is chosen later, by BIC
    with the autocorrelation of each residual. Unless `signed`, the lowest size counts as none. By
    place nothing is found where no place is revisited. Of `several` loads that are each on or off,
    each schedule of more levels is followed by those that one of them may have.
    """
    square = float(residual @ residual)
    parts = _parts(axis, runs)
    if not parts or square == 0.0 or float(shape @ shape) == 0.0:
        return []
    blocks = _cut(parts, shape, residual, _most_blocks(axis, len(residual)))
    if len(blocks.lengths) < thresholds.FEWEST_VALUES:
        return []
    schedules: list[Schedule] = []
    for share in shares:
        level, levels = _levels(blocks, share * square, signed)
        if levels < 2:
            continue
        exact = _refined(level, shape, residual, parts)
        same = [
            index for index, schedule in enumerate(schedules) if _is_same(schedule, exact, levels)
        ]
        if same:
            schedule = schedules[same[0]]
            schedules[same[0]] = replace(schedule, found_by=(*schedule.found_by, share))
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


def _parts(axis: Axis, runs: Runs) -> list[Index]:
    """Windows in the order of each run's time, or all in the order of places; none where no place
    is revisited."""
    if axis == "time":
        return [np.flatnonzero(runs.run == run) for run in np.unique(runs.run)]
    place_m = place_of(runs)
    if place_m is None:
        return []
    return [np.argsort(place_m, kind="stable")]


def _most_blocks(axis: Axis, windows: int) -> int:
    if axis == "place":
        return _PLACES
    return min(windows // thresholds.SHORTEST_LEVEL, _MOST_BLOCKS)


class _Blocks(NamedTuple):
    """Blocks of windows between which the size may change, part after part."""

    order: Index  # windows, in the order of the parts
    lengths: Index  # (blocks,), windows of each
    part_begins: Index  # block with which each part begins but the first
    moment: Array  # (blocks,), sum of shape times residual
    mass: Array  # (blocks,), sum of the squared shape; moment over mass is the best size


def _cut(parts: Sequence[Index], shape: Array, residual: Array, most_blocks: int) -> _Blocks:
    """Cut the parts into about so many blocks that hold equal sums of the squared shape."""
    weight = float(shape @ shape)
    lengths_of_parts = []
    for part in parts:
        share_of_weight = float(shape[part] @ shape[part]) / weight
        first_windows = _first_windows(shape[part], max(1, round(most_blocks * share_of_weight)))
        lengths_of_parts.append(np.diff(first_windows, append=len(part)))
    order = np.concatenate(parts)
    lengths = np.concatenate(lengths_of_parts)
    first_window = np.cumsum(lengths) - lengths
    mass = np.add.reduceat((shape * shape)[order], first_window)
    return _Blocks(
        order=order,
        lengths=lengths,
        part_begins=np.cumsum([len(of_part) for of_part in lengths_of_parts])[:-1],
        moment=np.add.reduceat((shape * residual)[order], first_window),
        mass=np.maximum(mass, 1e-300),
    )


def _levels(blocks: _Blocks, penalty: float, signed: bool) -> tuple[Index, int]:
    """Level of each window and the number of levels, by a search in the blocks."""
    moments = np.split(blocks.moment, blocks.part_begins)
    masses = np.split(blocks.mass, blocks.part_begins)
    sizes = [_sizes(moment, mass, penalty) for moment, mass in zip(moments, masses, strict=True)]
    level_of_block, levels = _cluster(np.concatenate(sizes), blocks.mass, penalty, signed)
    level = np.zeros(len(blocks.order), dtype=np.intp)
    level[blocks.order] = np.repeat(level_of_block, blocks.lengths)
    return level, levels


def _is_same(schedule: Schedule, level: Index, levels: int) -> bool:
    """Whether a schedule has about these levels: a switch more may be of a few windows of the
    rarest."""
    rarest = np.bincount(schedule.level).min()
    differ = np.count_nonzero(schedule.level != level)
    return schedule.levels == levels and bool(differ <= thresholds.SAME_SCHEDULE * rarest)


def _of_one_load(schedule: Schedule, parts: Sequence[Index]) -> Iterator[Schedule]:
    """A schedule and, of more than two levels, those of a load that is on in some of its higher
    levels."""
    yield schedule
    if schedule.levels == 2:
        return
    higher = range(1, schedule.levels)
    for count in higher:
        for levels_on in combinations(higher, count):
            on = np.isin(schedule.level, levels_on).astype(np.intp)
            yield replace(
                schedule, level=on, levels=2, changes=_changes(on, parts), of_several=True
            )


def _changes(level: Index, parts: Sequence[Index]) -> int:
    """Changes of a level within the parts, and parts that begin neither at the reference nor as the
    last ended."""
    changes = 0
    end_of_last = 0
    for part in parts:
        level_in_part = level[part]
        if int(level_in_part[0]) not in (0, end_of_last):
            changes += 1
        changes += int(np.count_nonzero(np.diff(level_in_part)))
        end_of_last = int(level_in_part[-1])
    return changes


def _first_windows(shape: Array, count: int) -> Index:
    """First window of each of `count` blocks (or fewer) that hold equal parts of the squared
    shape."""
    reached = np.cumsum(shape * shape)
    if reached[-1] == 0.0:
        return np.zeros(1, dtype=np.intp)
    block = (reached / reached[-1] * count).astype(np.intp)
    block = np.minimum(block, count - 1)
    return np.flatnonzero(np.diff(block, prepend=-1))


def _sizes(moment: Array, weight: Array, penalty: float) -> Array:
    """Size of each block, constant over stretches that reduce the squared error by more than their
    penalty."""
    ends = [len(moment)]
    if len(moment) > 1:  # the search takes no single block
        # Of blocks of the same weight its squared error is that of the residual, but for a
        # constant.
        whitened = moment / np.sqrt(weight)
        search = ruptures.KernelCPD(kernel="linear", min_size=1).fit(whitened[:, None])
        ends = search.predict(pen=max(penalty, 1e-300))
    size = np.empty(len(moment))
    for start, end in pairwise([0, *ends]):
        size[start:end] = moment[start:end].sum() / weight[start:end].sum()
    return size


def _cluster(size: Array, weight: Array, penalty: float, signed: bool) -> tuple[Index, int]:
    """Level of each block and the number of levels: sorted sizes, cut where the gain exceeds the
    penalty."""
    distinct, which, times = np.unique(size, return_inverse=True, return_counts=True)
    mean = float(np.average(size, weights=weight))
    total = float((weight * (size - mean) ** 2).sum())
    level = np.zeros(len(size), dtype=np.intp)
    levels = 1
    explained = 0.0
    most_levels = min(thresholds.MOST_LEVELS, len(distinct))
    for count, groups in enumerate(_groups(distinct, times, most_levels), start=2):
        number = groups[which]
        centre = np.bincount(number, weight * size) / np.bincount(number, weight)
        remaining = float((weight * (size - centre[number]) ** 2).sum())
        gain = total - remaining - explained
        if gain <= penalty or gain < thresholds.SMALLEST_GAIN_TO_NAME * explained:
            break
        level = number
        levels = count
        explained += gain
    if signed and levels > 1:  # the most frequent level is the reference
        reference = int(np.argmax(np.bincount(level, weight, minlength=levels)))
        level = _counted_from(reference, level)
    return level, levels


def _counted_from(reference: int, level: Index) -> Index:
    """Levels with the reference as 0 and the others in their order."""
    return np.where(level == reference, 0, np.where(level < reference, level + 1, level))


def _groups(value: Array, times: Index, most: int) -> Iterator[Index]:
    """Group of each of n ascending values, in 2 to `most` groups: k-means, the least squared
    distance to their means.

    Exact, by dynamic programming over the ends of groups; `times`, shape (n,), is how often each
    value occurs.
    """
    centred = value - np.average(value, weights=times)
    # Sums over the values before each.
    count = np.append(0.0, np.cumsum(times))
    total = np.append(0.0, np.cumsum(times * centred))
    square = np.append(0.0, np.cumsum(times * centred**2))
    # Squared distance to their mean of the values from one (rows) to before another (columns).
    count_between = np.maximum(count - count[:, None], 1.0)
    distance = square - square[:, None] - (total - total[:, None]) ** 2 / count_between
    distance[np.tril_indices(len(count))] = np.inf
    least_distance = distance[0]  # of all values before each, in so many groups
    starts_of_last = []  # of the last group, for each number of groups
    for _ in range(2, most + 1):
        with_one_more = least_distance[:, None] + distance
        starts_of_last.append(with_one_more.argmin(axis=0))
        least_distance = with_one_more.min(axis=0)
        ends = [len(value)]
        for start in reversed(starts_of_last):
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
    """The levels with each change moved to the window where it fits best, half-way to the next
    change at most."""
    levels = int(level.max()) + 1
    weight = np.maximum(np.bincount(level, shape * shape, minlength=levels), 1e-300)
    size = np.bincount(level, shape * residual, minlength=levels) / weight
    exact = level.copy()
    for part in parts:
        changes = 1 + np.flatnonzero(np.diff(level[part]))
        if len(changes) == 0:
            continue
        half_way = (changes[1:] + changes[:-1]) // 2
        limits = np.concatenate(([0], half_way, [len(part)]))
        for change, from_limit, to_limit in zip(changes, limits[:-1], limits[1:], strict=True):
            around = part[max(from_limit, change - _AROUND) : min(to_limit, change + _AROUND)]
            level_before = level[part[change - 1]]
            level_after = level[part[change]]
            error_before = (residual[around] - size[level_before] * shape[around]) ** 2
            error_after = (residual[around] - size[level_after] * shape[around]) ** 2
            # Error of a change at each of these windows, less that of a change at the first.
            missed = np.concatenate(([0.0], np.cumsum(error_before - error_after)))
            # the middle of those with equal error
            change_at = int(np.median(np.flatnonzero(missed == missed.min())))
            exact[around[:change_at]] = level_before
            exact[around[change_at:]] = level_after
    return exact
