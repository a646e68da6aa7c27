"""Uncertainty of a fit: joint covariance, combinations that alone are identifiable, range.

An effect has parameters beside its size: the temperature below which a battery loses capacity, the
share of a computer's power that any sensing draws. Each is tried over its whole range and the model
fitted anew (profile likelihood). Where others fit as well, intervals span all of them, and only
products or sums with them are identifiable.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.random import Generator
from scipy.stats import chi2

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.hypothesis import SMALL_STEP, TINY, Setting, Term
from homeward.diagnosis.explain.joint_fit import Corrected, fit_model
from homeward.diagnosis.fit.channel_errors import meter_error
from homeward.diagnosis.fit.estimates import Estimate, covariance, estimates, lasting_covariance
from homeward.diagnosis.fit.held_out import bootstrap
from homeward.diagnosis.fit.parameter_groups import ROLLING
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Combination, Product, Range, Value
from homeward.logs.autocorrelation import independent_windows
from homeward.logs.channels import Array, Index
from homeward.physics import Robot, d_max
from homeward.physics.effects import Parameter

_VALUES_TRIED = 9  # of a number over its range; chosen: steps of an eighth
_BEYOND_K = (0.1, 0.3, 1.0, 3.0, 10.0)  # beyond the temperatures recorded; chosen: threefold each
# of the likelihood-ratio statistic
_LEAST_SIGNIFICANT = float(chi2.ppf(1.0 - thresholds.SIGNIFICANT, 1))
# of the second logarithm in a combination
_SIGNS: Mapping[int, Combination] = {1: "product", -1: "ratio"}


@dataclass(frozen=True)
class Joint:
    """Everything that was fitted together: names, values in their units, and covariance, shape
    (numbers, numbers)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array  # (numbers,)
    covariance: Array

    @property
    def relative_error(self) -> dict[str, float]:
        """Standard errors over the values, by name."""
        errors = np.sqrt(np.diag(self.covariance)) / np.abs(self.values)
        return dict(zip(self.names, errors.tolist(), strict=True))


def joint(model: Refit | Corrected, runs: Runs, block: Index) -> Joint:
    """Joint covariance of fitted groups and sizes, clustered by block, shape (windows,), without
    held groups.

    Sizes are those of a report: of a profile relative to its mean where only differences are known,
    and C_rr m that of the mean ground.
    """
    return _as_reported(model, joint_as_fitted(model, runs, by_blocks(block)))


def lasting_joint(model: Refit | Corrected, runs: Runs) -> Joint:
    """The same by errors that last for longer than a block, as those of a slope do."""

    def lasting(columns: Array, residual: Array) -> Array:
        return lasting_covariance(columns, residual, runs.run)

    return _as_reported(model, joint_as_fitted(model, runs, lasting))


def _as_reported(model: Refit | Corrected, as_fitted: Joint) -> Joint:
    """The joint fit with sizes as a report has them."""
    if not isinstance(model, Corrected):
        return as_fitted
    reported = model.reported
    problem = model.parameters
    fitted_groups = np.flatnonzero(~model.groups.held).tolist()
    groups = len(problem.groups)
    of_unknowns = groups + np.arange(len(model.values))
    kept = [*fitted_groups, *of_unknowns.tolist()]
    # Derivatives of groups and sizes as reported by those that were fitted, all in their own units.
    by_all = np.eye(groups + len(model.values))
    by_all[:groups][ROLLING] = reported.rolling_by_all  # groups count from the end of theirs
    by_all[of_unknowns] = reported.by_all
    to_group = np.concatenate([problem.to_group, np.ones(len(model.values))])
    transform = (to_group[:, None] * by_all / to_group)[np.ix_(kept, kept)]
    theta = model.theta.copy()
    theta[ROLLING] = reported.rolling_kg
    values = np.concatenate([theta * problem.to_group, reported.sizes])[kept]
    covariance_as_reported = transform @ as_fitted.covariance @ transform.T
    least_variance = np.concatenate([np.zeros(len(fitted_groups)), model.least_variance])
    variance = np.maximum(np.diag(covariance_as_reported), least_variance)
    np.fill_diagonal(covariance_as_reported, variance)
    return replace(as_fitted, values=values, covariance=covariance_as_reported)


_Estimator = Callable[[Array, Array], Array]
"""Covariance of parameters, by the derivatives by them, (windows, parameters), and the residual."""


def by_blocks(block: Index) -> _Estimator:
    """The sandwich estimator clustered by block."""
    return lambda columns, residual: covariance(columns, residual, block)


def joint_as_fitted(model: Refit | Corrected, runs: Runs, estimator: _Estimator) -> Joint:
    """The joint fit of sizes as they were fitted, with the covariance of an estimator."""
    groups = model.groups
    problem = model.parameters
    fitted_groups = np.flatnonzero(~groups.held)
    to_group = problem.to_group[fitted_groups]
    columns = np.column_stack([groups.jacobian[:, fitted_groups], model.beside])
    # Columns of groups are per unit of `scale`, those of effects per unit of each unknown.
    units_of_groups = problem.scale[fitted_groups] * to_group
    unit_of_column = np.concatenate([units_of_groups, np.ones(model.beside.shape[1])])
    residual = runs.observed - model.predicted
    in_units = estimator(columns, residual) * np.outer(unit_of_column, unit_of_column)
    names = [problem.groups[index].symbol for index in fitted_groups]
    units = [problem.groups[index].unit for index in fitted_groups]
    values = (model.theta[fitted_groups] * to_group).tolist()
    if isinstance(model, Corrected):
        names += [unknown.name for unknown in model.model.unknowns]
        units += [unknown.unit for unknown in model.model.unknowns]
        values += model.values.tolist()
    return Joint(
        names=tuple(names), units=tuple(units), values=np.array(values), covariance=in_units
    )


def _products_with_groups(model: Corrected, fitted: Joint, runs: Runs) -> list[Product]:
    """Products of a held group and an effect whose contribution is proportional to it."""
    products = []
    for group in np.flatnonzero(model.groups.held):
        for number, unknown in enumerate(model.model.unknowns):
            if unknown.column is not None and _is_proportional(
                model, runs, int(group), unknown.term
            ):
                products.append(_product_with_group(model, fitted, int(group), number))
    return products


def _is_proportional(model: Corrected, runs: Runs, group: int, term: int) -> bool:
    """Whether what a term adds grows in proportion to a group, and looks like what the group
    does."""
    larger = model.theta.copy()
    larger[group] *= 1.0 + SMALL_STEP
    predicted_larger = model.model.predict(runs, larger, model.values)
    without_term = model.model.predict(runs, larger, model.values, leave_out=term)
    by_group = predicted_larger - model.predicted
    by_term = model.contribution[term]
    by_term_larger = predicted_larger - without_term
    # Relative growth of the term over that of the group: 1 where they are proportional.
    growth = float((by_term_larger - by_term) @ by_term) / max(
        SMALL_STEP * float(by_term @ by_term), 1e-300
    )
    norms = float(np.linalg.norm(by_group) * np.linalg.norm(by_term))
    cosine = float(by_group @ by_term) / max(norms, 1e-300)
    return cosine > thresholds.NEARLY_ALL and growth > thresholds.NEARLY_ALL


def _product_with_group(model: Corrected, fitted: Joint, group: int, number: int) -> Product:
    """The product of a held group and an unknown, by its number."""
    problem = model.parameters
    held_group = problem.groups[group]
    unknown = model.model.unknowns[number]
    assumed = float(model.theta[group] * problem.to_group[group])
    position = fitted.names.index(unknown.name)
    deviation = float(np.sqrt(max(fitted.covariance[position, position], 0.0)))
    unit = held_group.unit
    if unknown.unit != "1":
        unit = f"{unit} {unknown.unit}"
    value = assumed * float(fitted.values[position])
    half_width = thresholds.NORMAL_95 * assumed * deviation
    return _product((held_group.symbol, unknown.name), value, half_width, unit)


def _powers(model: Corrected, fitted: Joint, runs: Runs) -> list[Product]:
    """Mean power of each effect of which two parameters are confounded."""
    deviation = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
    correlation = fitted.covariance / np.maximum(np.outer(deviation, deviation), 1e-300)
    groups = len(fitted.names) - len(model.model.unknowns)  # they precede the unknowns
    products = []
    for index, term in enumerate(model.model.terms):
        numbers = [groups + unknown for unknown in model.model.of(index)]
        confounded = [
            pair
            for pair in combinations(numbers, 2)
            if abs(correlation[pair]) > thresholds.NEARLY_ALL
        ]
        if not confounded or term.hypothesis.is_weather:
            continue
        mean_power = float(np.average(model.contribution[index], weights=runs.duration_s))
        slopes = np.array([model.beside[:, number - groups].mean() for number in numbers])
        error = float(np.sqrt(slopes @ fitted.covariance[np.ix_(numbers, numbers)] @ slopes))
        names = tuple(dict.fromkeys(fitted.names[number] for pair in confounded for number in pair))
        products.append(
            _product(names, mean_power, thresholds.NORMAL_95 * error, runs.unit, "mean power")
        )
    return products


def _product(
    names: tuple[str, ...],
    value: float,
    half_width: float,
    unit: str,
    combination: Combination = "product",
) -> Product:
    return Product(names, Value(value, (value - half_width, value + half_width), unit), combination)


def recorded_range(
    robots: Sequence[Robot], predictions: Sequence[Array], runs: Runs, rng: Generator
) -> Range | None:
    """Range of a robot that continues to drive as recorded, m; None for motor current or without
    driving.

    Usable energy over energy per metre: as recorded, and as two robot files, the given one and
    corrected.toml, predict for the same trips, shape (windows,) each. The interval is by bootstrap
    over runs or, of fewer than three, over minutes of driving.
    """
    path_m = np.abs(runs.context["speed_mps"]) * runs.duration_s
    drawn_j = runs.observed * runs.duration_s
    if runs.unit == "A" or path_m.sum() <= 0.0 or drawn_j.sum() <= 0.0:
        return None
    nominal, corrected = robots
    minute = np.cumsum(runs.duration_s) // 60.0
    piece = runs.run if len(runs.signals) >= thresholds.FEWEST_RUNS else minute
    number = np.unique(piece, return_inverse=True)[1]
    sums_of_pieces = np.stack([np.bincount(number, drawn_j), np.bincount(number, path_m)]).astype(
        float
    )

    def range_m(energy_and_way: Array) -> Array:
        energy_j, way_m = energy_and_way
        return np.asarray((corrected.usable_energy_j * way_m / energy_j)[energy_j > 0.0])

    def predicted_m(robot: Robot, predicted_w: Array) -> float:
        predicted_j = max(float(predicted_w @ runs.duration_s), 1e-9)
        return float(robot.usable_energy_j * path_m.sum() / predicted_j)

    return Range(
        recorded_m=float(corrected.usable_energy_j * path_m.sum() / drawn_j.sum()),
        ci95=bootstrap(sums_of_pieces, rng, range_m),
        nominal_m=predicted_m(nominal, predictions[0]),
        file_m=predicted_m(corrected, predictions[1]),
        d_max_nominal_m=float(d_max(nominal)),
        d_max_file_m=float(d_max(corrected)),
    )


@dataclass(frozen=True)
class Open:
    """Of the models that fit as well (profile likelihood), the one closest to the robot file, and
    the others."""

    model: Corrected
    alternatives: tuple[Corrected, ...] = ()

    @property
    def spanning(self) -> Corrected:
        """The model, with intervals of its effects' parameters that span those of all, up to the
        next value tried."""
        if not self.alternatives:
            return self.model
        spans = self._spans()
        terms = []
        for term in self.model.model.terms:
            of_shape = {name: spans[term.effect, name] for name in term.shape}
            terms.append(replace(term, spread={**term.spread, **of_shape}))
        ci95 = tuple(
            spans[unknown.effect, unknown.parameter] for unknown in self.model.model.unknowns
        )
        return replace(self.model, model=replace(self.model.model, terms=tuple(terms)), ci95=ci95)

    def _spans(self) -> dict[tuple[str, str], tuple[float, float]]:
        """Interval over all models of each number of the effects, by effect and parameter."""
        models = (self.model, *self.alternatives)
        spans: dict[tuple[str, str], tuple[float, float]] = {}
        for index, term in enumerate(self.model.model.terms):
            for parameter in term.hypothesis.entry.parameters:
                if parameter.name in term.shape:
                    shapes = [model.model.terms[index].shape for model in models]
                    values = [shape.get(parameter.name, parameter.default) for shape in shapes]
                    spans[term.effect, parameter.name] = to_the_next(parameter, values)
            fitted = [model.parameters_of(index) for model in models]
            for name in set(fitted[0]) - set(term.shape):
                lows, highs = np.transpose([parameters[name].ci95 for parameters in fitted])
                spans[term.effect, name] = (float(lows.min()), float(highs.max()))
        return spans

    def spanned(self, groups: Sequence[Estimate], runs: Runs, block: Index) -> tuple[Estimate, ...]:
        """Estimates of the groups by the model; one that differs between models is confounded with
        the effects."""
        by_alternatives = [estimates(model, runs, block) for model in self.alternatives]
        effects = tuple(dict.fromkeys(term.effect for term in self.model.model.terms))
        spanned = []
        for index, estimate in enumerate(groups):
            values = [of_model[index].fitted for of_model in by_alternatives]
            if all(_is_within(estimate.ci95, value) for value in values):
                spanned.append(estimate)
            else:
                spanned.append(estimate.confounded(effects))
        return tuple(spanned)

    def products(self, runs: Runs, block: Index) -> tuple[Product, ...]:
        """Identifiable combinations of parameters that are not identifiable alone.

        A held group and an effect proportional to it: their product. Two confounded parameters of
        one effect: their mean power together. And combinations that are equal in all models while
        their parts are not: products of numbers, and sums of mean powers. Windows of different
        `block`, shape (windows,), count as independent.
        """
        fitted = joint(self.model, runs, block)
        products = [
            *_products_with_groups(self.model, fitted, runs),
            *_powers(self.model, joint_as_fitted(self.model, runs, by_blocks(block)), runs),
        ]
        if self.alternatives:
            products += self._equal_products(fitted, runs, block)
            products += self._equal_powers(fitted, runs)
        return tuple(products)

    def _equal_products(self, fitted: Joint, runs: Runs, block: Index) -> list[Product]:
        """Products and ratios of numbers that are equal in all models."""
        numbers = [_numbers(model, runs, block) for model in (self.model, *self.alternatives)]
        logarithms = [_logarithms(of_model) for of_model in numbers]
        groups = {group.symbol for group in self.model.parameters.groups}
        error = fitted.relative_error
        units = dict(zip(fitted.names, fitted.units, strict=True))
        products = []
        for sign, combination in _SIGNS.items():
            for name, partner in _constant(logarithms, 1.0, sign):
                if name in groups and partner in groups:
                    continue
                value = numbers[0][name] * numbers[0][partner] ** sign
                relative = float(np.hypot(error.get(name, 0.0), error.get(partner, 0.0)))
                half_width = thresholds.NORMAL_95 * value * relative
                unit = combined_unit(units.get(name, "1"), units.get(partner, "1"), combination)
                products.append(_product((name, partner), value, half_width, unit, combination))
        return products

    def _equal_powers(self, fitted: Joint, runs: Runs) -> list[Product]:
        """Sums of two mean powers that are equal in all models."""
        powers = [_mean_powers(model, runs) for model in (self.model, *self.alternatives)]
        error = fitted.relative_error
        products = []
        for pair in _constant(powers, float(np.mean(np.abs(runs.observed)))):
            value = sum(powers[0][name] for name in pair)
            # Added as if fully correlated, which gives the widest interval.
            error_of_fit = sum(powers[0][name] * error.get(name, 0.0) for name in pair)
            half_width = thresholds.NORMAL_95 * error_of_fit + thresholds.MATERIAL_SHARE * value
            products.append(_product(pair, value, half_width, runs.unit, "mean power"))
        return products


def _logarithms(numbers: Mapping[str, float]) -> dict[str, float]:
    """Logarithms of the positive numbers, of which sums and differences are products and ratios."""
    return {name: float(np.log(value)) for name, value in numbers.items() if value > 0.0}


def combined_unit(first_unit: str, second_unit: str, combination: Combination) -> str:
    """Unit of a product or ratio."""
    if second_unit == "1":
        return first_unit
    between = "/" if combination == "ratio" else ""
    return f"({first_unit}){between}({second_unit})".replace("(1)", "")


def to_the_next(parameter: Parameter, values: Sequence[float]) -> tuple[float, float]:
    """Interval of a parameter that spans these values, up to the next that was tried on either
    side."""
    step = (parameter.high - parameter.low) / (_VALUES_TRIED - 1)
    return max(min(values) - step, parameter.low), min(max(values) + step, parameter.high)


def _is_within(ci95: tuple[float, float] | None, value: float | None) -> bool:
    """Whether a value is in an interval; where there is none, nothing contradicts it."""
    return ci95 is None or (value is not None and ci95[0] <= value <= ci95[1])


def profiled(
    fit: Refit, model: Corrected, runs: Runs, block: Index, beyond_recorded: bool = False
) -> Open:
    """Profile likelihood of the parameters of a model's effects.

    Args:
        fit: The refit, which holds the groups that the model holds.
        model: The model.
        runs: The runs.
        block: Windows of one block, (windows,), are dependent.
        beyond_recorded: Whether set points shortly beyond the recorded temperatures are tried, too.
            What is always at work there consumes the same with another set point and other power at
            rest. Names do not depend on it, so that it is asked once, when they are found.
    """

    def squared_error(of_model: Corrected) -> float:
        return runs.squared_error(of_model.predicted)

    terms = model.model.terms
    models = [model]
    for varied_terms in _varied_terms(fit, terms, runs, beyond_recorded):
        models.append(fit_model(fit, varied_terms, runs, block))
    likeliest = min(models, key=squared_error)
    # a fit that starts there may improve further: the hypotheses search again
    if likeliest is not model:
        started = [
            replace(varied, hypothesis=term.hypothesis)
            for varied, term in zip(likeliest.model.terms, terms, strict=True)
        ]
        likeliest = min(likeliest, fit_model(fit, started, runs, block), key=squared_error)
    least = squared_error(likeliest)
    independent = independent_windows(runs.observed - likeliest.predicted, runs.run)
    # Of Gaussian residuals the statistic is the logarithm of the ratio of squared errors, times
    # independent windows.
    as_likely = least * float(np.exp(_LEAST_SIGNIFICANT / independent))
    limit = max(as_likely, least + meter_error(runs))
    equivalent = [fitted for fitted in models if squared_error(fitted) <= limit]
    if len(equivalent) < 3:
        # at most one neighbour is as likely: the parameters are identifiable
        return Open(likeliest)

    def from_the_file(of_model: Corrected) -> tuple[float, int]:
        problem = of_model.parameters
        changed = (of_model.theta - problem.start) / problem.scale
        return float(np.sum(changed**2)), _not_default(of_model)

    equivalent.sort(key=from_the_file)
    return Open(equivalent[0], tuple(equivalent[1:]))


def _not_default(model: Corrected) -> int:
    """Parameters of its effects that differ from their defaults, such as a limit where none is
    reached."""
    return sum(
        term.shape.get(parameter.name, parameter.default) != parameter.default
        for term in model.model.terms
        for parameter in term.hypothesis.entry.parameters
    )


def varied_parameters(term: Term, runs: Runs) -> tuple[Parameter, ...]:
    """The parameters of a term beside its size that are tried over their range."""
    hypothesis = term.hypothesis
    if term.axis != "steady" or term.fixed or not hypothesis.physical or hypothesis.is_weather:
        return ()
    given = hypothesis.reach(runs)
    return tuple(
        parameter for parameter in hypothesis.entry.parameters[1:] if parameter.name not in given
    )


def _tried(term: Term, parameter: Parameter, runs: Runs, beyond_recorded: bool) -> list[float]:
    """Values of a parameter that are tried."""
    values = np.linspace(parameter.low, parameter.high, _VALUES_TRIED).tolist()
    recorded_c = runs.context.get("temperature_c")
    is_set_point = parameter in term.hypothesis.searched and parameter.unit == "C"
    if beyond_recorded and is_set_point and recorded_c is not None:
        beyond_k = np.array(_BEYOND_K)
        values += (np.nanmin(recorded_c) - beyond_k).tolist()
        values += (np.nanmax(recorded_c) + beyond_k).tolist()
    return [value for value in values if parameter.low <= value <= parameter.high]


def _varied_terms(
    fit: Refit, terms: Sequence[Term], runs: Runs, beyond_recorded: bool
) -> Iterator[list[Term]]:
    """The terms with another value of one of their parameters."""
    setting = Setting.of(fit, runs)
    for index, term in enumerate(terms):
        hypothesis = term.hypothesis
        for parameter in varied_parameters(term, runs):
            for value in _tried(term, parameter, runs, beyond_recorded):
                shape = {**term.shape, parameter.name: value}
                columns = setting.response(hypothesis, TINY * hypothesis.entry.switch.high, shape)[
                    :, None
                ]
                if columns.any():
                    # The value stays where it is put: nothing is searched beside the size.
                    settled = replace(hypothesis, searched=())
                    varied = replace(term, hypothesis=settled, shape=shape, columns=columns)
                    yield [*terms[:index], varied, *terms[index + 1 :]]


def _numbers(model: Corrected, runs: Runs, block: Index) -> dict[str, float]:
    """Numbers of the groups that are fitted and of the effects, by name."""
    fitted = joint(model, runs, block)
    numbers: dict[str, float] = {}
    for term in model.model.terms:
        for name, value in term.shape.items():
            numbers[f"{term.effect} {name}"] = value
    numbers.update(zip(fitted.names, fitted.values.tolist(), strict=True))
    return numbers


def _mean_powers(model: Corrected, runs: Runs) -> dict[str, float]:
    """Mean power of each group that is fitted and of each effect, by name."""
    problem = model.parameters
    of_groups = model.groups.jacobian.mean(axis=0) * model.theta / problem.scale
    powers: dict[str, float] = {}
    for index in np.flatnonzero(~model.groups.held):
        powers[problem.groups[index].symbol] = float(of_groups[index])
    for term, contribution in zip(model.model.terms, model.contribution, strict=True):
        powers[term.effect] = float(contribution.mean())
    return powers


def _constant(
    models: Sequence[Mapping[str, float]], scale: float, sign: int = 1
) -> list[tuple[str, str]]:
    """Pairs of names whose values vary between models (relative to `scale`) while their sum or
    difference does not."""
    material = thresholds.MATERIAL_SHARE * scale
    varying = []
    for name in models[0]:
        in_all = all(name in model for model in models)
        if in_all and np.std([model[name] for model in models]) > material:
            varying.append(name)
    constant = []
    for name, partner in combinations(varying, 2):
        sums = [model[name] + sign * model[partner] for model in models]
        if np.std(sums) <= material:
            constant.append((name, partner))
    return constant
