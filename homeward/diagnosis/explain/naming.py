"""Which physics is missing: sets of effects, each scored at its own joint replay.

Hypotheses are screened by their linear response beside the model so far, alone and in pairs. The
most promising are fitted together with the parameters through the replay, and the simplest set that
predicts held-out windows about best is taken if each of its effects meets the conditions
(`homeward.diagnosis.explain.conditions`). So it goes on beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations

import numpy as np
from numpy.random import Generator

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.candidate import Candidate, EffectSet
from homeward.diagnosis.explain.catalogue import terms
from homeward.diagnosis.explain.change_points import Schedule
from homeward.diagnosis.explain.channel_effects.meter import not_contradicted
from homeward.diagnosis.explain.conditions import (
    BEFORE_PLACEBOS,
    BEFORE_REPLAYS,
    CONDITIONS,
    Condition,
    judge,
    passes,
)
from homeward.diagnosis.explain.hypothesis import Setting, Term
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model, immaterial
from homeward.diagnosis.explain.named import Named, Naming, Ranked, Refused
from homeward.diagnosis.explain.proof import Bench
from homeward.diagnosis.explain.uncertainty import profiled
from homeward.diagnosis.fit.channel_errors import channel_error, power_noise
from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.folds import FOLDS
from homeward.diagnosis.fit.held_out import held_out
from homeward.diagnosis.fit.refit import Refit, holding
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Checked
from homeward.logs.channels import Array, Index, Mask

# Sets fitted in each round, the most promising first; chosen: bounds the time.
_SINGLES = 6
_BY_INNOVATIONS = 3
_PAIRS = 3
# share of the least gain that a linearised replay must reach; chosen: bounds the time
_WORTH_JUDGING = 0.5
_DIGITS = 9  # of an error over that of the base, to which sets are compared: above rounding; chosen
# single hypotheses that are screened in pairs; chosen: 66 pairs, which bounds the time
_PAIRED = 12


def name_missing(
    fit: Refit,
    runs: Runs,
    block: Index,
    rng: Generator,
    progress: Callable[[str], None],
    varying: bool = True,
    waived: Collection[str] = (),
) -> Naming:
    """Name the effects that explain the residual of the refit; windows of one block, (windows,),
    are dependent.

    Effects whose size changes for no recorded reason are tried only if `varying`. Conditions that
    an experiment has `waived` refuse nothing.
    """
    material = holding(fit, runs, immaterial(fit, runs))
    search = _Search(
        fit=fit, material=material, runs=runs, block=block, rng=rng, varying=varying, waived=waived
    )
    selection = _Selection(EffectSet(fit, runs, block, rng))
    naming = Naming()
    while len(selection.named) < thresholds.MOST_EFFECTS:
        progress("naming")
        bench = search.bench(selection.effects)
        if not selection.named:
            naming = Naming(ranking=_rank(bench), absorbed=bench.absorbed())
        extended = search.extended(selection, bench)
        if extended is None:
            break
        selection = extended
    model = selection.effects.model
    # Where nothing is named, the set is empty and its model the refit.
    corrected = model if isinstance(model, Corrected) else None
    named = search.with_rivals_among_them(selection)
    return replace(naming, named=named, corrected=corrected, refused=tuple(search.refused))


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
    waived: Collection[str]  # conditions that refuse nothing
    refused: list[Refused] = field(default_factory=list)

    def bench(self, effects: EffectSet) -> Bench:
        """The hypotheses that can be tried beside these effects."""
        model = effects.model
        residual = self.runs.observed - model.predicted
        setting = Setting.of(self.fit, self.runs)
        misread = np.zeros(len(residual))
        # Further effects act on the robot with those that are named.
        if isinstance(model, Corrected):
            setting = model.model.setting(self.runs, model.theta, model.values)
            misread = model.misread
        setting = replace(setting, residual=residual)
        effects_in_model = tuple(term.effect for term in effects.terms)
        candidates = terms(setting, leave_out=effects_in_model, varying=self.varying)
        candidates = not_contradicted(candidates, model.jacobian, setting, misread, self.block)
        return Bench(
            model=model,
            candidates=tuple(candidates),
            runs=self.runs,
            target=residual,
            block=self.block,
            channel_error=channel_error(self.fit, self.runs),
        )

    def extended(self, selection: _Selection, bench: Bench) -> _Selection | None:
        """The effects with one or two more: the simplest of the sets that predict about best and
        meet all conditions."""
        trials = self._trials(selection.effects, bench)
        base_error = self._held_out_error(selection.effects.model)
        standing = trials
        no_better_than_placebos: list[_Trial] = []
        for trial in _simplest_first(trials, base_error):
            if not self._promises(trial, trials, selection, base_error):
                continue
            if any(_outdone(trial, refused, base_error) for refused in no_better_than_placebos):
                continue
            judged, checks = self._judged(selection, bench, trial, standing)
            if judged is not None:
                return judged
            if checks[-1].condition == "placebo" and trial.is_single:
                no_better_than_placebos.append(trial)
                standing = [rival for rival in standing if rival is not trial]
        return None

    def _promises(
        self, trial: _Trial, trials: Sequence[_Trial], selection: _Selection, base_error: float
    ) -> bool:
        """Whether a set may meet the least gain: by its linearised replay, each of its effects
        reaches half of it."""
        noise = 0.0 if selection.named else power_noise(self.runs)
        least_share = _WORTH_JUDGING * thresholds.SMALLEST_GAIN_TO_NAME
        if trial.is_single:
            return base_error - trial.squared_error >= least_share * (base_error - noise)
        error_of_halves = [
            half.squared_error
            for half in trials
            if half.is_single and half.indices[0] in trial.indices
        ]
        return all(error - trial.squared_error >= least_share * error for error in error_of_halves)

    def _trials(self, effects: EffectSet, bench: Bench) -> list[_Trial]:
        """The promising sets beside these effects, each at its own joint replay."""
        trials = self._trials_of_singles(effects, bench)
        has_room_for_a_pair = len(effects.terms) + 2 <= thresholds.MOST_EFFECTS
        if has_room_for_a_pair:
            trials += [self._replayed(effects, bench, pair) for pair in _screened_pairs(bench)]
        return trials

    def _trials_of_singles(self, effects: EffectSet, bench: Bench) -> list[_Trial]:
        """Those of one effect more."""
        return [self._replayed(effects, bench, single) for single in _screened(bench)]

    def _replayed(self, effects: EffectSet, bench: Bench, indices: tuple[int, ...]) -> _Trial:
        forms = tuple(bench.candidates[index] for index in indices)
        model = self._together([*effects.terms, *forms])
        squared_error = self._held_out_error(model)
        if any(form.axis != "steady" for form in forms):
            # Change points that are searched anew without the held-out windows.
            searched_error = (1.0 - bench.share(*indices)) * bench.squared_error(*indices)
            squared_error = max(squared_error, searched_error)
        return _Trial(
            indices=indices,
            forms=forms,
            model=model,
            squared_error=squared_error,
            sudden=all(bench.is_in_steps(index) for index in indices),
        )

    def _held_out_error(self, model: Fitted) -> float:
        """Squared error of the held-out prediction by the model linearised at its joint replay."""

        def predict(training: Mask) -> Array:
            return model.fitted_to(training, self.runs.observed).predicted

        return self.runs.squared_error(held_out(predict, self.block % FOLDS))

    def _judged(
        self, selection: _Selection, bench: Bench, trial: _Trial, trials: Sequence[_Trial]
    ) -> tuple[_Selection | None, tuple[Checked, ...]]:
        """The set with the evidence for each effect that it adds, or None and the checks of one
        that is refused."""
        as_tried = EffectSet(trial.model, self.runs, self.block, self.rng)
        candidates = self._candidates(selection, bench, trial, trials, as_tried)
        for candidate in candidates:
            checks = self._checks(candidate, BEFORE_REPLAYS)
            if not passes(checks, self.waived):
                return None, checks
        # Each in its best form beside the others: a parameter of one may show only there.
        forms = [_with_plain(candidate.bench, candidate.index) for candidate in candidates]
        effects = self._fitted([*selection.effects.terms, *forms])
        candidates = [
            replace(
                candidate,
                with_it=effects,
                find=partial(self._at_index, candidate.bench, candidate.index),
            )
            for candidate in candidates
        ]
        checks_of_all = []
        for candidate in candidates:
            checks = self._checks(candidate, CONDITIONS)
            if not passes(checks, self.waived):
                return None, checks
            checks_of_all.append(checks)
        # Trials stand beside the selection; each effect of a pair stands beside the other one.
        trials_of_rivals = trials if len(candidates) == 1 else None
        named = [
            self._named(candidate, checks, trials_of_rivals)
            for candidate, checks in zip(candidates, checks_of_all, strict=True)
        ]
        extended = _Selection(effects, (*selection.named, *named))
        return self._without_needless(extended, new=len(named)), checks_of_all[-1]

    def _named(
        self, candidate: Candidate, checks: tuple[Checked, ...], trials: Sequence[_Trial] | None
    ) -> Named:
        """A candidate that meets the conditions, with the evidence for it."""
        return Named(
            term=candidate.term,
            delta_bic=candidate.delta_bic,
            held_out_gain=candidate.searched_share,
            gain_ci95=candidate.gain.ci95,
            p_value=candidate.p_value,
            rivals=self._rivals(candidate, trials),
            checks=checks,
        )

    def _checks(
        self, candidate: Candidate, conditions: Sequence[Condition[Candidate]]
    ) -> tuple[Checked, ...]:
        checks = judge(candidate, self.waived, conditions)
        if not passes(checks, self.waived):
            self.refused.append(Refused(candidate.term.effect, checks))
        return checks

    def _candidates(
        self,
        selection: _Selection,
        bench: Bench,
        trial: _Trial,
        trials: Sequence[_Trial],
        with_it: EffectSet,
    ) -> list[Candidate]:
        """Each effect that a set adds, beside the set without it."""
        models_of_singles = {
            single.indices[0]: single.model for single in trials if single.is_single
        }
        candidates = []
        for position, index in enumerate(trial.indices):
            without = selection.effects
            find = partial(self._at_index, bench, index)
            partners = tuple(partner for partner in trial.indices if partner != index)
            if partners:
                model = models_of_singles.get(partners[0])
                if model is None:
                    model = self._replayed(selection.effects, bench, partners).model
                without = EffectSet(model, self.runs, self.block, self.rng)
                find = partial(self._beside, without, bench.candidates[index])
            candidate = Candidate(
                place=len(selection.named) + position,
                with_it=with_it,
                without=without,
                noise=0.0 if without.terms else power_noise(self.runs),
                find=find,
            )
            candidates.append(candidate)
        return candidates

    @staticmethod
    def _at_index(bench: Bench, index: int) -> tuple[Bench, int]:
        return bench, index

    def _beside(self, without: EffectSet, form: Term) -> tuple[Bench, int]:
        """The hypotheses beside the other half of a pair, and the best form of this one there."""
        bench = self.bench(without)
        forms = [
            index
            for index, candidate in enumerate(bench.candidates)
            if (candidate.effect, candidate.axis) == (form.effect, form.axis)
        ]
        if forms:
            return bench, max(forms, key=bench.delta_bic)
        # Its schedule is not found again: it stands as it was tried.
        bench = replace(bench, candidates=(*bench.candidates, form))
        return bench, len(bench.candidates) - 1

    def _without_needless(self, selection: _Selection, new: int) -> _Selection:
        """The effects that are still needed beside the `new` effects: without each, held-out
        windows are predicted worse by the least share of what it leaves."""
        effects = selection.effects
        named = list(selection.named)
        earlier = selection.named[: len(named) - new]
        for effect in earlier:
            remaining = [needed for needed in named if needed is not effect]
            without = self._fitted([needed.term for needed in remaining])
            gain = 1.0 - effects.squared_error / max(without.squared_error, 1e-300)
            if gain < thresholds.SMALLEST_GAIN_TO_NAME:
                effects = without
                named = remaining
        as_fitted = [
            replace(effect, term=term) for effect, term in zip(named, effects.terms, strict=True)
        ]
        return _Selection(effects, tuple(as_fitted))

    def with_rivals_among_them(self, selection: _Selection) -> tuple[Named, ...]:
        """The named effects; each that explains another's schedule nearly as well by a further size
        at its times is a rival of it: a load that grows looks like two loads."""
        if len(selection.named) < 2:
            return selection.named
        terms = selection.effects.terms
        error = self._held_out_error(self._together(terms))
        named = []
        for place, effect in enumerate(selection.named):
            others = [term for term in terms if term is not terms[place]]
            rivals = {rival.effect: rival for rival in effect.rivals}
            for other in self._resized_instead(terms[place], others, error):
                rivals.setdefault(other.effect, other)
            named.append(replace(effect, rivals=tuple(rivals.values())))
        return tuple(named)

    def _resized_instead(self, term: Term, others: Sequence[Term], error: float) -> list[Term]:
        """Those of the other effects that explain nearly as much as a schedule does, beside them
        all: `error` is that with it."""
        candidates = [other for other in others if other.load is not None]
        if term.axis != "time" or term.schedule is None or not candidates:
            return []
        error_without = self._held_out_error(self._together(others))
        rivals = []
        for candidate in candidates:
            resized = _resized(candidate, term.schedule)
            beside = [resized if other is candidate else other for other in others]
            explained = error_without - self._held_out_error(self._together(beside))
            if explained >= thresholds.RIVAL_SHARE * (error_without - error):
                rivals.append(candidate)
        return rivals

    def _together(self, forms: Sequence[Term]) -> Corrected:
        """Effects fitted together, each in its form, with the parameters."""
        return fit_model(self.material, forms, self.runs, self.block)

    def _fitted(self, forms: Sequence[Term]) -> EffectSet:
        """Effects fitted together, flexible ones in the form of a robot file where that fits as
        well."""
        if not forms:
            return EffectSet(self.fit, self.runs, self.block, self.rng)
        model = self._together(forms)
        if any(form.plain is not None for form in forms):
            plain_forms = [form.plain or form for form in forms]
            plain = self._together(plain_forms)
            plain_error = self.runs.squared_error(plain.predicted)
            if plain_error <= thresholds.NO_WORSE * self.runs.squared_error(model.predicted):
                model = plain
        model = profiled(self.material, model, self.runs, self.block).model
        return EffectSet(model, self.runs, self.block, self.rng)

    def _rivals(self, named: Candidate, trials: Sequence[_Trial] | None) -> tuple[Term, ...]:
        """Other effects whose own joint replay meets the conditions and explains as much as a named
        one, best first.

        That is nearly all of it or, of effects that are known to be confounded and that no recorded
        channel separates, half of it. Without `trials` beside the set without it, those of single
        effects are made.
        """
        if trials is None:
            trials = self._trials_of_singles(named.without, named.bench)
        base_error = self._held_out_error(named.without.model)
        explained = (
            base_error - self._replayed(named.without, named.bench, (named.index,)).squared_error
        )
        singles = [trial for trial in trials if trial.is_single]
        rivals: dict[str, Term] = {}
        for trial in sorted(singles, key=lambda single: single.squared_error):
            (form,) = trial.forms
            if form.effect == named.term.effect:
                continue
            confounded = form.hypothesis.looks_like(named.term.hypothesis, self.runs)
            least_share = thresholds.HALF if confounded else thresholds.RIVAL_SHARE
            if base_error - trial.squared_error < least_share * explained:
                continue
            (index,) = trial.indices
            rival = replace(
                named,
                place=len(named.without.terms),
                with_it=EffectSet(trial.model, self.runs, self.block, self.rng),
                find=partial(self._at_index, named.bench, index),
            )
            if passes(judge(rival, self.waived, BEFORE_PLACEBOS), self.waived):
                rivals.setdefault(form.effect, _with_plain(named.bench, index))
        return tuple(rivals.values())


@dataclass(frozen=True)
class _Trial:
    """Hypotheses that are added to a set, in their joint replay."""

    indices: tuple[int, ...]  # among the hypotheses of the bench
    forms: tuple[Term, ...]
    model: Corrected
    squared_error: float  # held out, summed over windows
    sudden: bool  # whether their sizes change in steps

    @property
    def is_single(self) -> bool:
        """Whether it adds one effect, and no pair."""
        return len(self.indices) == 1

    @property
    def steady(self) -> bool:
        """Whether recorded channels show all of them."""
        return all(form.axis == "steady" for form in self.forms)

    @property
    def rank(self) -> tuple[int, bool, bool, bool]:
        """Simpler is less: few effects, physics before a fault of an instrument, what channels show
        before a schedule, and a change that is typical of the effect before another."""
        has_a_fault = any(not form.hypothesis.physical for form in self.forms)
        is_atypical = any(not form.typical for form in self.forms)
        return len(self.forms), has_a_fault, not self.steady, is_atypical


def _simplest_first(trials: Sequence[_Trial], base_error: float) -> list[_Trial]:
    """Sets that predict better than the base: first those that predict about best, the simplest of
    them first, then the others, best first.

    Two effects of one load and one schedule differ by rounding only: the order of the catalogue
    decides between them.
    """

    def error_then_place(trial: _Trial) -> tuple[float, tuple[int, ...]]:
        return round(trial.squared_error / base_error, _DIGITS), trial.indices

    better = sorted(
        (trial for trial in trials if trial.squared_error < base_error), key=error_then_place
    )
    if not better:
        return []
    largest_error = thresholds.NO_WORSE * better[0].squared_error
    about_best = [trial for trial in better if trial.squared_error <= largest_error]
    worse = better[len(about_best) :]
    return [*sorted(about_best, key=lambda trial: trial.rank), *worse]


def _outdone(trial: _Trial, refused: _Trial, base_error: float) -> bool:
    """Whether a set that only placebos refuse explains more: what channels show is not barred by a
    schedule, nor steps by a drift."""
    if trial.steady and not refused.steady:
        return False
    if trial.sudden and not refused.sudden:
        return False
    return base_error - trial.squared_error < thresholds.RIVAL_SHARE * (
        base_error - refused.squared_error
    )


def _screened(bench: Bench) -> list[tuple[int, ...]]:
    """Hypotheses that promise most by their linear responses beside the base.

    By BIC and by innovations: a slow cause that is not found makes the residual correlated, and
    steps stand out of it.
    """
    by_bic = _promising(bench)
    by_innovations = sorted(by_bic, key=bench.innovations_bic, reverse=True)
    steady = [index for index in by_innovations if bench.candidates[index].axis == "steady"]
    in_steps = [index for index in by_innovations if bench.is_in_steps(index)]
    screened = [*by_bic[:_SINGLES], *steady[:_BY_INNOVATIONS], *in_steps[:_BY_INNOVATIONS]]
    return [(index,) for index in dict.fromkeys(screened)]


def _screened_pairs(bench: Bench) -> list[tuple[int, int]]:
    """Pairs of hypotheses that promise most together."""
    by_bic = _promising(bench)
    by_share = sorted(by_bic, key=lambda index: -float(bench.shares[index]))
    screened = dict.fromkeys([*by_bic[:_PAIRED], *by_share[:_PAIRED]])
    pairs = [
        (index, partner)
        for index, partner in combinations(screened, 2)
        if bench.candidates[index].effect != bench.candidates[partner].effect
    ]
    if not pairs:
        return []
    independent = bench.independent(by_bic[0])

    def score(pair: tuple[int, int]) -> float:
        return bench.score(bench.share(*pair), independent, *pair)

    return sorted(pairs, key=lambda pair: -score(pair))[:_PAIRS]


def _promising(bench: Bench) -> list[int]:
    """The best form of each effect that explains anything, by BIC, best first."""
    if not bench.candidates:
        return []
    independent = bench.independent(int(np.argmax(bench.shares)))  # the same for all
    scores = np.array(
        [bench.score(float(share), independent, index) for index, share in enumerate(bench.shares)]
    )
    return [index for index in _best_forms(bench, scores) if bench.shares[index] > 0.0]


def _rank(bench: Bench) -> tuple[Ranked, ...]:
    """The best form of each effect and of what its size depends on."""
    ranked = []
    for index in _best_forms(bench, bench.shares):
        term = bench.candidates[index]
        row = Ranked(
            effect=term.effect,
            axis=term.axis,
            delta_bic=bench.delta_bic(index),
            held_out_gain=bench.share(index),
        )
        ranked.append(row)
    return tuple(sorted(ranked, key=lambda row: -row.delta_bic))


def _best_forms(bench: Bench, scores: Array) -> list[int]:
    """The best of each effect and of what its size depends on, best first."""
    best_form: dict[tuple[str, str], int] = {}
    for index in np.argsort(-scores, kind="stable").tolist():
        term = bench.candidates[index]
        best_form.setdefault((term.effect, term.axis), index)
    return list(best_form.values())


def _resized(term: Term, schedule: Schedule) -> Term:
    """An effect with a load that has a further size at each level of a schedule."""
    assert term.load is not None and term.at_work is not None
    at_work = schedule.at_work()
    low, high = term.hypothesis.limits(schedule.levels - 1, term.hypothesis.signed)
    return replace(
        term,
        columns=np.column_stack([term.columns, term.load[:, None] * at_work]),
        low=np.concatenate([term.low, low]),
        high=np.concatenate([term.high, high]),
        at_work=np.column_stack([term.at_work, at_work]),
    )


def _with_plain(bench: Bench, index: int) -> Term:
    """This form; if a robot file cannot express it, with the best form that one can."""
    term = bench.candidates[index]
    if not term.flexible:
        return term
    plain_forms = [
        number
        for number, candidate in enumerate(bench.candidates)
        if candidate.effect == term.effect and candidate.axis == "steady" and not candidate.flexible
    ]
    if not plain_forms:
        return term
    best_plain_form = max(plain_forms, key=bench.share)
    return replace(term, plain=bench.candidates[best_plain_form])
