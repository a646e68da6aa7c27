"""Which physics is missing: forward selection of hypotheses, fitted together with the refit, alone and in pairs.

A hypothesis must predict held-out stretches better than the refit by a stated share with an interval that excludes
zero, lower the Bayesian information criterion, and score higher than placebos searched in the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, compress, islice

import numpy as np
from numpy.random import Generator

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.catalogue import CATALOGUE, terms
from homeward.diagnosis.explain.change_points import clearly_apart
from homeward.diagnosis.explain.channel_effects import not_contradicted
from homeward.diagnosis.explain.hypothesis import Setting, Term
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model, immaterial, relinearised
from homeward.diagnosis.explain.motion import largest_by_motion
from homeward.diagnosis.explain.proof import Bench
from homeward.diagnosis.explain.uncertainty import profiled
from homeward.diagnosis.fit.channel_errors import channel_error, least_to_name, meter_error, power_noise, unexplained
from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.folds import FOLDS
from homeward.diagnosis.fit.held_out import gain, held_out
from homeward.diagnosis.fit.refit import Refit, holding
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array, Index

_TRIED = 6  # hypotheses that are validated, the best first; chosen: bounds the time
_PAIRED = 12  # single hypotheses that are tried in pairs; chosen: 66 pairs, which bounds the time


@dataclass(frozen=True)
class Named:
    """One effect identified in the recordings, and the evidence for it."""

    term: Term
    delta_bic: float  # against the model without it
    held_out_gain: float  # share of the squared held-out error of the model without it
    gain_ci95: tuple[float, float]
    p_value: float  # share of placebos that score as high
    rivals: tuple[Term, ...]  # effects confounded with it, best first
    sudden: bool  # whether its size changes in steps


@dataclass(frozen=True)
class Ranked:
    """One hypothesis tried alone, for the report."""

    effect: str
    axis: str
    delta_bic: float
    held_out_gain: float


@dataclass(frozen=True)
class Naming:
    """The named effects and the score of every hypothesis; `absorbed` is each effect's share that the refit absorbs."""

    named: tuple[Named, ...] = ()
    corrected: Corrected | None = None  # the model with them, where any is named
    ranking: tuple[Ranked, ...] = ()
    absorbed: Mapping[str, float] = field(default_factory=dict)
    unrecorded: bool = False  # whether an unrecorded channel may explain the mismatch

    def nothing_named(self) -> Naming:
        """The scores of the hypotheses, with none of them named."""
        return Naming(ranking=self.ranking, absorbed=self.absorbed)

    def needs_unrecorded_channel(self, runs: Runs, shown_by: Sequence[str] = ()) -> bool:
        """Whether the first named effect, or else all that `shown_by` show, may be a channel that some run lacks."""
        lacking = [one for one in CATALOGUE.values() if one.map_channel and not runs.has(one.map_channel)]
        if self.named:
            return any(term.hypothesis in lacking for term in (self.named[0].term, *self.named[0].rivals))
        return bool(shown_by) and {*shown_by} <= {channel for one in lacking for channel in one.channels}


def name_missing(
    fit: Refit, runs: Runs, block: Index, rng: Generator, progress: Callable[[str], None], varying: bool = True
) -> Naming:
    """Name the effects that explain the residual of the refit; windows of one block, (windows,), are dependent.

    Effects whose size changes for no recorded reason are tried only if `varying`."""
    selected = _Selection(
        fit, holding(fit, runs, immaterial(fit, runs)), runs, block, rng, channel_error(fit, runs), power_noise(runs)
    )
    naming = Naming()
    instead: Iterator[tuple[Named, ...]] = iter(())  # of the first effect, if it is named alone
    while len(selected.named) < thresholds.MOST_EFFECTS:
        progress("naming")
        bench = selected.bench(varying)
        if not selected.named:
            naming = Naming(ranking=_rank(bench), absorbed=bench.absorbed())
        tried = _best(bench, rng)
        further = next(filter(None, map(selected.with_found, tried)), None)
        if len(selected.named) == 1:
            further = selected.replaced(further, instead) or further
        if further is None:
            break  # no candidate passes with a significant size in the joint replay
        instead = iter(()) if selected.named else tried
        selected = further
    return replace(naming, named=selected.named, corrected=selected.corrected)


@dataclass(frozen=True)
class _Selection:
    """The effects selected so far and their joint fit; what can be selected beside them."""

    fit: Refit
    material: Refit  # with those groups held that matter little beside effects
    runs: Runs
    block: Index
    rng: Generator
    of_channels: float  # squared error expected from errors of the channels
    noise: float  # squared error by noise of power; not beside effects, as a further one may be their misspecification
    named: tuple[Named, ...] = ()
    corrected: Corrected | None = None

    @property
    def model(self) -> Refit | Corrected:
        """The joint fit, or the refit where no effect is selected."""
        return self.corrected or self.fit

    @cached_property
    def by_motion(self) -> float:
        """Share of what the effects leave that motion explains."""
        return 0.0 if self.corrected is None else largest_by_motion(self.corrected, self.runs, self.block, self.rng)

    def bench(self, varying: bool) -> Bench:
        """The hypotheses that can be tried beside the effects."""
        fit, runs, corrected = self.fit, self.runs, self.corrected
        setting, misread = Setting.of(fit, runs), np.zeros(len(runs.observed))
        if corrected is not None:
            setting, misread = corrected.model.setting(runs, corrected.theta, corrected.values), corrected.misread
        setting = replace(setting, residual=runs.observed - self.model.predicted)
        candidates = terms(setting, tuple(one.term.effect for one in self.named), varying)
        candidates = not_contradicted(candidates, self.model.jacobian, setting, misread, self.block)
        candidates += _as_jointly_fitted(candidates, self.model, self.material, self.named, setting, self.block)
        refit_error = float(np.sum((runs.observed - fit.predicted) ** 2))
        return Bench(self.model, tuple(candidates), runs, setting.residual, self.block, refit_error=refit_error,
                     channel_error=self.of_channels, noise=self.noise)  # fmt: skip

    def with_found(self, found: tuple[Named, ...]) -> _Selection | None:
        """The selection with the effects found, where all have a significant size in the joint fit."""
        if not found or (self.named and not all(_beside(one, self.named, lambda: self.by_motion) for one in found)):
            return None
        together, fitted = _fitted(self.material, (*self.named, *found), self.runs, self.block)
        if (at_work := fitted.at_work())[len(self.named) :].all() and not at_work.all():
            # Backward elimination: beside what is found, an effect named before is not significant.
            together, fitted = _fitted(self.material, tuple(compress(together, at_work)), self.runs, self.block)
        significant = fitted.at_work().all() and _draws_energy(fitted, self.runs)
        further = replace(self, named=together, corrected=fitted, noise=0.0)
        return further if significant and further.predicts_better(self, self.noise) else None

    def replaced(self, further: _Selection | None, instead: Iterator[tuple[Named, ...]]) -> _Selection | None:
        """The best pair, the third of `instead`, for the first effect, which may have taken a part of another."""
        if not (unexplained(self.model, self.runs) if further is None else _splits_a_schedule(further.named)):
            return None
        pair = next((found for found in islice(instead, 3) if len(found) != 1), ())
        if not all(_beside(one, pair, float) for one in pair):
            return None
        other = replace(self, named=(), corrected=None).with_found(pair)
        if other is None or 1.0 - _error_ratio(other.model, self.model, self.runs) <= self.by_motion:
            return None
        return other if other.predicts_better(further or self, 0.0) else None

    def predicts_better(self, before: _Selection, noise: float) -> bool:
        """Whether a replay predicts held-out windows better, of which error `noise` is expected from noise of power."""
        runs, fold = self.runs, np.asarray(self.block % FOLDS)
        predicted = [
            held_out(lambda chosen, one=one: one.model.refitted(chosen, runs).replayed(runs), fold)  # type: ignore[misc]
            for one in (before, self)
        ]
        replayed = gain(runs.observed, predicted[0], predicted[1], fold, self.rng)
        squared_error = float(np.sum((runs.observed - predicted[0]) ** 2))
        return replayed.share >= least_to_name(thresholds.SMALLEST_GAIN_TO_NAME, squared_error, noise)


def _splits_a_schedule(named: Sequence[Named]) -> bool:
    """Whether all effects are schedules, and the levels of the last, beside another, are not clearly apart."""
    return (
        len(named) > 1 and all(one.term.axis == "time" for one in named) and not clearly_apart(named[-1].term.schedule)
    )


def _as_jointly_fitted(
    candidates: Sequence[Term], model: Fitted, fit: Refit, named: Sequence[Named], setting: Setting, block: Index
) -> list[Term]:
    """Steady forms as in their joint fits, which may be far from a model without the effect."""
    forms = tuple(one for one in candidates if not one.linear and one.hypothesis.depends_on_force)
    shares = Bench(model, forms, setting.runs, setting.residual, block).shares
    excited = compress(forms, ~np.isclose(shares, 0.0))
    beside = [one.term for one in named]
    fitted = (relinearised(one, fit, beside, setting.runs, block) for one in excited)
    return [one for one in fitted if one is not None]


def _beside(one: Named, named: Sequence[Named], by_motion: Callable[[], float]) -> bool:
    """Whether a further effect is more than misspecification of those named: a schedule must change in steps (beside
    another, in clear ones, or it explains most), and motion must not account for it."""
    if one.term.axis == "time":
        clear = _is_clear(one.term, one.held_out_gain)
        if not one.sudden or not (clear or all(other.term.axis != "time" for other in named)):
            return False
    return one.term.axis == "steady" or by_motion() < one.held_out_gain


def _is_clear(term: Term, gain: float) -> bool:
    """Whether a schedule is more than what others leave by misspecification, of which it explains `gain`."""
    return clearly_apart(term.schedule) or gain >= thresholds.MOST_OF_THE_REST


def _fitted(fit: Refit, named: tuple[Named, ...], runs: Runs, block: Index) -> tuple[tuple[Named, ...], Corrected]:
    """The effects fitted together, flexible ones in the form of a robot file where that fits as well."""
    terms = [one.term for one in named]
    fitted = fit_model(fit, terms, runs, block)
    if any(one.plain is not None for one in terms):
        expressed = fit_model(fit, [one.plain or one for one in terms], runs, block)
        fitted = expressed if _error_ratio(expressed, fitted, runs) <= thresholds.EQUAL else fitted
    fitted = profiled(fit, fitted, runs, block).model
    return tuple(replace(one, term=term) for one, term in zip(named, fitted.model.terms, strict=True)), fitted


def _error_ratio(fitted: Fitted, other: Fitted, runs: Runs) -> float:
    """Squared error of a fit over that of another."""
    error, of_other = (float(np.sum((runs.observed - one.predicted) ** 2)) for one in (fitted, other))
    return error / max(of_other, 1e-300)


def _draws_energy(fitted: Corrected, runs: Runs) -> bool:
    """Whether each schedule adds or saves more energy than the scale error of a power meter."""
    least = thresholds.SMALLEST_SHARE * float(np.abs(runs.observed * runs.duration_s).sum())
    terms = zip(fitted.model.terms, fitted.contribution, strict=True)
    return all(float(np.abs(w * runs.duration_s).sum()) >= least for one, w in terms if one.axis != "steady")


def _rank(bench: Bench) -> tuple[Ranked, ...]:
    """The best form of each effect and of what its size depends on."""
    best = [(bench.candidates[index], index) for index in _best_forms(bench, bench.shares)]
    ranked = [Ranked(term.effect, term.axis, bench.delta_bic(index), bench.share(index)) for term, index in best]
    return tuple(sorted(ranked, key=lambda one: -one.delta_bic))


def _best(bench: Bench, rng: Generator) -> Iterator[tuple[Named, ...]]:
    """Validated hypotheses: that with the lowest BIC, alone or as the stronger half of the best pair; the pair, where
    each half is significant beside the other, else none; the next best alone, by BIC or by innovations."""
    if not bench.candidates:
        return
    shares = bench.shares
    most = _best_forms(bench, shares)
    likely = max(most, key=bench.held_out_bic)
    independent = bench.independent(likely)  # the same for all, so that shares decide the order
    alone = _alone(bench, independent)
    order = _best_forms(bench, alone)
    best = float(alone[order[0]])
    pair: tuple[int, ...] = (order[0],)
    # The lowest BIC, then the largest share: half of a pair may explain little alone.
    for one, other in combinations(dict.fromkeys([*order[:_PAIRED], *most[:_PAIRED]]), 2):
        if bench.candidates[one].effect != bench.candidates[other].effect:
            both = bench.score(bench.share(one, other), independent, one, other)
            if both > best + thresholds.STRONG_BIC:
                best, pair = both, (one, other)
    preferred = _likeliest(bench, _prefer_a_channel(bench, pair[0], shares), alone)
    refused: list[Named] = []  # by the placebos only

    def proven(indices: Sequence[int], whitened: bool = False) -> Iterator[tuple[Named, ...]]:
        """Each alone, if those that only the placebos refuse do not explain more."""
        for index in dict.fromkeys(indices):
            found = _supported(bench, index, alone, independent, rng, whitened)
            if found and found.p_value > thresholds.FALSE_ALARM_RATE:
                refused.append(found)
            elif found and not any(_outdone(found, one) for one in refused):
                yield (found,)

    yield from proven([preferred, pair[0]])
    ordered = (pair, pair[::-1]) if len(pair) == 2 else ()
    halves = [_half(bench.with_base(other), one, independent, rng) for one, other in ordered]
    found = tuple(one for one in halves if one)
    yield found if len({one.term.effect for one in found}) == 2 else ()
    by_innovations = sorted(most, key=bench.innovations_bic, reverse=True)
    in_steps = list(filter(bench.is_in_steps, by_innovations))
    yield from proven([*order[:_TRIED], *in_steps[:_TRIED]])
    # A slow cause that is not found, or only beside this one, makes its residual correlated.
    steady = [one for one in by_innovations if bench.candidates[one].axis == "steady"]
    yield from proven(steady[:_TRIED], whitened=True)


def _outdone(found: Named, refused: Named) -> bool:
    """Whether a refused effect explains more: a schedule is less simple than a channel, and a drift does not refute
    steps."""
    simpler = found.term.axis == "steady" and refused.term.axis != "steady"
    least = (thresholds.SIMPLER if simpler else thresholds.RIVAL_SHARE) * refused.held_out_gain
    return found.held_out_gain < least and (refused.sudden or not found.sudden)


def _alone(bench: Bench, independent: float) -> Array:
    """Reduction of BIC by each hypothesis alone beside the base, shape (hypotheses,)."""
    return np.array([bench.score(share, independent, index) for index, share in enumerate(bench.shares.tolist())])


def _half(bench: Bench, chosen: int, independent: float, rng: Generator) -> Named | None:
    """One of a pair beside the other, or what the data cannot separate from it there and has a higher prior."""
    alone = _alone(bench, independent)
    tried = dict.fromkeys([_likeliest(bench, chosen, alone), chosen])
    found = (_supported(bench, index, alone, independent, rng) for index in tried)
    return next((one for one in found if one and one.p_value <= thresholds.FALSE_ALARM_RATE), None)


def _best_forms(bench: Bench, scores: Array) -> list[int]:
    """The best of each effect and of what its size depends on, best first."""
    first: dict[tuple[str, str], int] = {}
    for index in np.argsort(-scores, kind="stable").tolist():
        term = bench.candidates[index]
        first.setdefault((term.effect, term.axis), index)
    return list(first.values())


def _prefer_a_channel(bench: Bench, chosen: int, shares: Array) -> int:
    """Prefer an effect that a recorded channel shows to a schedule that explains little more.

    A level per stretch fits any intermittent cause, at least as well as the cause itself.
    """
    steady = [index for index, term in enumerate(bench.candidates) if term.axis == "steady"]
    if bench.candidates[chosen].axis == "steady" or not steady:
        return chosen
    best = max(steady, key=lambda index: float(shares[index]))
    return best if shares[best] >= thresholds.SIMPLER * shares[chosen] else chosen


def _likeliest(bench: Bench, chosen: int, alone: Array) -> int:
    """Of hypotheses that the data cannot separate that with the highest prior: physics before a fault of an instrument,
    a change that is typical for the effect before another, a schedule that a channel allows before one at any time."""

    def preference(index: int) -> tuple[bool, bool, float, bool]:
        one, typical = bench.candidates[index].hypothesis, bench.candidates[index].typical
        score = float(alone[index] if bench.candidates[index].axis == "steady" else np.round(alone[index]))
        return not one.physical, not typical, -score, not one.channels

    named = {bench.candidates[index].effect for index in bench.beside}
    equals = [
        index
        for index, term in enumerate(bench.candidates)
        if term.effect not in named
        and term.axis == bench.candidates[chosen].axis
        and 1.0 - bench.shares[index] <= thresholds.EQUAL * (1.0 - bench.shares[chosen])
    ]
    return min([chosen, *equals], key=preference)


def _supported(
    bench: Bench, chosen: int, alone: Array, independent: float, rng: Generator, whitened: bool = False
) -> Named | None:
    """A hypothesis with its evidence, if `whitened` by innovations, where it passes every test but of its p-value."""
    term, share, error = bench.candidates[chosen], bench.share(chosen), bench.squared_error(chosen)
    delta_bic = bench.innovations_bic(chosen) if whitened else bench.delta_bic(chosen)
    least = thresholds.SMALLEST_GAIN_TO_NAME if term.hypothesis.physical else thresholds.SMALLEST_GAIN_OF_A_FAULT
    if delta_bic < thresholds.STRONG_BIC or share < least_to_name(least, error, bench.noise):
        return None
    loose = term.axis == "time" and not _is_clear(term, share)
    of_refit = thresholds.SMALLEST_GAIN * bench.refit_error if loose else 0.0
    of_channels = bench.channel_error * _followed(bench, chosen)
    if share * error < max(of_refit, meter_error(bench.runs)) or share * error <= of_channels:
        return None  # as much may come from another effect's form, or from errors of the instruments
    sudden = bench.is_in_steps(chosen)
    if term.schedule is not None and term.hypothesis.is_sudden and not sudden:
        return None
    without, with_it = bench.predictions(chosen)
    interval = gain(bench.target, without, with_it, bench.block, rng).ci95
    if interval[0] <= 0.0:
        return None
    p_value = bench.p_value(chosen, independent, rng)
    if bench.held_out_bic(chosen) < thresholds.STRONG_BIC:  # identified by innovations: rivals by the same evidence
        alone = np.array([bench.innovations_bic(index) for index in range(len(bench.candidates))])
    rivals = _rivals(bench, chosen, alone)
    return Named(_with_plain(bench, chosen), delta_bic, share, interval, p_value, rivals, sudden)


def _with_plain(bench: Bench, chosen: int) -> Term:
    """The chosen form; if a robot file cannot express it, with the best form that one can."""
    term = bench.candidates[chosen]
    same = [i for i, one in enumerate(bench.candidates) if one.effect == term.effect and one.axis == "steady"]
    plain = [index for index in same if not bench.candidates[index].flexible] if term.flexible else []
    return replace(term, plain=bench.candidates[max(plain, key=bench.share)]) if plain else term


def _followed(bench: Bench, chosen: int) -> float:
    """Share of the channels' errors that a hypothesis may absorb: all by place, where they repeat, and all of what is
    like a slope; in time one independent window for each of its levels."""
    term = bench.candidates[chosen]
    if term.axis != "time":
        return float(term.axis == "place" or bool(term.hypothesis.map_channel))
    changes = 1 if term.schedule is None else term.schedule.changes
    return min(1.0, (changes + 1) / bench.independent(chosen))


def _rivals(bench: Bench, chosen: int, alone: Array) -> tuple[Term, ...]:
    """Other effects that explain nearly as much: each in its best form, best first."""
    explained = bench.share(chosen)
    found: dict[str, Term] = {}
    for index in np.argsort(-alone, kind="stable").tolist():
        other = bench.candidates[index]
        if (
            other.effect == bench.candidates[chosen].effect
            or alone[index] < thresholds.STRONG_BIC
            or index in bench.beside
        ):
            continue
        alike = other.hypothesis.looks_like(bench.candidates[chosen].hypothesis, bench.runs)
        share = thresholds.CONFUSABLE_SHARE if alike else thresholds.RIVAL_SHARE
        beside = bench.share(index)
        doubtful = beside * bench.squared_error(index) <= bench.channel_error * _followed(bench, index)
        if not doubtful and (beside >= share * explained or alone[chosen] - alone[index] < thresholds.STRONG_BIC):
            found.setdefault(other.effect, _with_plain(bench, index))
    return tuple(found.values())
