"""Uncertainty of a fit: joint covariance, combinations that alone are identifiable, range.

An effect has parameters beside its size: the temperature below which a battery loses capacity, the share of a
computer's power that any sensing draws. Each is tried over its whole range and the model fitted anew (profile
likelihood). Where others fit as well, intervals span all of them, and only products or sums with them are identifiable.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.random import Generator
from scipy.stats import chi2

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.hypothesis import SMALL_STEP, TINY, Setting, Term
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model
from homeward.diagnosis.fit.channel_errors import meter_error
from homeward.diagnosis.fit.held_out import bootstrap
from homeward.diagnosis.fit.refit import Estimate, Refit, covariance, estimates
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Combination, Product, Range, Value
from homeward.logs.autocorrelation import independent_windows
from homeward.logs.channels import Array, Index
from homeward.physics import Robot, d_max

_TRIED = 9  # values of a number over its range; chosen: steps of an eighth
_AS_LIKELY = float(chi2.ppf(1.0 - thresholds.SIGNIFICANT, 1))  # least likelihood-ratio statistic that is significant
_SIGNS: Mapping[int, Combination] = {1: "product", -1: "ratio"}


@dataclass(frozen=True)
class Joint:
    """Everything that was fitted together: names, values in their units, and covariance, shape (numbers, numbers)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    covariance: Array


def joint(model: Refit | Corrected, runs: Runs, block: Index) -> Joint:
    """Joint covariance of fitted groups and sizes, clustered by block, shape (windows,), without held groups."""
    groups, problem = model.groups, model.parameters
    free = np.flatnonzero(~groups.held)
    to_group = problem.to_group[free]
    columns = np.column_stack([groups.jacobian[:, free], model.beside])
    unit = np.concatenate([problem.scale[free] * to_group, np.ones(model.beside.shape[1])])
    found = covariance(columns, runs.observed - model.predicted, block) * np.outer(unit, unit)
    names = [problem.groups[index].symbol for index in free]
    units = [problem.groups[index].unit for index in free]
    values = (model.theta[free] * to_group).tolist()
    if isinstance(model, Corrected):
        names += [f"{one.effect} {one.parameter}" for one in model.model.unknowns]
        units += [one.unit for one in model.model.unknowns]
        values += model.values.tolist()
    return Joint(tuple(names), tuple(units), np.array(values), found)


def _with_groups(model: Corrected, known: Joint, runs: Runs) -> list[Product]:
    """Products of a held group and an effect whose contribution is proportional to it."""
    problem, theta = model.parameters, model.theta
    found = []
    for index in np.flatnonzero(model.groups.held):
        group, larger = problem.groups[index], theta.copy()
        larger[index] *= 1.0 + SMALL_STEP
        with_more = model.model.predict(runs, larger, model.values)
        column = with_more - model.predicted
        for number, one in enumerate(model.model.unknowns):
            added = model.contribution[one.term]
            more = with_more - model.model.predict(runs, larger, model.values, leave_out=one.term) - added
            scales = float(more @ added) / max(SMALL_STEP * float(added @ added), 1e-300)
            cosine = float(column @ added) / max(float(np.linalg.norm(column) * np.linalg.norm(added)), 1e-300)
            if cosine > thresholds.CONFOUNDED and scales > thresholds.CONFOUNDED and one.column is not None:
                name = f"{one.effect} {one.parameter}"
                assumed, at_joint = float(theta[index] * problem.to_group[index]), known.names.index(name)
                wide = thresholds.NORMAL_95 * (assumed * float(np.sqrt(max(known.covariance[at_joint, at_joint], 0.0))))
                unit = group.unit if one.unit == "1" else f"{group.unit} {one.unit}"
                found.append(_product((group.symbol, name), assumed * float(model.values[number]), wide, unit))
    return found


def _powers(model: Corrected, kept: Joint, runs: Runs) -> list[Product]:
    """Mean power of each effect of which two parameters are confounded."""
    deviation = np.sqrt(np.maximum(np.diag(kept.covariance), 0.0))
    correlation = kept.covariance / np.maximum(np.outer(deviation, deviation), 1e-300)
    first = len(kept.names) - len(model.model.unknowns)
    found = []
    for index, term in enumerate(model.model.terms):
        mine = [first + at for at in model.model.of(index)]
        pairs = [(a, b) for a, b in combinations(mine, 2) if abs(correlation[a, b]) > thresholds.CONFOUNDED]
        if not pairs or term.hypothesis.is_weather:
            continue
        mean = float(np.average(model.contribution[index], weights=runs.duration_s))
        slopes = np.array([model.beside[:, at - first].mean() for at in mine])
        error = float(np.sqrt(slopes @ kept.covariance[np.ix_(mine, mine)] @ slopes))
        names = tuple(dict.fromkeys(kept.names[at] for pair in pairs for at in pair))
        found.append(_product(names, mean, thresholds.NORMAL_95 * error, runs.unit, "mean power"))
    return found


def _product(of: tuple[str, ...], value: float, wide: float, unit: str, together: Combination = "product") -> Product:
    return Product(of, Value(value, (value - wide, value + wide), unit), together)


def recorded_range(robots: Sequence[Robot], predictions: Sequence[Array], runs: Runs, rng: Generator) -> Range | None:
    """Range of a robot that continues to drive as recorded, m; None for motor current or without driving.

    Usable energy over energy per metre: as recorded, and as two robot files, the given one and corrected.toml, predict
    for the same trips, shape (windows,) each. The interval is by bootstrap over runs or, of fewer than three,
    over minutes of driving.
    """
    path_m, drawn_j = np.abs(runs.context["speed_mps"]) * runs.duration_s, runs.observed * runs.duration_s
    if runs.unit == "A" or path_m.sum() <= 0.0 or drawn_j.sum() <= 0.0:
        return None
    before, after = robots
    piece = runs.run if len(runs.signals) >= thresholds.FEWEST_RUNS else np.cumsum(runs.duration_s) // 60.0
    number = np.unique(piece, return_inverse=True)[1]
    energy_j, way_m = (np.bincount(number, one) for one in (drawn_j, path_m))
    low, high = bootstrap(
        np.stack([energy_j, way_m]), rng, lambda drawn: (after.usable_energy_j * drawn[1] / drawn[0])[drawn[0] > 0.0]
    )
    nominal_m, file_m = (
        float(robot.usable_energy_j * path_m.sum() / max(float((one * runs.duration_s).sum()), 1e-9))
        for robot, one in zip(robots, predictions, strict=True)
    )
    recorded_m = float(after.usable_energy_j * path_m.sum() / drawn_j.sum())
    return Range(recorded_m, (low, high), nominal_m, file_m, float(d_max(before)), float(d_max(after)))


@dataclass(frozen=True)
class Open:
    """Of the models that fit as well (profile likelihood), the one closest to the robot file, and the others."""

    model: Corrected
    others: tuple[Corrected, ...] = ()

    @property
    def spanning(self) -> Corrected:
        """The model, with intervals of its effects' parameters that span those of all, up to the next value tried."""
        first, alike, spans = self.model, (self.model, *self.others), {}
        if not self.others:
            return first
        for index, term in enumerate(first.model.terms):
            numbers = [one.parameters_of(index) for one in alike]
            for number in term.hypothesis.entry.parameters:
                if number.name in term.shape:
                    step = (number.high - number.low) / (_TRIED - 1)
                    shapes = [one.model.terms[index].shape.get(number.name, number.default) for one in alike]
                    low, high = max(min(shapes) - step, number.low), min(max(shapes) + step, number.high)
                    spans[term.effect, number.name] = (low, high)
            for name in {*numbers[0]} - {*term.shape}:
                lows, highs = np.transpose([one[name].ci95 for one in numbers])
                spans[term.effect, name] = (float(lows.min()), float(highs.max()))
        terms = tuple(
            replace(term, spread={**term.spread, **{name: spans[term.effect, name] for name in term.shape}})
            for term in first.model.terms
        )
        ci95 = tuple(spans[one.effect, one.parameter] for one in first.model.unknowns)
        return replace(first, model=replace(first.model, terms=terms), ci95=ci95)

    def spanned(self, found: Sequence[Estimate], runs: Runs, block: Index) -> tuple[Estimate, ...]:
        """Estimates of the groups by the model; one that differs between models is confounded with the effects."""
        others = [estimates(one, runs, block) for one in self.others]
        effects = tuple(dict.fromkeys(one.effect for one in self.model.model.terms))
        result = []
        for index, own in enumerate(found):
            values = [one[index].fitted for one in others]
            if own.ci95 is not None and any(v is None or not own.ci95[0] <= v <= own.ci95[1] for v in values):
                own = own.confounded(effects)
            result.append(own)
        return tuple(result)

    def products(self, runs: Runs, block: Index) -> tuple[Product, ...]:
        """Identifiable combinations of parameters that are not identifiable alone.

        A held group and an effect proportional to it: their product. Two confounded parameters of one effect: their
        mean power together. And combinations that are equal in all models while their parts are not: products of
        numbers, and sums of mean powers. Windows of different `block`, shape (windows,), count as independent.
        """
        known = joint(self.model, runs, block)
        found = [*_with_groups(self.model, known, runs), *_powers(self.model, known, runs)]
        if not self.others:
            return tuple(found)
        models = (self.model, *self.others)
        error = dict(zip(known.names, np.sqrt(np.diag(known.covariance)) / np.abs(known.values), strict=True))
        units = dict(zip(known.names, known.units, strict=True))
        groups = {one.symbol for one in self.model.parameters.groups}
        numbers, powers = [_numbers(one, runs, block) for one in models], [_mean_powers(one, runs) for one in models]
        logs = [{name: float(np.log(value)) for name, value in one.items() if value > 0.0} for one in numbers]
        for sign, together in _SIGNS.items():
            for one, other in _constant(logs, 1.0, sign):
                if one in groups and other in groups:
                    continue
                value = numbers[0][one] * numbers[0][other] ** sign
                wide = thresholds.NORMAL_95 * value * float(np.hypot(error.get(one, 0.0), error.get(other, 0.0)))
                unit = f"({units.get(one, '1')}){'' if sign > 0 else '/'}({units.get(other, '1')})".replace("(1)", "")
                found.append(_product((one, other), value, wide, unit, together))
        for pair in _constant(powers, float(np.mean(np.abs(runs.observed)))):
            value = sum(powers[0][name] for name in pair)
            own = sum(powers[0][name] * error.get(name, 0.0) for name in pair)
            wide = thresholds.NORMAL_95 * own + thresholds.PRODUCT_SPREAD * value
            found.append(_product(pair, value, wide, runs.unit, "mean power"))
        return tuple(found)


def profiled(fit: Refit, model: Corrected, runs: Runs, block: Index) -> Open:
    """Profile likelihood of the parameters of a model's effects; `fit` holds the groups that the model holds."""
    terms = model.model.terms
    found = [model, *(fit_model(fit, other, runs, block) for other in _other_terms(fit, terms, runs))]
    best = min(found, key=lambda one: _error(one, runs))
    if best is not model:  # go on from there
        started = [replace(one, hypothesis=of.hypothesis) for one, of in zip(best.model.terms, terms, strict=True)]
        best = min(best, fit_model(fit, started, runs, block), key=lambda one: _error(one, runs))
    residual = runs.observed - best.predicted
    independent = independent_windows(residual, runs.run)
    most = _error(best, runs) * float(np.exp(_AS_LIKELY / independent))
    most = max(most, _error(best, runs) + meter_error(runs))
    alike = [one for one in found if _error(one, runs) <= most]
    if len(alike) < 3:
        return Open(best)  # at most one neighbour is as likely: the parameters are identifiable
    start, scale = fit.parameters.start, fit.parameters.scale
    alike.sort(key=lambda one: (float(np.sum(((one.theta - start) / scale) ** 2)), _unusual(one)))
    return Open(alike[0], tuple(alike[1:]))


def _unusual(model: Corrected) -> int:
    """Parameters of its effects that differ from their defaults, such as a limit where none is reached."""
    numbers = ((term, one) for term in model.model.terms for one in term.hypothesis.entry.parameters)
    return sum(term.shape.get(one.name, one.default) != one.default for term, one in numbers)


def _error(model: Corrected, runs: Runs) -> float:
    return float(np.sum((runs.observed - model.predicted) ** 2))


def _other_terms(fit: Refit, terms: Sequence[Term], runs: Runs) -> Iterator[list[Term]]:
    """The terms with another value of one of their parameters."""
    setting = Setting.of(fit, runs)
    for index, term in enumerate(terms):
        one = term.hypothesis
        if term.axis != "steady" or term.fixed or not one.physical or one.is_weather:
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


def _numbers(model: Corrected, runs: Runs, block: Index) -> dict[str, float]:
    """Numbers of the groups that are fitted and of the effects, by name."""
    known = joint(model, runs, block)
    found = {f"{term.effect} {name}": value for term in model.model.terms for name, value in term.shape.items()}
    return found | dict(zip(known.names, known.values.tolist(), strict=True))


def _mean_powers(model: Corrected, runs: Runs) -> dict[str, float]:
    """Mean power of each group that is fitted and of each effect, by name."""
    problem = model.parameters
    of_groups = model.groups.jacobian.mean(axis=0) * model.theta / problem.scale
    free = {problem.groups[index].symbol: float(of_groups[index]) for index in np.flatnonzero(~model.groups.held)}
    effects = zip(model.model.terms, model.contribution, strict=True)
    return free | {term.effect: float(contribution.mean()) for term, contribution in effects}


def _constant(models: Sequence[Mapping[str, float]], scale: float, sign: int = 1) -> list[tuple[str, str]]:
    """Pairs of names whose values vary between models (relative to `scale`) while their sum or difference does not."""
    vary = [
        name
        for name in models[0]
        if all(name in one for one in models)
        and np.std([one[name] for one in models]) > thresholds.PRODUCT_SPREAD * scale
    ]
    sums = {(a, b): [one[a] + sign * one[b] for one in models] for a, b in combinations(vary, 2)}
    return [pair for pair, values in sums.items() if np.std(values) <= thresholds.PRODUCT_SPREAD * scale]
