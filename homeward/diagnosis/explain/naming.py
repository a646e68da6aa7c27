"""Which physics is missing: sets of effects, each scored at its own joint replay.

Hypotheses are screened by their linear response beside the model so far, alone and in pairs. The most promising are
fitted together with the parameters through the replay, and the simplest set that predicts held-out windows about best
is taken if each of its effects meets the conditions (`homeward.diagnosis.explain.conditions`). So it goes on beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations

import numpy as np
from numpy.random import Generator

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.candidate import Candidate, EffectSet
from homeward.diagnosis.explain.catalogue import terms
from homeward.diagnosis.explain.channel_effects.meter import not_contradicted
from homeward.diagnosis.explain.conditions import BEFORE_PLACEBOS, BEFORE_REPLAYS, CONDITIONS, Condition, judge, passes
from homeward.diagnosis.explain.hypothesis import Setting, Term
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model, immaterial
from homeward.diagnosis.explain.proof import Bench
from homeward.diagnosis.explain.uncertainty import profiled
from homeward.diagnosis.fit.channel_errors import channel_error, power_noise
from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.folds import FOLDS
from homeward.diagnosis.fit.held_out import held_out
from homeward.diagnosis.fit.refit import Refit, holding
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Checked
from homeward.logs.channels import Array, Index

_SINGLES, _WHITE, _PAIRS = 6, 3, 3  # sets fitted in each round, the most promising first; chosen: bounds the time
_WORTH_JUDGING = 0.5  # share of the least gain that a linearised replay must reach; chosen: bounds the time
_DIGITS = 9  # of an error over that of the base, to which sets are compared: above rounding; chosen
_PAIRED = 12  # single hypotheses that are screened in pairs; chosen: 66 pairs, which bounds the time


@dataclass(frozen=True)
class Named:
    """One effect identified in the recordings, and the evidence for it."""

    term: Term
    delta_bic: float  # against the model without it
    held_out_gain: float  # share of the squared held-out error of the model without it
    gain_ci95: tuple[float, float]
    p_value: float  # share of placebos that score as high
    rivals: tuple[Term, ...]  # effects confounded with it, best first
    checks: tuple[Checked, ...] = ()  # values of the conditions


@dataclass(frozen=True)
class Ranked:
    """One hypothesis tried alone, for the report."""

    effect: str
    axis: str
    delta_bic: float
    held_out_gain: float


@dataclass(frozen=True)
class Refused:
    """An effect that was about to be named, and the conditions up to the one that refused it."""

    effect: str
    checks: tuple[Checked, ...]


@dataclass(frozen=True)
class Naming:
    """The named effects and the score of every hypothesis; `absorbed` is each effect's share that the refit absorbs."""

    named: tuple[Named, ...] = ()
    corrected: Corrected | None = None  # the model with them, where any is named
    ranking: tuple[Ranked, ...] = ()
    absorbed: Mapping[str, float] = field(default_factory=dict)
    unrecorded: bool = False  # whether an unrecorded channel may explain the mismatch
    refused: tuple[Refused, ...] = ()
    together: tuple[Checked, ...] = ()  # values of the conditions on all named effects together

    def nothing_named(self) -> Naming:
        """The scores of the hypotheses, with none of them named."""
        return Naming(ranking=self.ranking, absorbed=self.absorbed, refused=self.refused)


def name_missing(
    fit: Refit,
    runs: Runs,
    block: Index,
    rng: Generator,
    progress: Callable[[str], None],
    varying: bool = True,
    without: Collection[str] = (),
) -> Naming:
    """Name the effects that explain the residual of the refit; windows of one block, (windows,), are dependent.

    Effects whose size changes for no recorded reason are tried only if `varying`. Conditions `without` which an
    experiment runs refuse nothing.
    """
    search = _Search(fit, holding(fit, runs, immaterial(fit, runs)), runs, block, rng, varying, without)
    selection = _Selection(EffectSet(fit, runs, block, rng))
    naming = Naming()
    while len(selection.named) < thresholds.MOST_EFFECTS:
        progress("naming")
        bench = search.bench(selection.effects)
        if not selection.named:
            naming = Naming(ranking=_rank(bench), absorbed=bench.absorbed())
        further = search.further(selection, bench)
        if further is None:
            break
        selection = further
    corrected = selection.effects.model if isinstance(selection.effects.model, Corrected) else None
    return replace(naming, named=selection.named, corrected=corrected, refused=tuple(search.refused))


@dataclass(frozen=True)
class _Selection:
    """The effects found so far, fitted together, and the evidence for each."""

    effects: EffectSet
    named: tuple[Named, ...] = ()


@dataclass(frozen=True)
class _Search:
    """The search for sets of effects in some recordings."""

    fit: Refit
    material: Refit  # with those groups held that matter little beside effects
    runs: Runs
    block: Index
    rng: Generator
    varying: bool
    without: Collection[str]
    refused: list[Refused] = field(default_factory=list)

    def bench(self, effects: EffectSet) -> Bench:
        """The hypotheses that can be tried beside these effects."""
        runs, model = self.runs, effects.model
        setting, misread = Setting.of(self.fit, runs), np.zeros(len(runs.observed))
        if isinstance(model, Corrected):
            setting, misread = model.model.setting(runs, model.theta, model.values), model.misread
        setting = replace(setting, residual=runs.observed - model.predicted)
        candidates = terms(setting, tuple(term.effect for term in effects.terms), self.varying)
        candidates = not_contradicted(candidates, model.jacobian, setting, misread, self.block)
        return Bench(
            model, tuple(candidates), runs, setting.residual, self.block, channel_error=channel_error(self.fit, runs)
        )

    def further(self, before: _Selection, bench: Bench) -> _Selection | None:
        """The effects with one or two more: the simplest of the sets that predict about best and meet all
        conditions."""
        tried = self._tried(before.effects, bench)
        base = self.runs.squared_error(self._held_out(before.effects.model))
        refused: list[_Tried] = []  # by the placebos only
        for each in _simplest_first(tried, base):
            if not self._promises(each, tried, before, base) or any(_outdone(each, other, base) for other in refused):
                continue
            standing = [other for other in tried if all(other is not barred for barred in refused)]
            selection, checks = self._judged(before, bench, each, standing)
            if selection is not None:
                return selection
            if checks[-1].condition == "placebo" and len(each.added) == 1:
                refused.append(each)
        return None

    def _promises(self, each: _Tried, tried: Sequence[_Tried], before: _Selection, base: float) -> bool:
        """Whether a set may meet the least gain: by its linearised replay, each of its effects reaches half of it."""
        noise = 0.0 if before.named else power_noise(self.runs)
        least = _WORTH_JUDGING * thresholds.SMALLEST_GAIN_TO_NAME
        if len(each.added) == 1:
            return base - each.squared_error >= least * (base - noise)
        parts = [other.squared_error for other in tried if len(other.added) == 1 and other.added[0] in each.added]
        return all(part - each.squared_error >= least * part for part in parts)

    def _tried(self, before: EffectSet, bench: Bench) -> list[_Tried]:
        """The promising sets beside these effects, each at its own joint replay."""
        has_room = len(before.terms) + 2 <= thresholds.MOST_EFFECTS
        screened = [*_screened(bench), *(_screened_pairs(bench) if has_room else [])]
        return [self._replayed(before, bench, added) for added in screened]

    def _tried_alone(self, before: EffectSet, bench: Bench) -> list[_Tried]:
        """Those of one effect more."""
        return [self._replayed(before, bench, added) for added in _screened(bench)]

    def _replayed(self, before: EffectSet, bench: Bench, added: tuple[int, ...]) -> _Tried:
        forms = tuple(bench.candidates[index] for index in added)
        fitted = fit_model(self.material, [*before.terms, *forms], self.runs, self.block)
        error = self.runs.squared_error(self._held_out(fitted))
        if any(form.axis != "steady" for form in forms):
            # Change points that are searched anew without the held-out windows.
            error = max(error, (1.0 - bench.share(*added)) * bench.squared_error(*added))
        return _Tried(added, forms, fitted, error, all(bench.is_in_steps(index) for index in added))

    def _held_out(self, model: Fitted) -> Array:
        """Held-out prediction, shape (windows,), by the model linearised at its joint replay."""
        return held_out(lambda chosen: model.fitted_to(chosen, self.runs.observed).predicted, self.block % FOLDS)

    def _judged(
        self, before: _Selection, bench: Bench, each: _Tried, tried: Sequence[_Tried]
    ) -> tuple[_Selection | None, tuple[Checked, ...]]:
        """The set with the evidence for each effect that it adds, or None and the checks of one that is refused."""
        as_tried = EffectSet(each.model, self.runs, self.block, self.rng)
        candidates = self._candidates(before, bench, each, tried, as_tried)
        for candidate in candidates:
            checks = self._checks(candidate, BEFORE_REPLAYS)
            if not passes(checks, self.without):
                return None, checks
        # Each in its best form beside the others: a parameter of one may show only there.
        forms = [_with_plain(candidate.bench, candidate.index) for candidate in candidates]
        together = self._fitted([*before.effects.terms, *forms])
        candidates = [
            replace(candidate, with_it=together, find=partial(self._at, candidate.bench, candidate.index))
            for candidate in candidates
        ]
        checked = []
        for candidate in candidates:
            checks = self._checks(candidate, CONDITIONS)
            if not passes(checks, self.without):
                return None, checks
            checked.append(checks)
        named = [
            Named(
                candidate.term,
                candidate.delta_bic,
                candidate.searched_share,
                candidate.gain.ci95,
                candidate.p_value,
                self._rivals(candidate, tried if len(candidates) == 1 else None),
                checks,
            )
            for candidate, checks in zip(candidates, checked, strict=True)
        ]
        return self._without_needless(_Selection(together, (*before.named, *named)), len(named)), checked[-1]

    def _checks(self, candidate: Candidate, conditions: Sequence[Condition[Candidate]]) -> tuple[Checked, ...]:
        checks = judge(candidate, self.without, conditions)
        if not passes(checks, self.without):
            self.refused.append(Refused(candidate.term.effect, checks))
        return checks

    def _candidates(
        self, before: _Selection, bench: Bench, each: _Tried, tried: Sequence[_Tried], with_it: EffectSet
    ) -> list[Candidate]:
        """Each effect that a set adds, beside the set without it."""
        parts = {other.added[0]: other.model for other in tried if len(other.added) == 1}
        candidates = []
        for position, index in enumerate(each.added):
            others = [other for other in each.added if other != index]
            without, at = before.effects, partial(self._at, bench, index)
            if others:
                model = parts.get(others[0]) or self._replayed(before.effects, bench, (others[0],)).model
                without = EffectSet(model, self.runs, self.block, self.rng)
                at = partial(self._beside, without, bench.candidates[index])
            noise = 0.0 if without.terms else power_noise(self.runs)
            candidates.append(Candidate(len(before.named) + position, with_it, without, noise, at))
        return candidates

    @staticmethod
    def _at(bench: Bench, index: int) -> tuple[Bench, int]:
        return bench, index

    def _beside(self, without: EffectSet, form: Term) -> tuple[Bench, int]:
        """The hypotheses beside the other half of a pair, and the best form of this one there."""
        bench = self.bench(without)
        same = [
            index
            for index, candidate in enumerate(bench.candidates)
            if (candidate.effect, candidate.axis) == (form.effect, form.axis)
        ]
        if same:
            return bench, max(same, key=bench.delta_bic)
        # Its schedule is not found again: it stands as it was tried.
        bench = replace(bench, candidates=(*bench.candidates, form))
        return bench, len(bench.candidates) - 1

    def _without_needless(self, selection: _Selection, new: int) -> _Selection:
        """The effects that are still needed beside the `new` effects: without each, held-out windows are predicted
        worse by the least share of what it leaves."""
        named = list(selection.named)
        for old in selection.named[: len(named) - new]:
            rest = [each for each in named if each is not old]
            without = self._fitted([each.term for each in rest])
            gained = 1.0 - selection.effects.squared_error / max(without.squared_error, 1e-300)
            if gained < thresholds.SMALLEST_GAIN_TO_NAME:
                named, selection = rest, _Selection(without, tuple(rest))
        terms_of = selection.effects.terms
        return _Selection(
            selection.effects, tuple(replace(effect, term=term) for effect, term in zip(named, terms_of, strict=True))
        )

    def _fitted(self, forms: Sequence[Term]) -> EffectSet:
        """Effects fitted together, flexible ones in the form of a robot file where that fits as well."""
        if not forms:
            return EffectSet(self.fit, self.runs, self.block, self.rng)
        fitted = fit_model(self.material, forms, self.runs, self.block)
        if any(form.plain is not None for form in forms):
            expressed = fit_model(self.material, [form.plain or form for form in forms], self.runs, self.block)
            errors = [self.runs.squared_error(model.predicted) for model in (expressed, fitted)]
            fitted = expressed if errors[0] <= thresholds.NO_WORSE * errors[1] else fitted
        fitted = profiled(self.material, fitted, self.runs, self.block).model
        return EffectSet(fitted, self.runs, self.block, self.rng)

    def _rivals(self, named: Candidate, tried: Sequence[_Tried] | None) -> tuple[Term, ...]:
        """Other effects whose own joint replay meets the conditions and explains as much as a named one, best first.

        That is nearly all of it or, of effects that are known to be confounded and that no recorded channel
        separates, half of it.
        """
        tried = self._tried_alone(named.without, named.bench) if tried is None else tried
        base = self.runs.squared_error(self._held_out(named.without.model))
        own = self._replayed(named.without, named.bench, (named.index,)).squared_error
        rivals: dict[str, Term] = {}
        for each in sorted((each for each in tried if len(each.added) == 1), key=lambda other: other.squared_error):
            form = each.forms[0]
            alike = form.hypothesis.looks_like(named.term.hypothesis, self.runs)
            least = thresholds.HALF if alike else thresholds.RIVAL_SHARE
            if form.effect == named.term.effect or base - each.squared_error < least * (base - own):
                continue
            with_it = EffectSet(each.model, self.runs, self.block, self.rng)
            at = partial(self._at, named.bench, each.added[0])
            rival = replace(named, place=len(named.without.terms), with_it=with_it, find=at)
            if passes(judge(rival, self.without, BEFORE_PLACEBOS), self.without):
                rivals.setdefault(form.effect, _with_plain(named.bench, each.added[0]))
        return tuple(rivals.values())


@dataclass(frozen=True)
class _Tried:
    """Hypotheses that are added to a set, in their joint replay."""

    added: tuple[int, ...]  # their indices among the hypotheses of the bench
    forms: tuple[Term, ...]
    model: Corrected
    squared_error: float  # held out, summed over windows
    sudden: bool  # whether their sizes change in steps

    @property
    def steady(self) -> bool:
        """Whether recorded channels show all of them."""
        return all(form.axis == "steady" for form in self.forms)

    @property
    def rank(self) -> tuple[int, bool, bool, bool]:
        """Simpler is less: few effects, physics before a fault of an instrument, what channels show before a
        schedule, and a change that is typical of the effect before another."""
        faults = any(not form.hypothesis.physical for form in self.forms)
        return len(self.forms), faults, not self.steady, any(not form.typical for form in self.forms)


def _simplest_first(tried: Sequence[_Tried], base: float) -> list[_Tried]:
    """Sets that predict better than the base: first those that predict about best, the simplest of them first, then
    the others, best first.

    A schedule fits any intermittent cause at least as well as the cause itself: what channels show is preferred though
    it explains less. Two effects of one load and one schedule differ by rounding only: the order of the catalogue
    decides between them.
    """

    def error_then_place(each: _Tried) -> tuple[float, tuple[int, ...]]:
        return round(each.squared_error / base, _DIGITS), each.added

    better = sorted((each for each in tried if each.squared_error < base), key=error_then_place)
    if not better:
        return []
    best = better[0]

    def about_best(each: _Tried) -> bool:
        if each.steady and not best.steady:
            return base - each.squared_error >= thresholds.SIMPLER * (base - best.squared_error)
        return each.squared_error <= thresholds.NO_WORSE * best.squared_error

    first = sorted((each for each in better if about_best(each)), key=lambda each: each.rank)
    return [*first, *(each for each in better if not about_best(each))]


def _outdone(each: _Tried, refused: _Tried, base: float) -> bool:
    """Whether a set that only placebos refuse explains more: what channels show is not barred by a schedule, nor steps
    by a drift."""
    if (each.steady and not refused.steady) or (each.sudden and not refused.sudden):
        return False
    return base - each.squared_error < thresholds.RIVAL_SHARE * (base - refused.squared_error)


def _screened(bench: Bench) -> list[tuple[int, ...]]:
    """Hypotheses that promise most by their linear responses beside the base.

    By BIC and by innovations: a slow cause that is not found makes the residual correlated, and steps stand out of it.
    """
    best = _promising(bench)
    by_innovations = sorted(best, key=bench.innovations_bic, reverse=True)
    steady = [index for index in by_innovations if bench.candidates[index].axis == "steady"]
    in_steps = [index for index in by_innovations if bench.is_in_steps(index)]
    chosen = [*best[:_SINGLES], *steady[:_WHITE], *in_steps[:_WHITE]]
    return [(index,) for index in dict.fromkeys(chosen)]


def _screened_pairs(bench: Bench) -> list[tuple[int, int]]:
    """Pairs of hypotheses that promise most together."""
    effects = [candidate.effect for candidate in bench.candidates]
    best = _promising(bench)
    by_share = sorted(best, key=lambda index: -float(bench.shares[index]))
    tried = dict.fromkeys([*best[:_PAIRED], *by_share[:_PAIRED]])
    pairs = [pair for pair in combinations(tried, 2) if effects[pair[0]] != effects[pair[1]]]
    if not pairs:
        return []
    independent = bench.independent(best[0])
    return sorted(pairs, key=lambda pair: -bench.score(bench.share(*pair), independent, *pair))[:_PAIRS]


def _promising(bench: Bench) -> list[int]:
    """The best form of each effect that explains anything, by BIC, best first."""
    if not bench.candidates:
        return []
    independent = bench.independent(int(np.argmax(bench.shares)))  # the same for all
    scores = np.array([bench.score(float(share), independent, index) for index, share in enumerate(bench.shares)])
    return [index for index in _best_forms(bench, scores) if bench.shares[index] > 0.0]


def _rank(bench: Bench) -> tuple[Ranked, ...]:
    """The best form of each effect and of what its size depends on."""
    best = [(bench.candidates[index], index) for index in _best_forms(bench, bench.shares)]
    ranked = [Ranked(term.effect, term.axis, bench.delta_bic(index), bench.share(index)) for term, index in best]
    return tuple(sorted(ranked, key=lambda row: -row.delta_bic))


def _best_forms(bench: Bench, scores: Array) -> list[int]:
    """The best of each effect and of what its size depends on, best first."""
    first: dict[tuple[str, str], int] = {}
    for index in np.argsort(-scores, kind="stable").tolist():
        term = bench.candidates[index]
        first.setdefault((term.effect, term.axis), index)
    return list(first.values())


def _with_plain(bench: Bench, chosen: int) -> Term:
    """The chosen form; if a robot file cannot express it, with the best form that one can."""
    term = bench.candidates[chosen]
    if not term.flexible:
        return term
    plain = [
        index
        for index, other in enumerate(bench.candidates)
        if other.effect == term.effect and other.axis == "steady" and not other.flexible
    ]
    return replace(term, plain=bench.candidates[max(plain, key=bench.share)]) if plain else term
