"""Where a mismatch sits: the values of a channel, in plain words, that hold most of the excess."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward.diagnosis.explain.residual_test import Channel, Dependence
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import Array

WHOLE_RUN = "all of the run"
_AT_WORK = 0.1  # of its usual peak
_PAUSE_S = 2.0
_TELLING = 0.6  # overlap (F1) of a condition with when an effect is at work
_CLEAR_MINORITY = 0.35  # a side with less than this share of the windows is the exception, the other the rule


@dataclass(frozen=True)
class Place:
    """One stretch of one recording under the located condition, as `where` of diagnosis.json has it."""

    recording: str
    start_s: float
    end_s: float
    condition: str
    share_of_excess: float


@dataclass(frozen=True)
class Location:
    """The located condition: in words, for which windows it holds, and where that is in each recording."""

    condition: str
    inside: NDArray[np.bool_]  # (windows,)
    excess: Array  # (windows,), W or A above the rest
    places: tuple[Place, ...]

    @property
    def share(self) -> float:
        """Share of the whole excess that lies under the condition."""
        return min(1.0, sum(place.share_of_excess for place in self.places))


def locate(dependence: Dependence, runs: Runs) -> Location:
    """Find the split of a channel's values that separates the excess best, and say it in words."""
    if dependence.channel.name == "time_s":
        return _locate_in_time(dependence, runs)
    known = dependence.bin >= 0
    weight = np.bincount(dependence.bin[known], minlength=len(dependence.effect)).astype(np.float64) + 1e-9
    split, above = _best_split(dependence.effect, weight)
    # Between the middles of the bins beside the split: their common edge may lie in the noise around a frequent value.
    limit = float(dependence.centre[split - 1 : split + 1].mean())
    channel = dependence.channel
    values = np.nan_to_num(runs.context[channel.name])
    inside = known & ((np.abs(values) if channel.magnitude else values) > limit if above else values < limit)
    condition = f"{channel.above if above else channel.below} {_plain(limit)} {channel.unit}".strip()
    outside = np.delete(np.arange(len(weight)), np.s_[split:] if above else np.s_[:split])
    rest = np.average(dependence.effect[outside], weights=weight[outside])
    excess = np.where(known, dependence.effect[dependence.bin] - rest, 0.0) * dependence.weight
    return Location(condition, inside, excess, _places(condition, inside, excess, runs))


def _best_split(effect: Array, weight: Array) -> tuple[int, bool]:
    """First bin above the threshold with the largest sum of squares between its sides, and whether that side is meant.

    Meant is the side that is clearly the exception or else the one where more is drawn than the model says.
    """
    total = weight.sum()
    best, split, above = -1.0, 1, True
    for k in range(1, len(effect)):
        low, high = weight[:k].sum(), weight[k:].sum()
        difference = np.average(effect[k:], weights=weight[k:]) - np.average(effect[:k], weights=weight[:k])
        between = low * high / total * difference**2
        if between > best:
            exception = min(low, high) < _CLEAR_MINORITY * total
            best, split, above = between, k, bool(high < low if exception else difference > 0.0)
    return split, above


def _plain(value: float) -> str:
    """Two significant digits, as one would say it.

    >>> _plain(0.20417), _plain(412.0), _plain(-0.0)
    ('0.2', '410', '0')
    """
    if value == 0.0:
        return "0"
    digits = 1 - int(np.floor(np.log10(abs(value))))
    rounded = round(float(value), digits)
    return f"{rounded:.{max(digits, 0)}f}".rstrip("0").rstrip(".") if digits > 0 else f"{rounded:.0f}"


def _locate_in_time(dependence: Dependence, runs: Runs) -> Location:
    """The stretches of each run that lie furthest from the level of all runs."""
    effect, number = dependence.effect, dependence.bin
    weight = np.bincount(number, minlength=len(effect)).astype(np.float64)
    middle = _weighted_median(effect, weight)
    spread = effect - middle
    far = np.abs(spread) > 0.5 * np.max(np.abs(spread))
    rest = np.average(effect[~far], weights=weight[~far]) if (~far).any() else middle
    excess = (effect - rest)[number] * dependence.weight
    inside = far[number]
    return Location("in some stretches of time", inside, excess, _stretches(inside, excess, runs))


def _weighted_median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    heap = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(heap, heap[-1] / 2.0)])


def _stretches(inside: NDArray[np.bool_], excess: Array, runs: Runs) -> tuple[Place, ...]:
    whole = float(np.abs(excess * runs.duration_s).sum()) or 1.0
    places = []
    for run, name in enumerate(runs.names):
        here = np.flatnonzero(runs.run == run)
        changes = np.flatnonzero(np.diff(inside[here].astype(int), prepend=0, append=0))
        for first, after in zip(changes[::2], changes[1::2], strict=True):
            part = here[first:after]
            share = float(np.abs(excess * runs.duration_s)[part].sum()) / whole
            places.append(Place(name, float(runs.time_s[part[0]]), float(runs.time_s[part[-1]]), "", share))
    return stretch_words(tuple(places), runs)


def stretch_words(places: tuple[Place, ...], runs: Runs) -> tuple[Place, ...]:
    """The places with when they lie in their run as their condition."""
    first_s, last_s, step_s = {}, {}, {}
    for run, name in enumerate(runs.names):
        here = np.flatnonzero(runs.run == run)
        first_s[name], last_s[name] = float(runs.time_s[here[0]]), float(runs.time_s[here[-1]])
        step_s[name] = float(runs.duration_s[here[0]])
    told = []
    for place in places:
        origin_s, edge_s = first_s[place.recording], 1.01 * step_s[place.recording]
        from_start, to_end = place.start_s - origin_s <= edge_s, last_s[place.recording] - place.end_s <= edge_s
        start, end = _plain(place.start_s - origin_s), _plain(place.end_s - origin_s)
        if from_start and to_end:
            words = WHOLE_RUN
        elif to_end:
            words = f"after {start} s"
        elif from_start:
            words = f"before {end} s"
        else:
            words = f"from {start} to {end} s"
        told.append(dataclasses.replace(place, condition=words))
    return tuple(told)


def _places(condition: str, inside: NDArray[np.bool_], excess: Array, runs: Runs) -> tuple[Place, ...]:
    """First to last moment under the condition in each recording, and its share of the excess of all."""
    energy = np.abs(excess * runs.duration_s)
    whole = float(energy.sum()) or 1.0
    places = []
    for run, name in enumerate(runs.names):
        here = np.flatnonzero(inside & (runs.run == run))
        if len(here):
            start_s, end_s = float(runs.time_s[here[0]]), float(runs.time_s[here[-1]])
            places.append(Place(name, start_s, end_s, condition, float(energy[here].sum()) / whole))
    return tuple(places)


def at_work(contribution: Array) -> NDArray[np.bool_]:
    """When an effect adds a good part of its usual peak, shape (windows,)."""
    size = np.abs(contribution)
    working: NDArray[np.bool_] = size > _AT_WORK * float(np.quantile(size, 0.99))
    return working


def places_of(
    contribution: Array, runs: Runs, condition: str, inside: NDArray[np.bool_] | None = None
) -> tuple[Place, ...]:
    """Stretches in which an effect was at work, with its condition in words and each one's share of its energy.

    Args:
        contribution: What it adds, shape (windows,).
        runs: The runs.
        condition: The condition in words.
        inside: When it was at work; where it adds a good part of its usual peak, if left out.
    """
    size = np.abs(contribution)
    if inside is None:
        inside = at_work(contribution)
    energy = size * runs.duration_s
    whole = float(energy.sum()) or 1.0
    places = []
    for run, name in enumerate(runs.names):
        here = np.flatnonzero(runs.run == run)
        starts_s = runs.time_s[here] - runs.duration_s[here] / 2.0
        for first, after in _joined(inside[here], runs.time_s[here]):
            part = here[first:after]
            end_s = float(runs.time_s[part[-1]] + runs.duration_s[part[-1]] / 2.0)
            places.append(Place(name, float(starts_s[first]), end_s, condition, float(energy[part].sum()) / whole))
    return tuple(places)


def _joined(inside: NDArray[np.bool_], time_s: Array) -> list[tuple[int, int]]:
    """First window and the one after the last of each stretch; pauses of no consequence do not end one."""
    changes = np.flatnonzero(np.diff(inside.astype(int), prepend=0, append=0))
    joined: list[tuple[int, int]] = []
    for first, after in zip(changes[::2].tolist(), changes[1::2].tolist(), strict=True):
        if joined and time_s[first] - time_s[joined[-1][1] - 1] < _PAUSE_S:
            joined[-1] = (joined[-1][0], after)
        else:
            joined.append((first, after))
    return joined


def condition_of(channel: Channel, contribution: Array, runs: Runs) -> str | None:
    """The values of a channel at which an effect is at work, in words; None if the channel does not tell."""
    values = runs.context.get(channel.name)
    if values is None:
        return None
    values = np.abs(values) if channel.magnitude else values
    inside = at_work(contribution)
    known = np.isfinite(values)
    if inside[known].all() or not inside[known].any():
        return None
    best, words = 0.0, None
    limits = np.unique(np.quantile(values[known], np.linspace(0.01, 0.99, 99)))
    for limit in (limits[1:] + limits[:-1]) / 2.0:
        for above in (True, False):
            meant = values > limit if above else values < limit
            both = float((meant & inside & known).sum())
            score = 2.0 * both / max(float((meant & known).sum() + (inside & known).sum()), 1.0)
            if score > best:
                best = score
                words = f"{channel.above if above else channel.below} {_plain(float(limit))} {channel.unit}".strip()
    return words if best > _TELLING else None
