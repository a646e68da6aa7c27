"""Which physics is missing: every hypothesis fitted together with the refit, alone and in pairs, and held to proof.

A hypothesis must predict held-out stretches better than the refit by a stated share with an interval that excludes
zero, pay for its freedom by the Bayesian information criterion, and beat placebos: its own regressors shifted in time,
which have the same freedom and the same spectrum but no cause.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from homeward.diagnosis.arms import gain
from homeward.diagnosis.blocks import correlation_windows
from homeward.diagnosis.hypotheses import PHYSICS, Setting, Term, look_alike
from homeward.diagnosis.modelling import Corrected, fit_model, immaterial
from homeward.diagnosis.motion import follows_motion
from homeward.diagnosis.parameters import WithEffects
from homeward.diagnosis.refit import Refit, holding
from homeward.diagnosis.regression import Products, products
from homeward.diagnosis.replay import Runs
from homeward.diagnosis.signals import Array
from homeward.diagnosis.terms import terms

SMALLEST_GAIN = 0.05
"""Share of the refit's held-out squared error that an effect must explain to be named."""

MUST_PAY = 6.0
"""Difference of BIC that an effect must bring: "strong" (Kass & Raftery, 1995)."""

PLACEBOS = 19
"""So that being better than all of them has p = 0.05."""

FOLDS = 5
"""Of blocks, over which hypotheses are compared."""

_MOST_EFFECTS = 3
_WORTH_A_LOOK = 0.005  # log of the ratio of held-out errors
_NEARLY = 0.7  # of what a schedule explains
_EQUAL = 1.1  # times the held-out error: no worse
_ALIKE = 0.97  # a rival that explains this share of what the best one does may be meant as well
_ALIKE_BY_NATURE = 0.5  # the same of one that is known to look alike, where no channel shows the difference
_TRIED = 6  # hypotheses that are put to the proof, the best first
_PAIRED = 12  # single hypotheses that are tried in pairs


@dataclass(frozen=True)
class Named:
    """One effect that the recordings ask for, and what speaks for it."""

    term: Term
    delta_bic: float  # against the model without it
    held_out_gain: float  # share of the squared held-out error of the model without it
    gain_ci95: tuple[float, float]
    p_value: float  # share of placebos that do as well
    rivals: tuple[Term, ...]  # what the data cannot separate from it, best first


@dataclass(frozen=True)
class Ranked:
    """One hypothesis tried alone, for the report."""

    effect: str
    axis: str
    delta_bic: float
    held_out_gain: float


@dataclass(frozen=True)
class Naming:
    """What was found, and how every single hypothesis did; `absorbed` is the share of it that the refit takes up."""

    named: tuple[Named, ...] = ()
    corrected: Corrected | None = None  # the model with them, where any is named
    ranking: tuple[Ranked, ...] = ()
    absorbed: Mapping[str, float] = field(default_factory=dict)

    def nothing_named(self) -> Naming:
        """How the hypotheses did, with none of them named."""
        return Naming(ranking=self.ranking, absorbed=self.absorbed)


@dataclass(frozen=True)
class _Bench:
    """A set of columns with their products, on which any choice of hypotheses is compared."""

    runs: Runs
    base: NDArray[np.intp]  # columns of the refit and of what is named already
    own: tuple[NDArray[np.intp], ...]  # columns of each hypothesis
    candidates: tuple[Term, ...]
    columns: Array
    low: Array  # of all columns
    high: Array
    target: Array
    fold: NDArray[np.intp]
    products: Products

    def with_base(self, *chosen: int) -> NDArray[np.intp]:
        """Columns of the base and of these hypotheses."""
        return np.concatenate([self.base, *(self.own[one] for one in chosen)])

    def beside(self, other: int) -> _Bench:
        """The same with a hypothesis in the base."""
        return replace(self, base=self.with_base(other))

    def error(self, *chosen: int) -> float:
        """Held-out squared error of the base with these hypotheses."""
        columns = self.with_base(*chosen)
        return float(self.products.held_out(columns, self.low[columns], self.high[columns]).sum())

    def delta_bic(self, *chosen: int) -> float:
        """Evidence for these hypotheses beside the base, from held-out errors."""
        ratio = np.log(max(self.error(), 1e-300) / max(self.error(*chosen), 1e-300))
        independent = self.independent(*chosen) if ratio > _WORTH_A_LOOK else 2.0
        return float(independent * ratio - self.freedom(*chosen) * np.log(independent))

    def freedom(self, *chosen: int) -> int:
        """Number of sizes and of parameters that were searched for."""
        return sum(len(self.own[one]) + self.candidates[one].hidden for one in chosen)

    def independent(self, *chosen: int) -> float:
        """Number of independent windows, from the memory of what these hypotheses leave.

        What a wrong model leaves has the memory of what it lacks, and counts for less.
        """
        columns = self.with_base(*chosen)
        weights = self.products.fit(columns, self.low[columns], self.high[columns])
        left = self.target - self.columns[:, columns] @ weights
        return max(len(left) / correlation_windows(left, self.runs.run), 2.0)

    def predictions(self, columns: NDArray[np.intp]) -> Array:
        """What each fold is predicted to be by the others, shape (windows,)."""
        result = np.empty(len(self.fold))
        folds = np.arange(int(self.fold.max()) + 1)
        for one in folds:
            weights = self.products.fit(columns, self.low[columns], self.high[columns], folds != one)
            test = self.fold == one
            result[test] = self.columns[np.ix_(test, columns)] @ weights
        return result


def name_missing(
    fit: Refit,
    runs: Runs,
    block: NDArray[np.intp],
    seed: int,
    progress: Callable[[str], None],
    schedules: bool = True,
) -> Naming:
    """Name the effects that the recordings ask for beyond the refit.

    Args:
        fit: The refit.
        runs: The runs.
        block: Stretches that count as independent, shape (windows,).
        seed: Seed of placebos and intervals.
        progress: Called with what is being done.
        schedules: Whether effects whose size changes for no recorded reason may be named.
    """
    fold = np.asarray(block % FOLDS)
    columns, (low, high) = fit.jacobian, fit.freedom()
    setting = Setting(runs, fit.parameters, fit.theta, WithEffects(), fit.predicted, runs.observed - fit.predicted)
    material = holding(fit, runs, immaterial(fit, runs))
    named: list[Named] = []
    ranking: tuple[Ranked, ...] = ()
    absorbed: dict[str, float] = {}
    corrected: Corrected | None = None
    while len(named) < _MOST_EFFECTS:
        progress("naming")
        candidates = tuple(terms(setting, tuple(one.term.effect for one in named), schedules))
        bench = _bench(columns, low, high, candidates, setting.residual, runs, fold)
        if corrected is None:
            ranking, absorbed = _rank(bench), _absorbed(bench)
        for found in _best(bench, block, seed):
            if corrected is not None and any(
                one.term.axis != "steady" and follows_motion(corrected, runs, fold, one.held_out_gain, seed)
                for one in found
            ):
                continue  # beside what is named, motion tells as much
            fitted = fit_model(material, [one.term for one in (*named, *found)], runs, block)
            if fitted.all_at_work():
                break
        else:
            break  # nothing passes that has, beside the others, a size that is sure to differ from zero
        named += found
        corrected = fitted
        columns, (low, high) = corrected.jacobian, corrected.freedom()
        within = corrected.model.within(runs, corrected.values)
        theta = corrected.groups.theta
        alone = fit.parameters.predict(runs, theta, within)
        setting = Setting(runs, fit.parameters, theta, within, alone, runs.observed - corrected.predicted)
    return Naming(tuple(named), corrected, ranking, absorbed)


def _bench(
    base: Array, low: Array, high: Array, candidates: tuple[Term, ...], target: Array, runs: Runs,
    fold: NDArray[np.intp],
) -> _Bench:  # fmt: skip
    columns = np.column_stack([base, *(term.columns for term in candidates)])
    ends = np.cumsum([base.shape[1], *(term.columns.shape[1] for term in candidates)])
    return _Bench(
        runs=runs,
        base=np.arange(base.shape[1]),
        own=tuple(np.arange(a, b) for a, b in pairwise(ends)),
        candidates=candidates,
        columns=columns,
        low=np.concatenate([low, *(term.low for term in candidates)]),
        high=np.concatenate([high, *(term.high for term in candidates)]),
        target=target,
        fold=fold,
        products=products(columns, target, fold),
    )


def _rank(bench: _Bench) -> tuple[Ranked, ...]:
    before = bench.error()
    ranked = []
    for index, term in enumerate(bench.candidates):
        gain = 1.0 - bench.error(index) / before if before > 0.0 else 0.0
        ranked.append(Ranked(term.effect, term.axis, bench.delta_bic(index), gain))
    return tuple(sorted(ranked, key=lambda one: -one.delta_bic))


def _absorbed(bench: _Bench) -> dict[str, float]:
    """Share of each effect that the refit takes up: of several forms, the one that shows most counts."""
    gram = bench.products.gram.sum(axis=0)
    base = bench.base
    inverse = np.linalg.pinv(gram[np.ix_(base, base)], rcond=1e-10)
    shares: dict[str, float] = {}
    for own, term in zip(bench.own, bench.candidates, strict=True):
        for column in own:
            size = float(gram[column, column])
            taken = float(gram[column, base] @ inverse @ gram[base, column])
            share = float(np.clip(taken / size, 0.0, 1.0)) if size > 0.0 else 1.0
            shares[term.effect] = min(share, shares.get(term.effect, 1.0))
    return shares


def _best(bench: _Bench, block: NDArray[np.intp], seed: int) -> Iterator[tuple[Named, ...]]:
    """What passes the proof, first the hypothesis that explains most for its freedom, alone or as the stronger half of
    the best pair; then the pair, where neither half is anything without the other; then the next best alone."""
    if not bench.candidates:
        return
    errors = np.array([bench.error(index) for index in range(len(bench.candidates))])
    independent = bench.independent(int(np.argmin(errors)))  # the same for all, so that errors decide
    before = bench.error()

    def score(error: float, *chosen: int) -> float:
        ratio = np.log(max(before, 1e-300) / max(error, 1e-300))
        return float(independent * ratio - bench.freedom(*chosen) * np.log(independent))

    alone = np.array([score(error, index) for index, error in enumerate(errors)])
    order = np.argsort(-alone, kind="stable")
    best = float(alone[order[0]])
    pair: tuple[int, ...] = (int(order[0]),)
    for one, other in combinations(_worth_pairing(order, errors), 2):
        if bench.candidates[one].effect != bench.candidates[other].effect:
            both = score(bench.error(one, other), one, other)
            if both > best + MUST_PAY:
                best, pair = both, (one, other)
    told = _likeliest(bench, _told_by_a_channel(bench, pair[0], errors, before), alone)
    for index in dict.fromkeys([told, pair[0]]):
        found = _proven(bench, index, alone, block, seed)
        if found is not None:
            yield (found,)
    if len(pair) == 2:
        halves = tuple(_proven(bench.beside(other), one, alone, block, seed) for one, other in (pair, pair[::-1]))
        if halves[0] is not None and halves[1] is not None:
            yield halves[0], halves[1]
    for index in order[:_TRIED].tolist():
        found = _proven(bench, index, alone, block, seed)
        if found is not None:
            yield (found,)


def _worth_pairing(order: NDArray[np.intp], errors: Array) -> list[int]:
    """The best for their freedom, then those that explain most: half of a pair may be worth little alone."""
    most = np.argsort(errors, kind="stable")
    return list(dict.fromkeys([*order[:_PAIRED].tolist(), *most[:_PAIRED].tolist()]))


def _told_by_a_channel(bench: _Bench, chosen: int, errors: Array, before: float) -> int:
    """Prefer a cause that a recorded channel tells to a schedule that explains little more.

    A level per stretch follows whatever comes and goes, so it fits at least as well as the cause itself.
    """
    if bench.candidates[chosen].axis == "steady":
        return chosen
    steady = [index for index, term in enumerate(bench.candidates) if term.axis == "steady"]
    if not steady:
        return chosen
    best = min(steady, key=lambda index: errors[index])
    return best if before - errors[best] >= _NEARLY * (before - errors[chosen]) else chosen


def _likeliest(bench: _Bench, chosen: int, alone: Array) -> int:
    """Of hypotheses that the data cannot separate the likeliest beforehand: physics before a fault of an instrument,
    a change that is natural for the effect before another."""

    def rarity(index: int) -> tuple[bool, bool, float]:
        term = bench.candidates[index]
        return term.effect not in PHYSICS, not term.natural, -float(alone[index])

    error = bench.error(chosen)
    equals = [
        index
        for index, term in enumerate(bench.candidates)
        if term.axis == bench.candidates[chosen].axis and bench.error(index) <= _EQUAL * error
    ]
    return min([chosen, *equals], key=rarity)


def _proven(bench: _Bench, chosen: int, alone: Array, block: NDArray[np.intp], seed: int) -> Named | None:
    after = bench.error(chosen)
    share = 1.0 - after / max(bench.error(), 1e-300)
    if bench.delta_bic(chosen) < MUST_PAY or share < SMALLEST_GAIN:
        return None
    without, with_it = (bench.predictions(columns) for columns in (bench.base, bench.with_base(chosen)))
    interval = gain(bench.target, without, with_it, block, seed).ci95
    if interval[0] <= 0.0:
        return None
    p_value = _placebo_p_value(bench, chosen, after, seed)
    if p_value > 1.0 / (PLACEBOS + 1):
        return None
    return Named(
        bench.candidates[chosen], bench.delta_bic(chosen), share, interval, p_value, _rivals(bench, chosen, alone)
    )


def _rivals(bench: _Bench, chosen: int, alone: Array) -> tuple[Term, ...]:
    """Other effects that explain nearly as much: each in its best form, best first."""
    before = bench.error()
    explained = before - bench.error(chosen)
    found: dict[str, Term] = {}
    for index in np.argsort(-alone, kind="stable"):
        other = bench.candidates[index]
        if other.effect == bench.candidates[chosen].effect or alone[index] < MUST_PAY:
            continue
        share = _ALIKE_BY_NATURE if look_alike(other.effect, bench.candidates[chosen].effect, bench.runs) else _ALIKE
        if before - bench.error(int(index)) >= share * explained or alone[chosen] - alone[index] < MUST_PAY:
            found.setdefault(other.effect, other)
    return tuple(found.values())


def _placebo_p_value(bench: _Bench, chosen: int, error: float, seed: int) -> float:
    """Share of placebos, and the effect itself, that predict as well as the effect."""
    rng = np.random.default_rng(seed)
    columns = bench.with_base(chosen)
    everything = np.arange(len(columns))
    as_good = 1
    for _ in range(PLACEBOS):
        shifted = shifted_in_time(bench.columns[:, bench.own[chosen]], rng)
        together = products(np.column_stack([bench.columns[:, bench.base], shifted]), bench.target, bench.fold)
        held_out = together.held_out(everything, bench.low[columns], bench.high[columns])
        as_good += float(held_out.sum()) <= error
    return as_good / (PLACEBOS + 1)


def shifted_in_time(columns: Array, rng: np.random.Generator) -> Array:
    """The columns turned round over all runs by a random time: the same values, no cause."""
    margin = len(columns) // 10
    return np.roll(columns, int(rng.integers(margin, len(columns) - margin)), axis=0)
