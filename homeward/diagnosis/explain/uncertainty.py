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
from homeward.physics.effects import Parameter

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

    @property
    def relative_error(self) -> dict[str, float]:
        """Standard errors over the values, by name."""
        errors = np.sqrt(np.diag(self.covariance)) / np.abs(self.values)
        return dict(zip(self.names, errors.tolist(), strict=True))


def joint(model: Refit | Corrected, runs: Runs, block: Index) -> Joint:
    """Joint covariance of fitted groups and sizes, clustered by block, shape (windows,), without held groups."""
    groups, problem = model.groups, model.parameters
    free = np.flatnonzero(~groups.held)
    to_group = problem.to_group[free]
    columns = np.column_stack([groups.jacobian[:, free], model.beside])
    unit = np.concatenate([problem.scale[free] * to_group, np.ones(model.beside.shape[1])])
    in_units = covariance(columns, runs.observed - model.predicted, block) * np.outer(unit, unit)
    names = [problem.groups[index].symbol for index in free]
    units = [problem.groups[index].unit for index in free]
    values = (model.theta[free] * to_group).tolist()
    if isinstance(model, Corrected):
        names += [unknown.name for unknown in model.model.unknowns]
        units += [unknown.unit for unknown in model.model.unknowns]
        values += model.values.tolist()
    return Joint(tuple(names), tuple(units), np.array(values), in_units)


def _with_groups(model: Corrected, known: Joint, runs: Runs) -> list[Product]:
    """Products of a held group and an effect whose contribution is proportional to it."""
    products = []
    for group in np.flatnonzero(model.groups.held):
        for number, unknown in enumerate(model.model.unknowns):
            if unknown.column is not None and _is_proportional(model, runs, int(group), unknown.term):
                products.append(_with_group(model, known, int(group), number))
    return products


def _is_proportional(model: Corrected, runs: Runs, group: int, term: int) -> bool:
    """Whether what a term adds grows in proportion to a group, and looks like what the group does."""
    larger = model.theta.copy()
    larger[group] *= 1.0 + SMALL_STEP
    with_more = model.model.predict(runs, larger, model.values)
    of_group = with_more - model.predicted
    added = model.contribution[term]
    added_more = with_more - model.model.predict(runs, larger, model.values, leave_out=term)
    grows = float((added_more - added) @ added) / max(SMALL_STEP * float(added @ added), 1e-300)
    cosine = float(of_group @ added) / max(float(np.linalg.norm(of_group) * np.linalg.norm(added)), 1e-300)
    return cosine > thresholds.NEARLY_ALL and grows > thresholds.NEARLY_ALL


def _with_group(model: Corrected, known: Joint, group: int, number: int) -> Product:
    """The product of a held group and an unknown, by its number."""
    problem, unknown = model.parameters, model.model.unknowns[number]
    held = problem.groups[group]
    assumed = float(model.theta[group] * problem.to_group[group])
    place = known.names.index(unknown.name)
    deviation = float(np.sqrt(max(known.covariance[place, place], 0.0)))
    unit = held.unit if unknown.unit == "1" else f"{held.unit} {unknown.unit}"
    value, wide = assumed * float(model.values[number]), thresholds.NORMAL_95 * assumed * deviation
    return _product((held.symbol, unknown.name), value, wide, unit)


def _powers(model: Corrected, known: Joint, runs: Runs) -> list[Product]:
    """Mean power of each effect of which two parameters are confounded."""
    deviation = np.sqrt(np.maximum(np.diag(known.covariance), 0.0))
    correlation = known.covariance / np.maximum(np.outer(deviation, deviation), 1e-300)
    first = len(known.names) - len(model.model.unknowns)
    products = []
    for index, term in enumerate(model.model.terms):
        numbers = [first + unknown for unknown in model.model.of(index)]
        pairs = [pair for pair in combinations(numbers, 2) if abs(correlation[pair]) > thresholds.NEARLY_ALL]
        if not pairs or term.hypothesis.is_weather:
            continue
        mean = float(np.average(model.contribution[index], weights=runs.duration_s))
        slopes = np.array([model.beside[:, number - first].mean() for number in numbers])
        error = float(np.sqrt(slopes @ known.covariance[np.ix_(numbers, numbers)] @ slopes))
        names = tuple(dict.fromkeys(known.names[number] for pair in pairs for number in pair))
        products.append(_product(names, mean, thresholds.NORMAL_95 * error, runs.unit, "mean power"))
    return products


def _product(
    names: tuple[str, ...], value: float, wide: float, unit: str, combination: Combination = "product"
) -> Product:
    return Product(names, Value(value, (value - wide, value + wide), unit), combination)


def recorded_range(robots: Sequence[Robot], predictions: Sequence[Array], runs: Runs, rng: Generator) -> Range | None:
    """Range of a robot that continues to drive as recorded, m; None for motor current or without driving.

    Usable energy over energy per metre: as recorded, and as two robot files, the given one and corrected.toml, predict
    for the same trips, shape (windows,) each. The interval is by bootstrap over runs or, of fewer than three,
    over minutes of driving.
    """
    path_m = np.abs(runs.context["speed_mps"]) * runs.duration_s
    drawn_j = runs.observed * runs.duration_s
    if runs.unit == "A" or path_m.sum() <= 0.0 or drawn_j.sum() <= 0.0:
        return None
    given, corrected = robots
    piece = runs.run if len(runs.signals) >= thresholds.FEWEST_RUNS else np.cumsum(runs.duration_s) // 60.0
    number = np.unique(piece, return_inverse=True)[1]
    of_pieces = np.stack([np.bincount(number, drawn_j), np.bincount(number, path_m)]).astype(float)

    def range_m(energy_and_way: Array) -> Array:
        energy_j, way_m = energy_and_way
        return np.asarray((corrected.usable_energy_j * way_m / energy_j)[energy_j > 0.0])

    def predicted_m(robot: Robot, predicted_w: Array) -> float:
        return float(robot.usable_energy_j * path_m.sum() / max(float(predicted_w @ runs.duration_s), 1e-9))

    return Range(
        recorded_m=float(corrected.usable_energy_j * path_m.sum() / drawn_j.sum()),
        ci95=bootstrap(of_pieces, rng, range_m),
        nominal_m=predicted_m(given, predictions[0]),
        file_m=predicted_m(corrected, predictions[1]),
        d_max_nominal_m=float(d_max(given)),
        d_max_file_m=float(d_max(corrected)),
    )


@dataclass(frozen=True)
class Open:
    """Of the models that fit as well (profile likelihood), the one closest to the robot file, and the others."""

    model: Corrected
    others: tuple[Corrected, ...] = ()

    @property
    def spanning(self) -> Corrected:
        """The model, with intervals of its effects' parameters that span those of all, up to the next value tried."""
        if not self.others:
            return self.model
        first, models = self.model, (self.model, *self.others)
        spans: dict[tuple[str, str], tuple[float, float]] = {}
        for index, term in enumerate(first.model.terms):
            for parameter in term.hypothesis.entry.parameters:
                if parameter.name in term.shape:
                    shapes = [model.model.terms[index].shape for model in models]
                    values = [shape.get(parameter.name, parameter.default) for shape in shapes]
                    spans[term.effect, parameter.name] = _to_the_next(parameter, values)
            numbers = [model.parameters_of(index) for model in models]
            for name in {*numbers[0]} - {*term.shape}:
                lows, highs = np.transpose([number[name].ci95 for number in numbers])
                spans[term.effect, name] = (float(lows.min()), float(highs.max()))
        terms = tuple(
            replace(term, spread={**term.spread, **{name: spans[term.effect, name] for name in term.shape}})
            for term in first.model.terms
        )
        ci95 = tuple(spans[unknown.effect, unknown.parameter] for unknown in first.model.unknowns)
        return replace(first, model=replace(first.model, terms=terms), ci95=ci95)

    def spanned(self, known: Sequence[Estimate], runs: Runs, block: Index) -> tuple[Estimate, ...]:
        """Estimates of the groups by the model; one that differs between models is confounded with the effects."""
        by_others = [estimates(model, runs, block) for model in self.others]
        effects = tuple(dict.fromkeys(term.effect for term in self.model.model.terms))
        spanned = []
        for index, estimate in enumerate(known):
            values = [others[index].fitted for others in by_others]
            differs = any(not _is_within(estimate.ci95, value) for value in values)
            spanned.append(estimate.confounded(effects) if differs else estimate)
        return tuple(spanned)

    def products(self, runs: Runs, block: Index) -> tuple[Product, ...]:
        """Identifiable combinations of parameters that are not identifiable alone.

        A held group and an effect proportional to it: their product. Two confounded parameters of one effect: their
        mean power together. And combinations that are equal in all models while their parts are not: products of
        numbers, and sums of mean powers. Windows of different `block`, shape (windows,), count as independent.
        """
        known = joint(self.model, runs, block)
        products = [*_with_groups(self.model, known, runs), *_powers(self.model, known, runs)]
        if self.others:
            products += self._equal_products(known, runs, block)
            products += self._equal_powers(known, runs)
        return tuple(products)

    def _equal_products(self, known: Joint, runs: Runs, block: Index) -> list[Product]:
        """Products and ratios of numbers that are equal in all models."""
        numbers = [_numbers(model, runs, block) for model in (self.model, *self.others)]
        logarithms = [
            {name: float(np.log(value)) for name, value in of_model.items() if value > 0.0} for of_model in numbers
        ]
        groups = {group.symbol for group in self.model.parameters.groups}
        error, units = known.relative_error, dict(zip(known.names, known.units, strict=True))
        products = []
        for sign, combination in _SIGNS.items():
            for first, second in _constant(logarithms, 1.0, sign):
                if first in groups and second in groups:
                    continue
                value = numbers[0][first] * numbers[0][second] ** sign
                wide = thresholds.NORMAL_95 * value * float(np.hypot(error.get(first, 0.0), error.get(second, 0.0)))
                between = "" if sign > 0 else "/"
                unit = f"({units.get(first, '1')}){between}({units.get(second, '1')})".replace("(1)", "")
                products.append(_product((first, second), value, wide, unit, combination))
        return products

    def _equal_powers(self, known: Joint, runs: Runs) -> list[Product]:
        """Sums of two mean powers that are equal in all models."""
        powers = [_mean_powers(model, runs) for model in (self.model, *self.others)]
        error = known.relative_error
        products = []
        for pair in _constant(powers, float(np.mean(np.abs(runs.observed)))):
            value = sum(powers[0][name] for name in pair)
            own = sum(powers[0][name] * error.get(name, 0.0) for name in pair)
            wide = thresholds.NORMAL_95 * own + thresholds.MATERIAL_SHARE * value
            products.append(_product(pair, value, wide, runs.unit, "mean power"))
        return products


def _to_the_next(parameter: Parameter, values: Sequence[float]) -> tuple[float, float]:
    """Interval of a parameter that spans these values, up to the next that was tried on either side."""
    step = (parameter.high - parameter.low) / (_TRIED - 1)
    return max(min(values) - step, parameter.low), min(max(values) + step, parameter.high)


def _is_within(ci95: tuple[float, float] | None, value: float | None) -> bool:
    """Whether a value is in an interval; where there is none, nothing contradicts it."""
    return ci95 is None or (value is not None and ci95[0] <= value <= ci95[1])


def profiled(fit: Refit, model: Corrected, runs: Runs, block: Index) -> Open:
    """Profile likelihood of the parameters of a model's effects; `fit` holds the groups that the model holds."""
    terms = model.model.terms
    models = [model, *(fit_model(fit, others, runs, block) for others in _other_terms(fit, terms, runs))]
    best = min(models, key=lambda tried: runs.squared_error(tried.predicted))
    if best is not model:  # go on from there
        started = [replace(new, hypothesis=old.hypothesis) for new, old in zip(best.model.terms, terms, strict=True)]
        best = min(best, fit_model(fit, started, runs, block), key=lambda tried: runs.squared_error(tried.predicted))
    independent = independent_windows(runs.observed - best.predicted, runs.run)
    as_likely = runs.squared_error(best.predicted) * float(np.exp(_AS_LIKELY / independent))
    most = max(as_likely, runs.squared_error(best.predicted) + meter_error(runs))
    alike = [tried for tried in models if runs.squared_error(tried.predicted) <= most]
    if len(alike) < 3:
        return Open(best)  # at most one neighbour is as likely: the parameters are identifiable

    def from_the_file(tried: Corrected) -> tuple[float, int]:
        changed = (tried.theta - fit.parameters.start) / fit.parameters.scale
        return float(np.sum(changed**2)), _unusual(tried)

    alike.sort(key=from_the_file)
    return Open(alike[0], tuple(alike[1:]))


def _unusual(model: Corrected) -> int:
    """Parameters of its effects that differ from their defaults, such as a limit where none is reached."""
    return sum(
        term.shape.get(parameter.name, parameter.default) != parameter.default
        for term in model.model.terms
        for parameter in term.hypothesis.entry.parameters
    )


def _other_terms(fit: Refit, terms: Sequence[Term], runs: Runs) -> Iterator[list[Term]]:
    """The terms with another value of one of their parameters."""
    setting = Setting.of(fit, runs)
    for index, term in enumerate(terms):
        hypothesis = term.hypothesis
        if term.axis != "steady" or term.fixed or not hypothesis.physical or hypothesis.is_weather:
            continue
        for parameter in hypothesis.entry.parameters[1:]:
            if parameter.name in hypothesis.reach(runs):
                continue
            for value in np.linspace(parameter.low, parameter.high, _TRIED).tolist():
                shape = {**term.shape, parameter.name: value}
                columns = setting.response(hypothesis, TINY * hypothesis.entry.switch.high, shape)[:, None]
                if columns.any():
                    other = replace(term, hypothesis=replace(hypothesis, searched=()), shape=shape, columns=columns)
                    yield [*terms[:index], other, *terms[index + 1 :]]


def _numbers(model: Corrected, runs: Runs, block: Index) -> dict[str, float]:
    """Numbers of the groups that are fitted and of the effects, by name."""
    known = joint(model, runs, block)
    shapes = {f"{term.effect} {name}": value for term in model.model.terms for name, value in term.shape.items()}
    return shapes | dict(zip(known.names, known.values.tolist(), strict=True))


def _mean_powers(model: Corrected, runs: Runs) -> dict[str, float]:
    """Mean power of each group that is fitted and of each effect, by name."""
    problem = model.parameters
    of_groups = model.groups.jacobian.mean(axis=0) * model.theta / problem.scale
    free = {problem.groups[index].symbol: float(of_groups[index]) for index in np.flatnonzero(~model.groups.held)}
    effects = zip(model.model.terms, model.contribution, strict=True)
    return free | {term.effect: float(contribution.mean()) for term, contribution in effects}


def _constant(models: Sequence[Mapping[str, float]], scale: float, sign: int = 1) -> list[tuple[str, str]]:
    """Pairs of names whose values vary between models (relative to `scale`) while their sum or difference does not."""
    varying = [
        name
        for name in models[0]
        if all(name in model for model in models)
        and np.std([model[name] for model in models]) > thresholds.MATERIAL_SHARE * scale
    ]
    constant = []
    for first, second in combinations(varying, 2):
        sums = [model[first] + sign * model[second] for model in models]
        if np.std(sums) <= thresholds.MATERIAL_SHARE * scale:
            constant.append((first, second))
    return constant
