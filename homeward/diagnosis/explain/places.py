"""Where and when a mismatch occurs or an effect is at work: stretches of the recordings and a
condition in words.

A condition on a channel is one split of its values, by least squares or by its overlap with the
stretches.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.hypothesis import Term
from homeward.diagnosis.explain.residual_test import TESTED, Dependence, ResidualChannel
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import WINDOW_S
from homeward.diagnosis.result import Place
from homeward.logs.channels import Array, Mask

WHOLE_RUN = "all of the run"
_DECIMALS = 6  # of a value: means of what is zero differ by rounding


@dataclass(frozen=True)
class Location:
    """The located condition: in words, for which windows it holds, and where that is in each
    recording."""

    condition: str
    inside: Mask  # (windows,)
    excess: Array  # (windows,), W or A above the rest
    places: tuple[Place, ...]

    @property
    def share(self) -> float:
        """Share of the whole excess that lies under the condition."""
        return min(1.0, sum(place.share_of_excess for place in self.places))


def locate(dependence: Dependence, runs: Runs) -> Location:
    """Find the split of a channel's values that separates the excess best, and describe it in
    words."""
    channel = dependence.channel
    if channel.name == "time_s":
        return _locate_in_time(dependence, runs)
    recorded = dependence.bin >= 0
    # A trace of a window in each bin: an empty one does not divide by zero.
    windows = (
        np.bincount(dependence.bin[recorded], minlength=len(dependence.effect)).astype(np.float64)
        + 1e-9
    )
    split, above = _best_split(dependence.effect, windows)
    # The mean of the two bin centres: the common edge may lie in the noise around a frequent value.
    limit = float(dependence.centre[split - 1 : split + 1].mean())
    values = np.nan_to_num(runs.context[channel.name])
    if channel.magnitude:
        values = np.abs(values)
    inside = recorded & _beyond(values, limit, above)
    bins = np.arange(len(windows))
    outside = bins < split if above else bins >= split
    level_of_rest = np.average(dependence.effect[outside], weights=windows[outside])
    excess = (
        np.where(recorded, dependence.effect[dependence.bin] - level_of_rest, 0.0)
        * dependence.weight
    )
    words = _words(channel, above, limit)
    share = _shares(excess, runs) * inside
    return Location(
        condition=words,
        inside=inside,
        excess=excess,
        places=_cut(inside, share, runs, words, pause_s=np.inf),
    )


def _beyond(values: Array, limit: float, above: bool) -> Mask:
    """Whether values are above a limit or, if not `above`, below it."""
    if above:
        return values > limit
    return values < limit


def _best_split(effect: Array, weight: Array) -> tuple[int, bool]:
    """First bin above the split with the largest sum of squares between its sides, and whether the
    upper side is chosen.

    The chosen side is the rarer one if the other is twice as large, or else the one where more is
    drawn than predicted.
    """
    weights = np.cumsum(weight)
    sums = np.cumsum(weight * effect)
    weight_below = weights[:-1]
    weight_above = weights[-1] - weight_below
    mean_above = (sums[-1] - sums[:-1]) / weight_above
    mean_below = sums[:-1] / weight_below
    difference = mean_above - mean_below
    between_sides = weight_below * weight_above * difference**2
    last_below = int(np.argmax(between_sides))

    size_below = weight_below[last_below]
    size_above = weight_above[last_below]
    # A clear minority is the condition, whether it draws more or less.
    is_exception = thresholds.TWICE * min(size_below, size_above) < max(size_below, size_above)
    upper = size_above < size_below if is_exception else difference[last_below] > 0.0
    return last_below + 1, bool(upper)


def _plain(value: float) -> str:
    """A value to two significant digits.

    >>> _plain(0.20417), _plain(412.0), _plain(-0.0)
    ('0.2', '410', '0')
    """
    return np.format_float_positional(
        value + 0.0, precision=2, unique=False, fractional=False, trim="-"
    )


def _locate_in_time(dependence: Dependence, runs: Runs) -> Location:
    """The stretches of each run that lie furthest from the level of all runs."""
    effect = dependence.effect
    windows = np.bincount(dependence.bin, minlength=len(effect)).astype(np.float64)
    median = float(np.quantile(effect, 0.5, weights=windows, method="inverted_cdf"))
    deviation = np.abs(effect - median)
    far = deviation > thresholds.HALF * np.max(deviation)
    near = ~far
    level_of_rest = np.average(effect[near], weights=windows[near]) if near.any() else median
    excess = (effect - level_of_rest)[dependence.bin] * dependence.weight
    inside = far[dependence.bin]
    return Location(
        condition="in some stretches of time",
        inside=inside,
        excess=excess,
        places=_cut(inside, _shares(excess, runs), runs, condition=None),
    )


def stretches(inside: Mask, runs: Runs, pause_s: float = 0.0) -> Iterator[tuple[int, slice]]:
    """Run and windows of each stretch; a stretch continues over pauses that are shorter than
    this."""
    for run in range(len(runs.signals)):
        windows = np.flatnonzero(inside & (runs.run == run))
        if not len(windows):
            continue
        is_interrupted = np.diff(windows) > 1
        is_pause = np.diff(runs.time_s[windows]) >= pause_s
        last_of_stretch = np.flatnonzero(is_interrupted & is_pause)
        for stretch in np.split(windows, last_of_stretch + 1):
            yield run, slice(int(stretch[0]), int(stretch[-1]) + 1)


def _shares(excess: Array, runs: Runs) -> Array:
    """Share of each window in the energy (or charge) of an excess, shape (windows,)."""
    energy = np.abs(excess * runs.duration_s)
    total = float(energy.sum())
    if total == 0.0:
        return np.zeros(len(energy))
    return np.asarray(energy / total)


def _cut(
    inside: Mask,
    share: Array,
    runs: Runs,
    condition: str | None,
    pause_s: float = 0.0,
    to_edges: bool = False,
) -> tuple[Place, ...]:
    """Each stretch with its share of the excess, from the middle of its first window to that of its
    last or, if `to_edges`, from edge to edge."""
    start_s, end_s = runs.time_s, runs.time_s
    if to_edges:
        start_s = runs.time_s - runs.duration_s / 2.0
        end_s = runs.time_s + runs.duration_s / 2.0
    located = []
    for run, stretch in stretches(inside, runs, pause_s):
        first_s = float(start_s[stretch][0])
        last_s = float(end_s[stretch][-1])
        words = condition
        if words is None:
            words = _when(first_s, last_s, runs, runs.run == run)
        place = Place(
            recording=runs.names[run],
            start_s=first_s,
            end_s=last_s,
            condition=words,
            share_of_excess=float(share[stretch].sum()),
        )
        located.append(place)
    return tuple(located)


def _when(start_s: float, end_s: float, runs: Runs, in_run: Mask) -> str:
    """When a stretch lies in its run, in words."""
    time_s = runs.time_s[in_run]
    start = _plain(start_s - time_s[0])
    end = _plain(end_s - time_s[0])
    window_s = 1.01 * float(runs.duration_s[in_run][0])  # and 1 % for rounding
    from_the_start = start_s - time_s[0] <= window_s
    to_the_end = time_s[-1] - end_s <= window_s
    if from_the_start and to_the_end:
        return WHOLE_RUN
    if from_the_start:
        return f"before {end} s"
    if to_the_end:
        return f"after {start} s"
    return f"from {start} to {end} s"


def _at_work(contribution: Array) -> Mask:
    """Windows where an effect exceeds `AT_WORK` of its 0.99 quantile, shape (windows,)."""
    size = np.abs(contribution)
    return np.asarray(size > thresholds.AT_WORK * float(np.quantile(size, 0.99)))


def places_of(
    contribution: Array, runs: Runs, condition: str | None, inside: Mask | None = None
) -> tuple[Place, ...]:
    """Stretches in which an effect was at work, each with its share of the effect's energy.

    Without a condition in words, the words give the time of a stretch in its run; without `inside`,
    shape (windows,), the effect is at work where its contribution, shape (windows,), exceeds
    `AT_WORK` of its 0.99 quantile.
    """
    if inside is None:
        inside = _at_work(contribution)
    share = _shares(contribution, runs)
    return _cut(
        inside, share, runs, condition, pause_s=thresholds.SHORTEST_LEVEL * WINDOW_S, to_edges=True
    )


def places(term: Term, contribution: Array, runs: Runs) -> tuple[Place, ...]:
    """Where an effect was at work, stretch by stretch, each with its condition in plain words."""
    if term.axis == "time":
        inside = None if term.schedule is None else term.schedule.level > 0
        return places_of(contribution, runs, None, inside)
    channels = {channel.name: channel for channel in TESTED}
    for name in term.hypothesis.channels:
        words = _condition_of(channels[name], contribution, runs)
        if words is not None:
            return places_of(contribution, runs, words)
    return places_of(contribution, runs, term.hypothesis.otherwise)


def where_at_work(term: Term, contribution: Array, runs: Runs) -> Location:
    """The stretches of an effect whose name was rejected, as a location."""
    return Location(
        condition="in some stretches of time",
        inside=_at_work(contribution),
        excess=contribution,
        places=places(term, contribution, runs),
    )


def condition(located: Sequence[Place]) -> str:
    """One phrase for all the places of an effect."""
    conditions = {place.condition for place in located}
    if not conditions:
        return "nowhere"
    if len(conditions) == 1:
        return located[0].condition
    return largest(located)


def largest(located: Sequence[Place]) -> str:
    """The place that holds most, and how many more there are."""
    place = max(located, key=lambda place: place.share_of_excess)
    recording = PurePath(place.recording).name
    phrase = f"{place.condition} in {recording}"
    if place.condition == WHOLE_RUN:
        phrase = f"all through {recording}"
    smaller = len(located) - 1
    if smaller == 0:
        return phrase
    if smaller == 1:
        return f"{phrase} and in 1 more stretch of time"
    return f"{phrase} and in {smaller} more stretches of time"


def total_share(contribution: Array, runs: Runs) -> float:
    """Ratio of the energy (or charge) of an effect to all that was recorded."""
    recorded = float(np.abs(runs.observed * runs.duration_s).sum())
    if recorded > 0.0:
        return float(np.abs(contribution * runs.duration_s).sum()) / recorded
    return 0.0


def _condition_of(channel: ResidualChannel, contribution: Array, runs: Runs) -> str | None:
    """The values of a channel at which an effect is at work, in words; None if they overlap too
    little."""
    values = runs.context.get(channel.name)
    if values is None:
        return None
    recorded = np.isfinite(values)
    inside = _at_work(contribution)[recorded]
    if inside.all() or not inside.any():
        return None
    values = values[recorded]
    if channel.magnitude:
        values = np.abs(values)
    quantiles = np.unique(np.round(np.quantile(values, np.linspace(0.01, 0.99, 99)), _DECIMALS))
    limits = (quantiles[1:] + quantiles[:-1]) / 2.0
    # The split whose side is most like the windows at work.
    splits = [(limit, above) for limit in limits.tolist() for above in (True, False)]
    overlaps = [_overlap(_beyond(values, limit, above), inside) for limit, above in splits]
    if max(overlaps, default=0.0) <= thresholds.HALF:
        return None
    limit, above = splits[int(np.argmax(overlaps))]
    return _words(channel, above, limit)


def _overlap(condition: Mask, inside: Mask) -> float:
    """Windows in both sets over windows in either (Jaccard index)."""
    return float((condition & inside).sum()) / float((condition | inside).sum())


def _words(channel: ResidualChannel, above: bool, limit: float) -> str:
    phrase = channel.above if above else channel.below
    return f"{phrase} {_plain(limit)} {channel.unit}".strip()
