"""The corrected model: nonlinear least squares of refit groups and named effects together, with 95 % intervals."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import t as student

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.hypothesis import SMALL_STEP, Setting, Term
from homeward.diagnosis.fit.fitted import bounded, excited
from homeward.diagnosis.fit.parameter_groups import ROLLING, Parameters, derivatives
from homeward.diagnosis.fit.refit import Refit, covariance, holding
from homeward.diagnosis.fit.replay import Runs, WithEffects
from homeward.diagnosis.result import Value
from homeward.logs.channels import Array, Index, Mask
from homeward.physics import Robot

_ITERATIONS = 6  # most Gauss-Newton steps: a fit ends where the error no longer falls; chosen
_PASSES = 3  # of fitting to loads that depend on what is fitted; chosen: bounds the time
_HALVED = (1.0, 0.5, 0.25, 0.125)  # shares of a step; chosen: if an eighth does not improve, the fit ends


@dataclass(frozen=True)
class Unknown:
    """One fitted number of an effect: a level of a schedule, a component of the wind, or a parameter of the kernel."""

    effect: str
    parameter: str  # name in the robot file or in the report
    unit: str
    low: float
    high: float
    term: int  # which of the terms it belongs to
    column: int | None  # of the term, or None for a parameter of the kernel
    given: float = 0.0  # value in the robot file or, of a parameter of the kernel, where its search starts

    @property
    def name(self) -> str:
        """Effect and parameter."""
        return f"{self.effect} {self.parameter}"


@dataclass(frozen=True)
class Model:
    """The model fitted to recordings: the groups of the refit and the named effects."""

    parameters: Parameters
    terms: tuple[Term, ...]
    unknowns: tuple[Unknown, ...]

    @cached_property
    def bounds(self) -> Array:
        """Least and largest value of each unknown, shape (2, unknowns)."""
        return np.array([(unknown.low, unknown.high) for unknown in self.unknowns]).reshape(-1, 2).T

    @cached_property
    def given(self) -> Array:
        """Values from which contributions count, shape (unknowns,)."""
        return np.array([unknown.given for unknown in self.unknowns])

    def of(self, index: int) -> list[int]:
        """Indices of the unknowns of a term."""
        return [number for number, unknown in enumerate(self.unknowns) if unknown.term == index]

    def _added(self, index: int, values: Array) -> Array:
        """What a term adds by its columns at these values, shape (windows,)."""
        return np.asarray(self.terms[index].columns @ (values - self.given)[self.of(index)])

    def predict(self, runs: Runs, theta: Array, values: Array, leave_out: int | None = None) -> Array:
        """Prediction, (windows,), by parameters and a value per unknown, without term `leave_out` if given."""
        added = np.zeros(len(runs.observed))
        for index, term in enumerate(self.terms):
            if term.linear and index != leave_out:
                added += self._added(index, values)
        return self.parameters.predict(runs, theta, self.within(runs, values, leave_out)) + added

    def within(self, runs: Runs, values: Array, leave_out: int | None = None) -> WithEffects:
        """The terms that are not linear in their sizes, as additions to the replay."""
        within = WithEffects()
        for index, term in enumerate(self.terms):
            if not term.linear and index != leave_out:
                fitted = {self.unknowns[number].parameter: float(values[number]) for number in self.of(index)}
                within = term.hypothesis.within(term.hypothesis, within, {**term.shape, **fitted}, runs)
        return within

    def setting(self, runs: Runs, theta: Array, values: Array) -> Setting:
        """Prediction of these parameters and values by a replay, and its residual.

        Flexible forms are in their form in a robot file: a load on top, for example, also makes turning harder.
        """
        within = self.within(runs, values)
        for index, term in enumerate(self.terms):
            plain = term.plain
            if plain is None or plain.columns.shape[1] != 1:
                continue
            column = plain.columns[:, 0]
            closest = float(column @ self._added(index, values)) / max(float(column @ column), 1e-300)
            size = float(np.clip(closest, plain.low[0], plain.high[0]))
            given, _ = plain.hypothesis.in_file(self.parameters.nominal)
            numbers = {**plain.shape, plain.hypothesis.entry.switch.name: given + size}
            within = plain.hypothesis.within(plain.hypothesis, within, numbers, runs)
        alone = self.parameters.predict(runs, theta, within)
        return Setting(runs, self.parameters, theta, within, alone, runs.observed - alone)


@dataclass(frozen=True)
class Corrected:
    """The fitted model, linearised so that it can be refitted on a part of the windows."""

    model: Model
    values: Array  # (unknowns,)
    ci95: tuple[tuple[float, float], ...]
    groups: Refit  # of the groups of the refit, fitted together with the effects
    beside: Array  # (windows, unknowns): derivative of the prediction, per unit of each unknown
    contribution: tuple[Array, ...]  # power or current of each term, shape (windows,)

    @property
    def parameters(self) -> Parameters:
        """The groups and their bounds."""
        return self.groups.parameters

    @property
    def theta(self) -> Array:
        """Values of the parameters, shape (groups,)."""
        return self.groups.theta

    @property
    def predicted(self) -> Array:
        """Prediction for the windows that the model was fitted to, shape (windows,)."""
        return self.groups.predicted

    @property
    def jacobian(self) -> Array:
        """Derivative of the prediction by groups (in units of `scale`) and unknowns, shape (windows, columns)."""
        return np.column_stack([self.groups.jacobian, self.beside])

    @property
    def misread(self) -> Array:
        """What faults of the power meter add to its reading, shape (windows,)."""
        misread = np.zeros(len(self.predicted))
        for term, added in zip(self.model.terms, self.contribution, strict=True):
            if term.misread:
                misread = misread + added
        return misread

    def freedom(self) -> tuple[Array, Array]:
        """Least and largest physical step of each column of `jacobian`."""
        return _bounds(self.groups, self.model, self.values)

    def fitted_to(self, chosen: Mask, observed: Array) -> Corrected:
        """The same fitted to the chosen windows only, linearised at this fit."""
        residual = (observed - self.predicted)[chosen]
        step, theta, values = _stepped(self.groups, self.model, self.values, self.jacobian[chosen], residual)
        groups = dataclasses.replace(self.groups, theta=theta, predicted=self.predicted + self.jacobian @ step)
        return dataclasses.replace(self, values=values, groups=groups)

    def refitted(self, chosen: Mask, runs: Runs) -> Corrected:
        """The same fitted to the chosen windows only, by replays, with further steps where one overshoots."""
        start = (self.theta, self.values, self.predicted, self.jacobian)
        theta, values, predicted, _ = _descended(self.groups, self.model, runs, chosen, start, to_first=True)
        groups = dataclasses.replace(self.groups, theta=theta, predicted=predicted)
        return dataclasses.replace(self, values=values, groups=groups)

    def replayed(self, runs: Runs) -> Array:
        """Prediction by a replay with these parameters and effects, shape (windows,)."""
        return self.model.predict(runs, self.theta, self.values)

    def parameters_of(self, index: int) -> dict[str, Value]:
        """Fitted parameters of one named effect."""
        term = self.model.terms[index]
        share = self.share(index)
        parameters: dict[str, Value] = {}
        for number in self.model.of(index):
            unknown = self.model.unknowns[number]
            low, high = self.ci95[number]
            size = share * float(self.values[number])
            parameters[unknown.parameter] = Value(size, (share * low, share * high), unknown.unit)
        for tried in term.hypothesis.entry.parameters:
            if tried.name in term.spread:
                parameters[tried.name] = Value(term.shape[tried.name], term.spread[tried.name], tried.unit)
        return parameters

    def sizes(self, index: int) -> Array:
        """Fitted sizes of one named effect, shape (sizes,)."""
        return self.values[self.model.of(index)]

    def share(self, index: int) -> float:
        """Factor from fitted sizes to shares of the rolling resistance fitted with them; 1 for other effects."""
        of_kg = self.model.terms[index].of_rolling_kg
        return 1.0 if of_kg is None else of_kg / max(float(self.theta[ROLLING]), 1e-9)


def fit_model(fit: Refit, terms: Sequence[Term], runs: Runs, block: Index) -> Corrected:
    """Fit the groups and the named effects together, by Gauss-Newton through the kernel.

    Groups that the refit holds are not fitted; intervals are clustered by `block`, shape (windows,).
    """
    fit = _without_spanned(fit, terms, runs)
    everything = np.ones(len(runs.observed), np.bool_)
    model = Model(fit.parameters, tuple(terms), _unknowns(terms, fit.parameters.nominal))
    theta, values = _start(fit, model, runs)
    # The load per unit of a size depends on the groups, such as a share of the power.
    depends = any(term.at_work is not None for term in terms)
    for again in range(_PASSES if depends else 1):
        if again:
            model = _at(model, runs, theta, values)
        predicted = model.predict(runs, theta, values)
        start = (theta, values, predicted, _jacobian(model, runs, theta, values, predicted, fit.held))
        theta, values, predicted, jacobian = _descended(fit, model, runs, everything, start)
    groups = fit.jacobian.shape[1]
    spread = covariance(jacobian, runs.observed - predicted, block)[groups:, groups:]
    spread = spread + np.outer(values, values) * thresholds.GAIN_ERROR**2
    freedom = max(int(block.max()) + 1 - jacobian.shape[1], 1)
    widths = float(student.ppf(0.975, freedom)) * np.sqrt(np.maximum(np.diag(spread), 0.0))
    intervals = tuple(
        (float(max(value - width, unknown.low)), float(min(value + width, unknown.high)))
        for unknown, value, width in zip(model.unknowns, values, widths, strict=True)
    )
    contribution = [predicted - model.predict(runs, theta, values, leave_out=index) for index in range(len(terms))]
    return Corrected(
        model=model,
        values=values,
        ci95=intervals,
        groups=dataclasses.replace(fit, theta=theta, predicted=predicted, jacobian=jacobian[:, :groups]),
        beside=jacobian[:, groups:],
        contribution=tuple(contribution),
    )


def _at(model: Model, runs: Runs, theta: Array, values: Array) -> Model:
    """The model with the loads of its terms computed at these parameters instead of the refit's."""
    setting = model.setting(runs, theta, values)
    return dataclasses.replace(model, terms=tuple(_with_load_of(term, setting) for term in model.terms))


def _with_load_of(term: Term, setting: Setting) -> Term:
    """The term with the load of these parameters, where its size is a share of a load."""
    if term.at_work is None:
        return term
    load = term.hypothesis.load(term.hypothesis, setting)
    if load is None:
        return term
    rolling_kg = None if term.of_rolling_kg is None else setting.rolling_kg
    return dataclasses.replace(term, load=load, columns=load[:, None] * term.at_work, of_rolling_kg=rolling_kg)


def _descended(
    fit: Refit, model: Model, runs: Runs, chosen: Mask, start: tuple[Array, Array, Array, Array], to_first: bool = False
) -> tuple[Array, Array, Array, Array]:
    """Gauss-Newton over the chosen windows, each step halved until its replay is better than that before.

    Takes and returns parameters, values, their prediction and its Jacobian; `fit` gives the free groups and bounds. If
    `to_first`, it stops after a whole step that is better: near a fit the linear model holds.
    """
    theta, values, predicted, jacobian = start
    error = float(np.sum((runs.observed - predicted)[chosen] ** 2))
    for _ in range(_ITERATIONS):
        at = dataclasses.replace(fit, theta=theta)
        residual = (runs.observed - predicted)[chosen]
        _, to_theta, to_values = _stepped(at, model, values, jacobian[chosen], residual)
        for share in _HALVED:
            tried_theta = theta + share * (to_theta - theta)
            # A whole step to a bound may exceed it by rounding.
            tried_values = np.clip(values + share * (to_values - values), *model.bounds)
            replayed = model.predict(runs, tried_theta, tried_values)
            after = float(np.sum((runs.observed - replayed)[chosen] ** 2))
            if after < error:
                break
        else:
            break
        theta, values, predicted = tried_theta, tried_values, replayed
        if to_first and share == 1.0:
            break
        hardly_falls = after > error * (1.0 - 1e-7)
        error = after
        jacobian = _jacobian(model, runs, theta, values, predicted, fit.held)
        if hardly_falls:
            break
    return theta, values, predicted, jacobian


def immaterial(fit: Refit, runs: Runs) -> Mask:
    """Groups without a material contribution, shape (groups,): beside effects they are held as assumed.

    The mass on level ground also enters the force of turning, and would be confounded with it.
    """
    size = np.maximum(np.abs(fit.theta) / fit.parameters.scale, 1.0)
    return ~excited(fit, runs, thresholds.MATERIAL_SHARE / size)


def _without_spanned(fit: Refit, terms: Sequence[Term], runs: Runs) -> Refit:
    """The refit with groups held that a flexible form contains: a line is one of the rising functions."""
    flexible = [term.columns for term in terms if term.flexible]
    if not flexible:
        return fit
    columns = np.column_stack(flexible)
    residual = fit.jacobian - columns @ np.linalg.lstsq(columns, fit.jacobian, rcond=None)[0]
    spanned = (residual**2).sum(axis=0) < thresholds.COLLINEAR * (fit.jacobian**2).sum(axis=0)
    return holding(fit, runs, fit.held | spanned) if spanned.any() else fit


def _unknowns(terms: Sequence[Term], nominal: Robot) -> tuple[Unknown, ...]:
    """The numbers of these terms that are fitted: sizes, and parameters of the kernel that recordings may identify."""
    unknowns: list[Unknown] = []
    for index, term in enumerate(terms):
        unknowns += _sizes(index, term, nominal)
        if not term.linear:
            unknowns += _searched_parameters(index, term)
    return tuple(unknowns)


def _sizes(index: int, term: Term, nominal: Robot) -> list[Unknown]:
    in_file = nominal.effects.get(term.effect, {}) if term.of_rolling_kg is None else {}
    # Bounds of a column that is linear near one size only, such as a lag, do not hold where it is replayed.
    lows, highs = (term.low, term.high) if term.linear else term.hypothesis.limits(len(term.low))
    sizes = []
    for column, (name, unit) in enumerate(term.hypothesis.size_names(term)):
        given = in_file.get(name, 0.0)
        # A linear column adds to what the file has of the effect.
        low = float(lows[column]) + (given if term.linear else 0.0)
        sizes.append(
            Unknown(
                effect=term.effect,
                parameter=name,
                unit=unit,
                low=low,
                high=float(highs[column]),
                term=index,
                column=column,
                given=given,
            )
        )
    return sizes


def _searched_parameters(index: int, term: Term) -> list[Unknown]:
    return [
        Unknown(
            effect=term.effect,
            parameter=parameter.name,
            unit=parameter.unit,
            low=parameter.low,
            high=parameter.high,
            term=index,
            column=None,
            given=term.shape[parameter.name],
        )
        for parameter in term.hypothesis.searched
        if parameter.name in term.shape
    ]


def _start(fit: Refit, model: Model, runs: Runs) -> tuple[Array, Array]:
    """Starting parameters and values, by the terms' columns at the shapes that were tried."""
    beside = []
    for unknown in model.unknowns:
        columns = model.terms[unknown.term].columns
        beside.append(np.zeros(len(columns)) if unknown.column is None else columns[:, unknown.column])
    jacobian = np.column_stack([fit.jacobian, *beside])
    _, theta, values = _stepped(fit, model, model.given, jacobian, runs.observed - fit.predicted)
    return theta, values


def _jacobian(model: Model, runs: Runs, theta: Array, values: Array, predicted: Array, held: Mask) -> Array:
    """Derivatives of the prediction at theta and values, which is `predicted`, shape (windows,), by the groups and the
    unknowns, (windows, columns); 0 for groups that are `held`."""
    columns = derivatives(model.parameters, theta, predicted, lambda moved: model.predict(runs, moved, values), held)
    for index, unknown in enumerate(model.unknowns):
        term = model.terms[unknown.term]
        if unknown.column is not None and term.linear:
            columns.append(term.columns[:, unknown.column])
            continue
        step = SMALL_STEP * (abs(values[index]) or SMALL_STEP * (unknown.high - unknown.low))
        if values[index] + step > unknown.high:
            step = -step
        moved = values.copy()
        moved[index] += step
        columns.append((model.predict(runs, theta, moved) - predicted) / step)
    return np.column_stack(columns)


def _stepped(at: Refit, model: Model, values: Array, jacobian: Array, residual: Array) -> tuple[Array, Array, Array]:
    """Best physical step from a fit and values, and the parameters and values after it."""
    step = bounded(jacobian.T @ jacobian, jacobian.T @ residual, *_bounds(at, model, values))
    groups = len(model.parameters.groups)
    return step, at.moved(step[:groups]), np.clip(values + step[groups:], *model.bounds)


def _bounds(at: Refit, model: Model, values: Array) -> tuple[Array, Array]:
    """Least and largest physical step of the groups (in units of `scale`) and of the unknowns."""
    low, high = at.freedom()
    least, most = model.bounds
    return np.concatenate([low, least - values - 1e-12]), np.concatenate([high, most - values + 1e-12])
