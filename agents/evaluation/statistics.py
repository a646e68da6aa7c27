"""Statistics of evaluations: intervals over training seeds and episodes, IQM, probability of
improvement, profiles.

Definitions are those of Agarwal et al., Deep Reinforcement Learning at the Edge of the Statistical
Precipice (NeurIPS 2021, arXiv 2108.13264, and its package `rliable`). Training seeds are the runs
and episodes the tasks, because every agent drives the same episodes. Its intervals resample runs
only and treat the tasks as fixed: one training seed would have no interval, and many episodes would
not count as more evidence. Here both are resampled: the episodes once for all agents, so that
comparisons are paired, and the training seeds of each agent separately.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray
from scipy import stats

RESAMPLES = 9999
"""Resamples. Chosen: the share beyond an end of a 95 % interval is then 2.5 % with a standard error
of 0.16 %."""
_CHUNK = 4_000_000
"""Numbers that a bootstrap holds in memory. Chosen: 32 MB."""

Scores = NDArray[np.float64]  # (training seeds, episodes)


def wilson(events: int, trials: int) -> list[float]:
    """95 % interval of a rate, which is valid for rates near zero too (Wilson 1927).

    Args:
        events: Number of events.
        trials: Number of trials.

    >>> [round(end, 5) for end in wilson(0, 4000)]
    [0.0, 0.00096]
    """
    bounds = stats.binomtest(events, trials).proportion_ci(method="wilson")
    return [float(bounds.low), float(bounds.high)]


def iqm(scores: ArrayLike) -> float:
    """Interquartile mean: the mean of the middle half of all scores, of any shape.

    >>> iqm([0.0, 1.0, 2.0, 30.0])
    1.5
    """
    return float(stats.trim_mean(np.asarray(scores), 0.25, axis=None))


def probability_of_improvement(scores: ArrayLike, baseline: ArrayLike) -> float:
    """Probability that a random seed of one agent scores more than one of another on a random
    episode; ties count half.

    Args:
        scores: Scores of one agent, shape (training seeds, episodes).
        baseline: Those of the other, on the same episodes; it may have other training seeds.

    >>> probability_of_improvement([[1.0, 2.0, 3.0, 5.0]], [[0.0, 2.0, 4.0, 4.0]])
    0.625
    """
    return float(_wins(np.asarray(scores), np.asarray(baseline)).mean())


def performance_profile(scores: ArrayLike, thresholds: ArrayLike) -> Scores:
    """Share of all scores above each threshold, shape (thresholds,).

    Args:
        scores: Any shape.
        thresholds: Scores, shape (thresholds,).
    """
    ordered = np.sort(np.asarray(scores, dtype=np.float64), axis=None)
    return np.asarray(1.0 - np.searchsorted(ordered, thresholds, side="right") / ordered.size)


def _wins(scores: Scores, baseline: Scores) -> Scores:
    """How often each seed of one agent beats each of another, shape (seeds, seeds, episodes)."""
    return 0.5 * (np.sign(scores[:, None] - baseline[None]) + 1.0)


@dataclass(frozen=True)
class Bootstrap:
    """Resampled episodes and training seeds, as weights; every call uses the same ones.

    Attributes:
        scores: Scores of each agent, shape (training seeds, episodes); the episodes are the same
            for all.
        rng: Every call draws with a copy of it.
        resamples: Number of resamples.
    """

    scores: Mapping[str, Scores]
    rng: Generator
    resamples: int = RESAMPLES

    def means(self) -> dict[str, Scores]:
        """Mean score of each agent in each resample, shape (resamples,): their differences are
        paired by episode."""
        parts: dict[str, list[Scores]] = {name: [] for name in self.scores}
        # b: resamples, s: training seeds; the same episodes for all agents.
        for episodes, seeds in self._weights():
            for name, values in self.scores.items():
                parts[name].append(np.einsum("bs,bs->b", seeds[name], episodes @ values.T))
        return {name: np.concatenate(drawn) for name, drawn in parts.items()}

    def iqms(self) -> dict[str, Scores]:
        """Interquartile mean of each agent in each resample, shape (resamples,)."""
        parts: dict[str, list[Scores]] = {name: [] for name in self.scores}
        order = {name: np.argsort(values, axis=None) for name, values in self.scores.items()}
        # The weight between the quartiles counts, and a score at a quartile with the part of its
        # weight inside.
        for episodes, seeds in self._weights():
            for name, values in self.scores.items():
                weights = (seeds[name][:, :, None] * episodes[:, None, :]).reshape(
                    len(episodes), -1
                )
                until = np.clip(np.cumsum(weights[:, order[name]], axis=1), 0.25, 0.75)
                inside = np.diff(until, axis=1, prepend=0.25)
                parts[name].append(2.0 * inside @ values.ravel()[order[name]])
        return {name: np.concatenate(drawn) for name, drawn in parts.items()}

    def improvements(self, agent: str, baseline: str) -> Scores:
        """Probability that one agent beats another in each resample, shape (resamples,)."""
        wins = _wins(self.scores[agent], self.scores[baseline])
        parts = []
        for episodes, seeds in self._weights():
            shares = np.tensordot(episodes, wins, axes=(1, 2))
            parts.append(np.einsum("bst,bs,bt->b", shares, seeds[agent], seeds[baseline]))
        return np.concatenate(parts)

    def profiles(self, name: str, thresholds: ArrayLike) -> Scores:
        """Performance profile of an agent in each resample, shape (resamples, thresholds)."""
        above = self.scores[name][:, :, None] > np.asarray(thresholds)
        parts = []
        for episodes, seeds in self._weights():
            shares = np.tensordot(episodes, above.astype(np.float64), axes=(1, 1))
            parts.append(np.einsum("bst,bs->bt", shares, seeds[name]))
        return np.concatenate(parts)

    def _weights(self) -> Iterator[tuple[Scores, dict[str, Scores]]]:
        """Weight of each episode (resamples, episodes), and of each training seed of each agent, in
        parts."""
        rng = copy.deepcopy(self.rng)
        count = next(iter(self.scores.values())).shape[1]
        largest = max(values.size for values in self.scores.values())
        chunk = max(1, _CHUNK // largest)
        for start in range(0, self.resamples, chunk):
            size = min(chunk, self.resamples - start)
            seeds = {name: _draw(rng, len(values), size) for name, values in self.scores.items()}
            yield _draw(rng, count, size), seeds


def _draw(rng: Generator, count: int, size: int) -> Scores:
    """Weights of items drawn with replacement, as many as there are, shape (size, count)."""
    return rng.multinomial(count, np.full(count, 1.0 / count), size) / count


def interval(samples: Scores) -> list[float]:
    """95 % percentile interval of bootstrap samples of shape (resamples,)."""
    low, high = np.percentile(samples, [2.5, 97.5])
    return [float(low), float(high)]
