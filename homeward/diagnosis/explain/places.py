"""Where and when a mismatch occurs or an effect is at work: stretches of the recordings and a condition in words.

A condition on a channel is one split of its values, by least squares or by its overlap with the stretches.
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
    """The located condition: in words, for which windows it holds, and where that is in each recording."""

    condition: str
    inside: Mask  # (windows,)
    excess: Array  # (windows,), W or A above the rest
    places: tuple[Place, ...]

    @property
    def share(self) -> float:
        """Share of the whole excess that lies under the condition."""
        return min(1.0, sum(place.share_of_excess for place in self.places))


def locate(dependence: Dependence, runs: Runs) -> Location:
    """Find the split of a channel's values that separates the excess best, and describe it in words."""
    if dependence.channel.name == "time_s":
        return _locate_in_time(dependence, runs)
    known = dependence.bin >= 0
    weight = np.bincount(dependence.bin[known], minlength=len(dependence.effect)).astype(np.float64) + 1e-9
    split, above = _best_split(dependence.effect, weight)
    # The mean of the two bin centres: the common edge may lie in the noise around a frequent value.
    limit = float(dependence.centre[split - 1 : split + 1].mean())
    channel = dependence.channel
    values = np.nan_to_num(runs.context[channel.name])
    if channel.magnitude:
        values = np.abs(values)
    inside = known & (values > limit if above else values < limit)
    condition = _words(channel, above, limit)
    outside = np.delete(np.arange(len(weight)), np.s_[split:] if above else np.s_[:split])
    rest = np.average(dependence.effect[outside], weights=weight[outside])
    excess = np.where(known, dependence.effect[dependence.bin] - rest, 0.0) * dependence.weight
    return Location(
        condition, inside, excess, _cut(inside, _shares(excess, runs) * inside, runs, condition, pause_s=np.inf)
    )


def _best_split(effect: Array, weight: Array) -> tuple[int, bool]:
    """First bin above the split with the largest sum of squares between its sides, and whether the upper side is
    chosen.

    The chosen side is the rarer one if the other is twice as large, or else the one where more is drawn than predicted.
    """
    low, below = np.cumsum(weight), np.cumsum(weight * effect)
    high = low[-1] - low[:-1]
    difference = (below[-1] - below[:-1]) / high - below[:-1] / low[:-1]
    k = int(np.argmax(low[:-1] * high * difference**2))
    is_exception = thresholds.TWICE * min(low[k], high[k]) < max(low[k], high[k])
    return k + 1, bool(high[k] < low[k] if is_exception else difference[k] > 0.0)


def _plain(value: float) -> str:
    """A value to two significant digits.

    >>> _plain(0.20417), _plain(412.0), _plain(-0.0)
    ('0.2', '410', '0')
    """
    return np.format_float_positional(value + 0.0, precision=2, unique=False, fractional=False, trim="-")


def _locate_in_time(dependence: Dependence, runs: Runs) -> Location:
    """The stretches of each run that lie furthest from the level of all runs."""
    effect, number = dependence.effect, dependence.bin
    weight = np.bincount(number, minlength=len(effect)).astype(np.float64)
    middle = float(np.quantile(effect, 0.5, weights=weight, method="inverted_cdf"))
    spread = effect - middle
    far = np.abs(spread) > thresholds.HALF * np.max(np.abs(spread))
    rest = np.average(effect[~far], weights=weight[~far]) if (~far).any() else middle
    excess = (effect - rest)[number] * dependence.weight
    inside = far[number]
    return Location("in some stretches of time", inside, excess, _cut(inside, _shares(excess, runs), runs, None))


def stretches(inside: Mask, runs: Runs, pause_s: float = 0.0) -> Iterator[tuple[int, slice]]:
    """Run and windows of each stretch; a stretch continues over pauses that are shorter than this."""
    for run in range(len(runs.signals)):
        here = np.flatnonzero(inside & (runs.run == run))
        ends = np.flatnonzero((np.diff(here) > 1) & (np.diff(runs.time_s[here]) >= pause_s))
        for part in np.split(here, ends + 1) if len(here) else ():
            yield run, slice(int(part[0]), int(part[-1]) + 1)


def _shares(excess: Array, runs: Runs) -> Array:
    """Share of each window in the energy (or charge) of an excess, shape (windows,)."""
    energy = np.abs(excess * runs.duration_s)
    return np.asarray(energy / (float(energy.sum()) or 1.0))


def _cut(
    inside: Mask, share: Array, runs: Runs, condition: str | None, pause_s: float = 0.0, edge: float = 0.0
) -> tuple[Place, ...]:
    """Each stretch with its share of the excess; from the middle of its first window or, if `edge` is 1, its start."""
    half_s, places = edge * runs.duration_s / 2.0, []
    for run, part in stretches(inside, runs, pause_s):
        start_s, end_s = float((runs.time_s - half_s)[part][0]), float((runs.time_s + half_s)[part][-1])
        words = _when(start_s, end_s, runs, runs.run == run) if condition is None else condition
        places.append(Place(runs.names[run], start_s, end_s, words, float(share[part].sum())))
    return tuple(places)


def _when(start_s: float, end_s: float, runs: Runs, here: Mask) -> str:
    """When a stretch lies in its run, in words."""
    time_s, edge_s = runs.time_s[here], 1.01 * float(runs.duration_s[here][0])
    start, end = _plain(start_s - time_s[0]), _plain(end_s - time_s[0])
    if start_s - time_s[0] <= edge_s:
        return WHOLE_RUN if time_s[-1] - end_s <= edge_s else f"before {end} s"
    return f"after {start} s" if time_s[-1] - end_s <= edge_s else f"from {start} to {end} s"


def _at_work(contribution: Array) -> Mask:
    """Windows where an effect exceeds `AT_WORK` of its 0.99 quantile, shape (windows,)."""
    size = np.abs(contribution)
    return np.asarray(size > thresholds.AT_WORK * float(np.quantile(size, 0.99)))


def places_of(contribution: Array, runs: Runs, condition: str | None, inside: Mask | None = None) -> tuple[Place, ...]:
    """Stretches in which an effect was at work, each with its share of the effect's energy.

    Without a condition in words, the words give the time of a stretch in its run; without `inside`, shape (windows,),
    the effect is at work where its contribution, shape (windows,), exceeds `AT_WORK` of its 0.99 quantile.
    """
    inside = _at_work(contribution) if inside is None else inside
    return _cut(inside, _shares(contribution, runs), runs, condition, thresholds.SHORTEST_LEVEL * WINDOW_S, edge=1.0)


def places(term: Term, contribution: Array, runs: Runs) -> tuple[Place, ...]:
    """Where an effect was at work, stretch by stretch, each with its condition in plain words."""
    if term.axis == "time":
        on = None if term.schedule is None else term.schedule.level > 0
        return places_of(contribution, runs, None, on)
    channels = {channel.name: channel for channel in TESTED}
    conditions = (_condition_of(channels[name], contribution, runs) for name in term.hypothesis.channels)
    return places_of(contribution, runs, next(filter(None, conditions), term.hypothesis.otherwise))


def where_at_work(term: Term, contribution: Array, runs: Runs) -> Location:
    """The stretches of an effect whose name was rejected, as a location."""
    found = places(term, contribution, runs)
    return Location("in some stretches of time", _at_work(contribution), contribution, found)


def condition(found: Sequence[Place]) -> str:
    """One phrase for all the places of an effect."""
    if not found:
        return "nowhere"
    return found[0].condition if len({place.condition for place in found}) == 1 else largest(found)


def largest(found: Sequence[Place]) -> str:
    """The place that holds most, and how many more there are."""
    first, more = max(found, key=lambda place: place.share_of_excess), len(found) - 1
    name = PurePath(first.recording).name
    start = f"all through {name}" if first.condition == WHOLE_RUN else f"{first.condition} in {name}"
    return start + (f" and in {more} more stretch{'es' if more > 1 else ''} of time" if more else "")


def total_share(contribution: Array, runs: Runs) -> float:
    """Ratio of the energy (or charge) of an effect to all that was recorded."""
    drawn = float(np.abs(runs.observed * runs.duration_s).sum())
    return float(np.abs(contribution * runs.duration_s).sum()) / drawn if drawn > 0.0 else 0.0


def _condition_of(channel: ResidualChannel, contribution: Array, runs: Runs) -> str | None:
    """The values of a channel at which an effect is at work, in words; None if they overlap too little."""
    values = runs.context.get(channel.name)
    if values is None:
        return None
    if channel.magnitude:
        values = np.abs(values)
    inside = _at_work(contribution)
    known = np.isfinite(values)
    if inside[known].all() or not inside[known].any():
        return None
    values, inside = values[known], inside[known]
    quantiles = np.unique(np.round(np.quantile(values, np.linspace(0.01, 0.99, 99)), _DECIMALS))
    best, limit, above = 0.0, 0.0, True
    for middle in ((quantiles[1:] + quantiles[:-1]) / 2.0).tolist():
        for side, meant in ((True, values > middle), (False, values < middle)):
            overlap = float((meant & inside).sum()) / float((meant | inside).sum())
            if overlap > best:
                best, limit, above = overlap, middle, side
    return _words(channel, above, limit) if best > thresholds.HALF else None


def _words(channel: ResidualChannel, above: bool, limit: float) -> str:
    return f"{channel.above if above else channel.below} {_plain(limit)} {channel.unit}".strip()
