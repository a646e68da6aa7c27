"""Numbers of an effect that recordings leave open: which others fit as well, and what all of these have in common.

An effect has numbers beside its size: the temperature below which a battery loses capacity, the share of a computer's
power that any sensing takes. Each is tried over its whole range and the model fitted anew (profile likelihood). Where
others fit as well, intervals span all of them, and what goes with them is known as a product or a sum only.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np
from scipy.stats import chi2

from homeward.diagnosis import rules
from homeward.diagnosis.explain.hypothesis import TINY, Setting, Term
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model
from homeward.diagnosis.explain.uncertainty import joint
from homeward.diagnosis.fit.folds import independent_windows
from homeward.diagnosis.fit.parameter_groups import WithEffects
from homeward.diagnosis.fit.refit import Estimate, Refit, estimates
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.channels import Index
from homeward.diagnosis.result import Product, Value

_TRIED = 9  # values of a number over its range
_AS_LIKELY = float(chi2.ppf(0.95, 1))  # twice the logarithm of a ratio of likelihoods
_SIGNS: Mapping[int, Literal["product", "ratio"]] = {1: "product", -1: "ratio"}


@dataclass(frozen=True)
class Open:
    """A fitted model, of all that fit as well the one that asks for least change of the robot file, and the others."""

    model: Corrected
    others: tuple[Corrected, ...] = ()

    @property
    def spanning(self) -> Corrected:
        """The model, with intervals of its effects' numbers that span those of all."""
        return _spanning([self.model, *self.others]) if self.others else self.model

    def spanned(self, found: Sequence[Estimate], runs: Runs, block: Index) -> tuple[Estimate, ...]:
        """Estimates of the groups by the model; one that is another in other models is confounded with the effects."""
        others = [estimates(one, runs, block) for one in self.others]
        effects = tuple(dict.fromkeys(one.effect for one in self.model.model.terms))
        result = []
        for index, own in enumerate(found):
            values = [one[index].fitted for one in others]
            if own.ci95 is not None and any(v is None or not own.ci95[0] <= v <= own.ci95[1] for v in values):
                own = replace(own, fitted=None, ci95=None, status="confounded", mixed_with=effects, off=False)
            result.append(own)
        return tuple(result)

    def products(self, runs: Runs, block: Index) -> tuple[Product, ...]:
        """What is the same in all models while its parts are not: products of numbers, and sums of mean powers."""
        if not self.others:
            return ()
        models = (self.model, *self.others)
        known = joint(self.model, runs, block)
        error = dict(zip(known.names, np.sqrt(np.diag(known.covariance)) / np.abs(known.values), strict=True))
        units = dict(zip(known.names, known.units, strict=True))
        groups = {one.symbol for one in self.model.parameters.groups}
        numbers, powers = [_numbers(one, runs, block) for one in models], [_mean_powers(one, runs) for one in models]
        found = []
        logs = [{name: float(np.log(value)) for name, value in one.items() if value > 0.0} for one in numbers]
        for sign, together in _SIGNS.items():
            for one, other in _constant(logs, 1.0, sign):
                if one in groups and other in groups:
                    continue
                value = numbers[0][one] * numbers[0][other] ** sign
                wide = 1.96 * value * float(np.hypot(error.get(one, 0.0), error.get(other, 0.0)))
                unit = f"({units.get(one, '1')}){'' if sign > 0 else '/'}({units.get(other, '1')})".replace("(1)", "")
                found.append(Product((one, other), Value(value, (value - wide, value + wide), unit), together))
        for pair in _constant(powers, float(np.mean(np.abs(runs.observed)))):
            value = sum(powers[0][name] for name in pair)
            wide = 1.96 * sum(powers[0][name] * error.get(name, 0.0) for name in pair) + rules.ALIKE_PRODUCT * value
            found.append(Product(pair, Value(value, (value - wide, value + wide), runs.unit), "mean power"))
        return tuple(found)


def profiled(fit: Refit, model: Corrected, runs: Runs, block: Index) -> Open:
    """Try other numbers of the effects of a model, beside a refit that holds the groups which the model holds."""
    terms = model.model.terms
    found = [model, *(fit_model(fit, other, runs, block) for other in _other_terms(fit, terms, runs))]
    best = min(found, key=lambda one: _error(one, runs))
    if best is not model:  # go on from there
        started = [replace(one, hypothesis=of.hypothesis) for one, of in zip(best.model.terms, terms, strict=True)]
        best = min(best, fit_model(fit, started, runs, block), key=lambda one: _error(one, runs))
    left = runs.observed - best.predicted
    independent = independent_windows(left, runs.run)
    most = _error(best, runs) * float(np.exp(_AS_LIKELY / independent))
    most = max(most, _error(best, runs) + rules.SMALLEST_SHARE**2 * float(runs.observed @ runs.observed))
    alike = [one for one in found if _error(one, runs) <= most]
    if len(alike) < 3:
        return Open(best)  # a neighbour at most is as likely: the numbers are determined
    start, scale = fit.parameters.start, fit.parameters.scale
    alike.sort(key=lambda one: float(np.sum(((one.theta - start) / scale) ** 2)))
    return Open(alike[0], tuple(alike[1:]))


def _error(model: Corrected, runs: Runs) -> float:
    return float(np.sum((runs.observed - model.predicted) ** 2))


def _other_terms(fit: Refit, terms: Sequence[Term], runs: Runs) -> Iterator[list[Term]]:
    """The terms with another value of one of their numbers."""
    setting = Setting(runs, fit.parameters, fit.theta, WithEffects(), fit.predicted, runs.observed - fit.predicted)
    for index, term in enumerate(terms):
        one = term.hypothesis
        if term.axis != "steady" or term.fixed or not one.physical or one.of_the_day:
            continue
        for number in one.entry.parameters[1:]:
            if number.name in one.reach(runs):
                continue
            for value in np.linspace(number.low, number.high, _TRIED).tolist():
                shape = {**term.shape, number.name: value}
                columns = setting.response(one, TINY * one.entry.switch.high, shape)[:, None]
                if columns.any():
                    other = replace(term, hypothesis=replace(one, searched=()), shape=shape, columns=columns)
                    yield [*terms[:index], other, *terms[index + 1 :]]


def _spanning(alike: Sequence[Corrected]) -> Corrected:
    """The first of some models, with intervals that span those of all, up to the next number that was tried."""
    first, spans = alike[0], {}
    for index, term in enumerate(first.model.terms):
        numbers = [one.parameters_of(index) for one in alike]
        for number in term.hypothesis.entry.parameters:
            if number.name in term.shape:
                step = (number.high - number.low) / (_TRIED - 1)
                shapes = [one.model.terms[index].shape[number.name] for one in alike]
                spans[term.effect, number.name] = (
                    max(min(shapes) - step, number.low),
                    min(max(shapes) + step, number.high),
                )
        for name in {*numbers[0]} - {*term.shape}:
            low, high = np.transpose([one[name].ci95 for one in numbers])
            spans[term.effect, name] = (float(low.min()), float(high.max()))
    terms = tuple(
        replace(term, spread={**term.spread, **{name: spans[term.effect, name] for name in term.shape}})
        for term in first.model.terms
    )
    ci95 = [spans[one.effect, one.parameter] for one in first.model.unknowns]
    return replace(first, model=replace(first.model, terms=terms), ci95=tuple(ci95))


def _numbers(model: Corrected, runs: Runs, block: Index) -> dict[str, float]:
    """Numbers of the groups that are fitted and of the effects, by name."""
    known = joint(model, runs, block)
    found = {f"{term.effect} {name}": value for term in model.model.terms for name, value in term.shape.items()}
    return found | dict(zip(known.names, known.values.tolist(), strict=True))


def _mean_powers(model: Corrected, runs: Runs) -> dict[str, float]:
    """Mean power of each group that is fitted and of each effect, by name."""
    problem, active = model.parameters, model.parameters.active()
    of_groups = model.groups.jacobian.mean(axis=0) * model.theta[active] / problem.scale[active]
    free = {problem.groups[index].symbol: float(of_groups[index]) for index in np.flatnonzero(~model.groups.held)}
    effects = zip(model.model.terms, model.contribution, strict=True)
    return free | {term.effect: float(contribution.mean()) for term, contribution in effects}


def _constant(models: Sequence[Mapping[str, float]], scale: float, sign: int = 1) -> list[tuple[str, str]]:
    """Pairs of names whose values differ from model to model by a share of the scale, but whose sum, or difference by
    the sign, does not."""
    vary = [
        name
        for name in models[0]
        if all(name in one for one in models) and np.std([one[name] for one in models]) > rules.ALIKE_PRODUCT * scale
    ]
    sums = {(a, b): [one[a] + sign * one[b] for one in models] for a, b in combinations(vary, 2)}
    return [pair for pair, values in sums.items() if np.std(values) <= rules.ALIKE_PRODUCT * scale]
