"""A formula for what no known effect explains: sparse, dimensionally consistent, and empirical.

Candidates are the weight's power m g v, the drive's load, or plain watts, times at most two dimensionless groups of the
channels (|w| B / v_max, a / g, sin(grade), ...) with small powers. At most two terms are taken, one after the other, by
held-out error and by a BIC that pays for the size of the search (Chen & Chen, Biometrika 2008). The proof is that of
the catalogue's effects, and its placebos repeat the whole search on channels that are shifted in time: a winner among
thousands is only worth something if the best of thousands without a cause does worse.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student
from threadpoolctl import threadpool_limits

from homeward.diagnosis.explain.dimensionless import constants
from homeward.diagnosis.explain.formulas import Candidate, Library, candidates
from homeward.diagnosis.explain.naming import shifted_in_time
from homeward.diagnosis.fit.fitted import Fitted, excited, with_columns
from homeward.diagnosis.fit.folds import correlation_windows, noise_of
from homeward.diagnosis.fit.held_out import gain, held_out
from homeward.diagnosis.fit.refit import standard_errors
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import Array
from homeward.diagnosis.rules import PLACEBOS, SMALLEST_GAIN, VERY_STRONG

_MOST_TERMS = 2
_MOST_SEARCHED = 20_000  # windows; of more the search takes every second, third, ...
_MOST_ALTERNATIVES = 3
_RIDGE = 1e-8


@dataclass(frozen=True)
class EmpiricalTerm:
    """One term of the formula: `coefficient` times what `text` says, with where its symbols come from."""

    text: str  # such as "m g v (|w| B / v_max)^2"
    coefficient: float
    ci95: tuple[float, float]
    unit: str  # of the coefficient: "1", "W" or "A"
    alternatives: tuple[str, ...]  # what does as well on these recordings


@dataclass(frozen=True)
class Empirical:
    """A formula that passed the proof; `columns` and `contribution` have shape (windows, terms)."""

    symbol: str  # of what it adds to: "P" or "I"
    terms: tuple[EmpiricalTerm, ...]
    constants: Mapping[str, str]  # symbols that are the same for all windows, with value and unit
    columns: Array
    contribution: Array
    delta_bic: float
    held_out_gain: float  # share of the refit's squared held-out error
    gain_ci95: tuple[float, float]
    p_value: float  # share of searches without a cause that do as well

    @property
    def text(self) -> str:
        """The formula with its numbers, such as "P = 0.31 W f_s / f_max"."""
        parts = []
        for one in self.terms:
            unit = "" if one.unit == "1" else f" {one.unit}"
            parts.append(
                f"{'-' if one.coefficient < 0.0 else '+'} {abs(one.coefficient):.3g}{unit} {one.text}".rstrip()
            )
        return (
            f"{self.symbol} = {' '.join(parts).removeprefix('+ ').replace('- ', '-', 1 if parts[0][0] == '-' else 0)}"
        )


def propose(
    fit: Fitted,
    runs: Runs,
    block: NDArray[np.intp],
    fold: NDArray[np.intp],
    seed: int,
) -> Empirical | None:
    """Find the formula that the residual of a refit follows; None where none passes the proof.

    Args:
        fit: The refit.
        runs: The runs.
        block: Stretches that count as independent, shape (windows,).
        fold: What is held out together, shape (windows,).
        seed: Seed of placebos and intervals.
    """
    with threadpool_limits(1):  # the threads of many small products wait for each other busily
        return _propose(fit, runs, block, fold, seed)


def _propose(fit: Fitted, runs: Runs, block: NDArray[np.intp], fold: NDArray[np.intp], seed: int) -> Empirical | None:
    library = candidates(fit, runs)
    search = Search(library, fit, runs, fold)
    chosen: list[Candidate] = []
    p_values: list[float] = []
    paid = 0.0
    while len(chosen) < _MOST_TERMS:
        scores = search.scores(library.everything, chosen)
        best = _best(scores)
        before, after = search.held_out(chosen), search.held_out([*chosen, best])
        pays = _pays(before, after, runs) - library.cost()[best[0]][best[1:]]
        gained = gain(runs.observed, before, after, block, seed)
        if pays < VERY_STRONG or gained.share < SMALLEST_GAIN or gained.ci95[0] <= 0.0:
            break
        p_value = _placebo_p_value(search, chosen, scores[best[0]][best[1:]], seed)
        if p_value > 1.0 / (PLACEBOS + 1):
            break
        chosen.append(best)
        p_values.append(p_value)
        paid += pays
    if not chosen:
        return None
    chosen, alternatives = _reconsidered(search, chosen)
    columns = library.columns(chosen)
    gained = gain(runs.observed, search.held_out([]), search.held_out(chosen), block, seed)
    sizes, intervals = _coefficients(fit, runs, block, columns)
    terms = tuple(
        EmpiricalTerm(library.text(one), size, wide, library.bases[one[0]].unit, others)
        for one, size, wide, others in zip(chosen, sizes, intervals, alternatives, strict=True)
    )
    texts = " ".join(one.text for one in terms)
    return Empirical(
        "P" if runs.unit == "W" else "I", terms, constants(texts, fit.parameters.nominal, runs), columns,
        columns * np.array(sizes), paid, gained.share, gained.ci95, max(p_values),
    )  # fmt: skip


def _reconsidered(search: Search, chosen: list[Candidate]) -> tuple[list[Candidate], list[tuple[str, ...]]]:
    """Each term chosen anew beside the others, as the first had to stand in for the second; and what does as well."""
    left = search.runs.observed - search.held_out(chosen)
    judge = replace(search, memory=correlation_windows(left, search.runs.run))
    final, alternatives = list(chosen), []
    for index in range(len(final)):
        scores = judge.scores(search.library.everything, final[:index] + final[index + 1 :])
        final[index] = _best(scores)
        alternatives.append(_alternatives(search.library, scores, final[index]))
    return final, alternatives


@dataclass(frozen=True)
class Search:
    """What a search for a term needs beside the terms that are present."""

    library: Library
    fit: Fitted
    runs: Runs
    fold: NDArray[np.intp]
    memory: float | None = None  # of what is left, in windows; by default that of the refit's residual

    def scores(self, everything: Array, present: Sequence[Candidate]) -> list[Array]:
        """Evidence for each candidate beside the refit and the terms present, a (factors, factors) array per base.

        Every product of a candidate with anything is a product of two factors under a weight, so that one product of
        matrices serves all pairs of factors.

        Args:
            everything: Values of bases and factors, shape (windows, bases + factors).
            present: Terms that are in the model already.
        """
        residual = self.runs.observed - self.fit.predicted
        memory = self.memory or noise_of(residual, self.runs.run).memory
        effective = max(len(residual) / memory, 2.0)
        thin = slice(None, None, -(-len(residual) // _MOST_SEARCHED))
        bases, values = np.split(everything[thin], [len(self.library.bases)], axis=1)
        beside = np.column_stack([self.fit.jacobian, self.library.columns(present)])[thin]
        norms = np.linalg.norm(beside, axis=0)
        beside, target, fold = beside[:, norms > 0.0] / norms[norms > 0.0], residual[thin], self.fold[thin]
        parts = [np.flatnonzero(fold == one) for one in np.unique(fold)]
        known = [
            _Known(beside[rows].T @ beside[rows], beside[rows].T @ target[rows], float(target[rows] @ target[rows]))
            for rows in parts
        ]
        plain = sum(_known_error(known, index) for index in range(len(parts)))
        scores = []
        for base, cost in zip(bases.T, self.library.cost(), strict=True):
            sums = [_sums(values[rows], base[rows], beside[rows], target[rows]) for rows in parts]
            error = np.sum([_error(known, sums, index) for index in range(len(parts))], axis=0)
            ratio = np.log(max(plain, 1e-300) / np.maximum(error, 1e-300))
            scores.append(effective * ratio - np.log(effective) - cost)
        return scores

    def held_out(self, present: Sequence[Candidate]) -> Array:
        """Held-out predictions of the refit with these terms, within the bounds of what is physical."""
        columns = self.library.columns(present)
        return held_out(lambda chosen: with_columns(self.fit, chosen, self.runs.observed, columns), self.fold)


@dataclass(frozen=True)
class _Known:
    """Products, over one fold, of what is in the model already and the target."""

    gram: Array  # (known, known)
    moment: Array  # (known,)
    power: float


@dataclass(frozen=True)
class _Sums:
    """Products, over one fold, of every candidate of a base; shape (factors, factors)."""

    power: Array
    moment: Array
    beside: Array  # (factors, factors, known)


def _sums(values: Array, base: Array, beside: Array, target: Array) -> _Sums:
    weights = np.column_stack([base * target, base[:, None] * beside])
    # One product of matrices for all weights is several times faster than one for each.
    weighted = (values[:, None, :] * weights[:, :, None]).reshape(len(values), -1)
    moments = (values.T @ weighted).reshape(values.shape[1], weights.shape[1], values.shape[1])
    squared = values * values
    power = squared.T @ (squared * (base * base)[:, None])
    return _Sums(power, moments[:, 0], np.moveaxis(moments[:, 1:], 1, -1))


def _known_error(known: Sequence[_Known], test: int) -> float:
    gram, moment, here = _rest(known, test)
    weights = np.linalg.solve(gram, moment)
    error = here.power - 2.0 * float(weights @ here.moment) + float(weights @ here.gram @ weights)
    return max(error, 0.0)


def _rest(known: Sequence[_Known], test: int) -> tuple[Array, Array, _Known]:
    others = [one for index, one in enumerate(known) if index != test] or list(known)
    gram = sum((one.gram for one in others), np.zeros_like(known[0].gram))
    moment = sum((one.moment for one in others), np.zeros_like(known[0].moment))
    return gram + _RIDGE * np.eye(len(gram)), moment, known[test]


def _error(known: Sequence[_Known], sums: Sequence[_Sums], test: int) -> Array:
    """Squared error on one fold of fits to the others, for every candidate of a base, by block elimination."""
    gram, moment, here = _rest(known, test)
    others = [one for index, one in enumerate(sums) if index != test] or list(sums)
    power = np.sum([one.power for one in others], axis=0)
    own_moment = np.sum([one.moment for one in others], axis=0)
    beside = np.sum([one.beside for one in others], axis=0)
    inverse = np.linalg.inv(gram)
    taken = beside @ inverse
    left = power - (taken * beside).sum(axis=-1)
    seen = left > 1e-6 * np.maximum(power, 1e-300)  # else what is in the model says the same
    size = np.where(seen, (own_moment - taken @ moment) / np.where(seen, left, 1.0), 0.0)
    weights = inverse @ moment - taken * size[..., None]
    mine = sums[test]
    error: Array = (
        here.power
        - 2.0 * (weights @ here.moment + size * mine.moment)
        + ((weights @ here.gram) * weights).sum(axis=-1)
        + 2.0 * size * (weights * mine.beside).sum(axis=-1)
        + size**2 * mine.power
    )
    return np.maximum(error, 0.0)


def _best(scores: Sequence[Array]) -> Candidate:
    base = int(np.argmax([score.max() for score in scores]))
    first, second = np.unravel_index(int(np.argmax(scores[base])), scores[base].shape)
    return base, int(first), int(second)


def _alternatives(library: Library, scores: Sequence[Array], best: Candidate) -> tuple[str, ...]:
    """Other candidates that the data do not separate from the best, best first."""
    least = scores[best[0]][best[1:]] - VERY_STRONG
    close: list[tuple[float, str]] = [
        (-float(score[first, second]), library.text((base, int(first), int(second))))
        for base, score in enumerate(scores)
        for first, second in zip(*np.nonzero(score > least), strict=True)
        if (base, first, second) != best
    ]
    return tuple(text for _, text in sorted(close)[:_MOST_ALTERNATIVES])


def _pays(before: Array, after: Array, runs: Runs) -> float:
    """Evidence for one more coefficient; what a wrong term leaves has memory, and counts for less."""
    without, with_it = (float(((runs.observed - one) ** 2).sum()) for one in (before, after))
    independent = max(len(after) / correlation_windows(runs.observed - after, runs.run), 2.0)
    return float(independent * np.log(max(without, 1e-300) / max(with_it, 1e-300)) - np.log(independent))


def _placebo_p_value(search: Search, present: Sequence[Candidate], score: float, seed: int) -> float:
    """Share of searches, this one among them, that find as good a term among channels shifted in time."""
    rng = np.random.default_rng(seed)
    as_good = 1
    for _ in range(PLACEBOS):
        shifted = shifted_in_time(search.library.everything, rng)
        as_good += max(float(one.max()) for one in search.scores(shifted, present)) >= score
    return as_good / (PLACEBOS + 1)


def _coefficients(
    fit: Fitted, runs: Runs, block: NDArray[np.intp], columns: Array
) -> tuple[list[float], list[tuple[float, float]]]:
    """Coefficient of each term fitted together with the groups, and its interval clustered by block."""
    everywhere = np.ones(len(runs.observed), dtype=bool)
    predicted = with_columns(fit, everywhere, runs.observed, columns)
    design = np.column_stack([fit.jacobian[:, excited(fit, runs)], columns])
    weights = np.linalg.lstsq(design, predicted - fit.predicted, rcond=None)[0][-columns.shape[1] :]
    errors = standard_errors(design, runs.observed - predicted, block)[-columns.shape[1] :]
    width = float(student.ppf(0.975, max(int(block.max()) + 1 - design.shape[1], 1))) * errors
    return weights.tolist(), [(float(w - d), float(w + d)) for w, d in zip(weights, width, strict=True)]
