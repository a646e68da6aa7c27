"""The corrected model: nonlinear least squares of refit groups and named effects together, with 95
% intervals."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import t as student

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain.hypothesis import SMALL_STEP, Setting, Term
from homeward.diagnosis.fit.bounded import bounded
from homeward.diagnosis.fit.estimates import covariance, lasting_covariance
from homeward.diagnosis.fit.fitted import excited
from homeward.diagnosis.fit.parameter_groups import ROLLING, Parameters, derivatives
from homeward.diagnosis.fit.refit import Refit, holding
from homeward.diagnosis.fit.replay import Runs, WithEffects
from homeward.diagnosis.result import Value
from homeward.logs.channels import Array, Index, Mask
from homeward.physics import Robot

_ITERATIONS = 6  # most Gauss-Newton steps: a fit ends where the error no longer falls; chosen
_PASSES = 3  # of fitting to loads that depend on what is fitted; chosen: bounds the time
_SHARES_OF_A_STEP = (1.0, 0.5, 0.25, 0.125)  # chosen: if an eighth does not improve, the fit ends


@dataclass(frozen=True)
class Unknown:
    """One fitted number of an effect: a level of a schedule, a component of the wind, or a
    parameter of the kernel."""

    effect: str
    parameter: str  # name in the robot file or in the report
    unit: str
    low: float
    high: float
    term: int  # which of the terms it belongs to
    column: int | None  # of the term, or None for a parameter of the kernel
    # value in the robot file or, of a parameter of the kernel, where its search starts
    reference: float = 0.0

    @property
    def name(self) -> str:
        """Effect and parameter."""
        return f"{self.effect} {self.parameter}"


Shares = Sequence[Array | None]
"""For each term the shares by distance of the places of its profile, (sizes,), if only differences
between them are known; None otherwise."""


@dataclass(frozen=True)
class Reported:
    """Sizes as a report has them and their bounds, C_rr m that they are relative to, and
    derivatives of both by groups and unknowns."""

    sizes: Array  # (unknowns,)
    bounds: Array  # least and largest value, (2, unknowns)
    by_all: Array  # (unknowns, groups + unknowns)
    rolling_kg: float
    rolling_by_all: Array  # (groups + unknowns,)


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
    def reference(self) -> Array:
        """Values from which contributions count, shape (unknowns,)."""
        return np.array([unknown.reference for unknown in self.unknowns])

    def of(self, index: int) -> list[int]:
        """Indices of the unknowns of a term."""
        return [number for number, unknown in enumerate(self.unknowns) if unknown.term == index]

    def _added(self, index: int, values: Array) -> Array:
        """What a term adds by its columns at these values, shape (windows,)."""
        sizes = (values - self.reference)[self.of(index)]
        return np.asarray(self.terms[index].columns @ sizes)

    def predict(
        self, runs: Runs, theta: Array, values: Array, leave_out: int | None = None
    ) -> Array:
        """Prediction, (windows,), by parameters and a value per unknown, without term `leave_out`
        if given."""
        added = np.zeros(len(runs.observed))
        for index, term in enumerate(self.terms):
            if term.linear and index != leave_out:
                added += self._added(index, values)
        within = self.within(runs, theta, values, leave_out)
        return self.parameters.predict(runs, theta, within) + added

    def within(
        self, runs: Runs, theta: Array, values: Array, leave_out: int | None = None
    ) -> WithEffects:
        """The terms that are not linear in their sizes, as additions to the replay."""
        within = WithEffects()
        for index, term in enumerate(self.terms):
            if term.linear or index == leave_out:
                continue
            if term.of_rolling_kg is not None:
                within = self._over_ground(within, index, theta, values)
                continue
            numbers = dict(term.shape)
            for number in self.of(index):
                numbers[self.unknowns[number].parameter] = float(values[number])
            within = term.hypothesis.within(term.hypothesis, within, numbers, runs)
        return within

    def share(self, index: int, theta: Array) -> float:
        """Factor from fitted sizes to shares of the rolling resistance fitted with them; 1 for
        other effects.

        Sizes of rough ground are of another C_rr m (`Term.of_rolling_kg`), as only its product with
        the rise is known.
        """
        rolling_kg = self.terms[index].of_rolling_kg
        if rolling_kg is None:
            return 1.0
        return rolling_kg / max(float(theta[ROLLING]), 1e-9)

    def reported(self, theta: Array, values: Array, by_distance: Shares, held: Mask) -> Reported:
        """The sizes as a report has them, with C_rr m of the ground that they are relative to.

        Sizes of a profile of which only differences are known (`by_distance`) are relative to its
        mean: with rough ground, C_rr m is that of the mean ground, but for a C_rr m that is `held`,
        shape (groups,), of which they are shares.
        """
        groups = len(theta)
        # Derivatives of the fitted numbers by themselves, by groups, then by unknowns. Groups count
        # from the end of theirs.
        each_by_all = np.eye(groups + len(values))
        theta_by_all = each_by_all[:groups]
        sizes = values.copy()
        bounds = self.bounds.copy()
        by_all = each_by_all[groups:].copy()
        rolling_kg = float(theta[ROLLING])
        rolling_by_all = theta_by_all[ROLLING]
        for index, term in enumerate(self.terms):
            numbers = self.of(index)
            shares = by_distance[index]
            least = -np.inf
            if term.of_rolling_kg is not None:
                # C_rr m of each place over that of the ground that it is compared with
                places_kg = theta[ROLLING] + term.of_rolling_kg * values[numbers]
                places_by_all = theta_by_all[ROLLING] + term.of_rolling_kg * by_all[numbers]
                if shares is not None and not held[ROLLING]:
                    rolling_kg = float(shares @ places_kg)
                    rolling_by_all = shares @ places_by_all
                    least = -1.0  # no ground rolls easier than not at all
                ratio = places_kg / max(rolling_kg, 1e-9)
                sizes[numbers] = ratio - 1.0
                ratio_by_all = places_by_all - np.outer(ratio, rolling_by_all)
                by_all[numbers] = ratio_by_all / max(rolling_kg, 1e-9)
                bounds[:, numbers] *= self.share(index, theta)
            if shares is not None:
                # Of sizes relative to the mean ground, the mean is zero already.
                sizes[numbers] -= shares @ sizes[numbers]
                by_all[numbers] -= shares @ by_all[numbers]
                # Differences have no bounds.
                bounds[:, numbers] = [[least], [np.inf]]
        return Reported(sizes, bounds, by_all, rolling_kg, rolling_by_all)

    def _over_ground(
        self, within: WithEffects, index: int, theta: Array, values: Array
    ) -> WithEffects:
        """Rough ground as an addition to the replay, on top of what the robot file has of it."""
        term = self.terms[index]
        assert term.at_work is not None
        rise = self.share(index, theta) * (term.at_work @ values[self.of(index)])
        gain, usual = term.hypothesis.entry.parameters
        in_file = self.parameters.nominal.effects.get(term.effect, {})
        rise_in_file = in_file.get(gain.name, 0.0) * in_file.get(usual.name, 0.0)
        return dataclasses.replace(
            within,
            effects={**within.effects, term.effect: {gain.name: 1.0}},
            roughness=(1.0 + rise_in_file) * (1.0 + rise) - 1.0,
        )

    def setting(self, runs: Runs, theta: Array, values: Array) -> Setting:
        """Prediction of these parameters and values by a replay, and its residual.

        Flexible forms are in their form in a robot file: a load on top, for example, also makes
        turning harder.
        """
        within = self.within(runs, theta, values)
        for index, term in enumerate(self.terms):
            plain = term.plain
            if plain is None or plain.columns.shape[1] != 1:
                continue
            size_in_file, _ = plain.hypothesis.in_file(self.parameters.nominal)
            size = size_in_file + _closest_size(plain, self._added(index, values))
            numbers = {**plain.shape, plain.hypothesis.entry.switch.name: size}
            within = plain.hypothesis.within(plain.hypothesis, within, numbers, runs)
        predicted = self.parameters.predict(runs, theta, within)
        return Setting(
            runs=runs,
            parameters=self.parameters,
            theta=theta,
            present=within,
            predicted=predicted,
            residual=runs.observed - predicted,
        )


def _closest_size(term: Term, added: Array) -> float:
    """Size at which a term of one size is closest to what another adds, shape (windows,), within
    its bounds."""
    column = term.columns[:, 0]
    projected = float(column @ added) / max(float(column @ column), 1e-300)
    return float(np.clip(projected, term.low[0], term.high[0]))


@dataclass(frozen=True)
class Corrected:
    """The fitted model, linearised so that it can be refitted on a part of the windows."""

    model: Model
    values: Array  # (unknowns,)
    ci95: tuple[tuple[float, float], ...]  # of the sizes as reported
    groups: Refit  # of the groups of the refit, fitted together with the effects
    beside: Array  # (windows, unknowns): derivative of the prediction, per unit of each unknown
    contribution: tuple[Array, ...]  # power or current of each term, shape (windows,)
    by_distance: Shares
    least_variance: Array  # of the sizes as reported, (unknowns,)

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
        """Derivative of the prediction by groups (in units of `scale`) and unknowns, shape
        (windows, columns)."""
        return np.column_stack([self.groups.jacobian, self.beside])

    def profiles_over(self, group: int) -> list[Term]:
        """Profiles along the way that contain a group, by its index: more C_rr is rougher ground
        all along, and only their sum is known."""
        profiles = []
        for index, term in enumerate(self.model.terms):
            is_profile = term.axis == "place" and term.schedule is None
            if (
                is_profile
                and _spanned(
                    self.groups.jacobian[:, [group]], self.beside[:, self.model.of(index)]
                ).all()
            ):
                profiles.append(term)
        return profiles

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
        step = _best_step(self.groups, self.model, self.values, self.jacobian[chosen], residual)
        theta, values = _moved(self.groups, self.model, self.values, step)
        groups = dataclasses.replace(
            self.groups, theta=theta, predicted=self.predicted + self.jacobian @ step
        )
        return dataclasses.replace(self, values=values, groups=groups)

    def beyond_bounds(self, numbers: Sequence[int], observed: Array) -> tuple[Array, Array]:
        """Parameters and values after a step on which these unknowns, by their numbers, have no
        bounds."""
        residual = observed - self.predicted
        step = _step_beyond(self.groups, self.model, self.values, self.jacobian, residual, numbers)
        groups = len(self.theta)
        return self.groups.moved(step[:groups]), self.values + step[groups:]

    def refitted(self, chosen: Mask, runs: Runs) -> Corrected:
        """The same fitted to the chosen windows only, by replays, with further steps where one
        overshoots."""
        start = _Point(self.theta, self.values, self.predicted, self.jacobian)
        end = _descended(self.groups, self.model, runs, chosen, start, to_first=True)
        groups = dataclasses.replace(self.groups, theta=end.theta, predicted=end.predicted)
        return dataclasses.replace(self, values=end.values, groups=groups)

    def replayed(self, runs: Runs) -> Array:
        """Prediction by a replay with these parameters and effects, shape (windows,)."""
        return self.model.predict(runs, self.theta, self.values)

    @property
    def reported(self) -> Reported:
        """The sizes as a report has them."""
        return self.model.reported(self.theta, self.values, self.by_distance, self.groups.held)

    def parameters_of(self, index: int) -> dict[str, Value]:
        """Fitted parameters of one named effect, those of a profile relative to its mean where only
        that is known."""
        term = self.model.terms[index]
        sizes = self.reported.sizes.tolist()
        parameters: dict[str, Value] = {}
        for number in self.model.of(index):
            unknown = self.model.unknowns[number]
            parameters[unknown.parameter] = Value(sizes[number], self.ci95[number], unknown.unit)
        for parameter in term.hypothesis.entry.parameters:
            name = parameter.name
            if name in term.spread:
                parameters[name] = Value(term.shape[name], term.spread[name], parameter.unit)
        return parameters

    def sizes(self, index: int) -> Array:
        """Fitted sizes of one named effect, shape (sizes,)."""
        return self.values[self.model.of(index)]

    def share(self, index: int) -> float:
        """Factor from the fitted sizes of an effect to those in a file, see `Model.share`."""
        return self.model.share(index, self.theta)


def fit_model(fit: Refit, terms: Sequence[Term], runs: Runs, block: Index) -> Corrected:
    """Fit the groups and the named effects together, by Gauss-Newton through the kernel.

    Groups that the refit holds are not fitted; intervals are clustered by `block`, shape
    (windows,). Where the losses of the file would take the share of regeneration beyond its bound,
    the drive loses as much less as that needs.
    """
    fit = _without_spanned(fit, terms, runs)
    model, point = _fitted(fit, terms, runs)
    for _ in range(_PASSES - 1):
        efficiency = _least_efficiency(fit, model, point, runs)
        if efficiency <= fit.parameters.nominal.traction_efficiency:
            break
        fit = _of_efficiency(fit, efficiency)
        model, point = _fitted(fit, terms, runs)
    groups = len(fit.parameters.groups)
    contribution = [
        point.predicted - model.predict(runs, point.theta, point.values, leave_out=index)
        for index in range(len(terms))
    ]
    by_distance = _shares_by_distance(model, point, runs)
    reported = model.reported(point.theta, point.values, by_distance, fit.held)
    least_variance = _least_variance(model, point, runs, reported)
    return Corrected(
        model=model,
        values=point.values,
        ci95=_intervals(model, point, runs, block, reported, least_variance),
        groups=dataclasses.replace(
            fit, theta=point.theta, predicted=point.predicted, jacobian=point.jacobian[:, :groups]
        ),
        beside=point.jacobian[:, groups:],
        contribution=tuple(contribution),
        by_distance=by_distance,
        least_variance=least_variance,
    )


def _fitted(fit: Refit, terms: Sequence[Term], runs: Runs) -> tuple[Model, _Point]:
    """The model of these terms and where its descent ends, by losses of the drive as `fit` has
    them."""
    model = Model(fit.parameters, tuple(terms), _unknowns(terms, fit.parameters.nominal))
    all_windows = np.ones(len(runs.observed), np.bool_)
    theta, values = _start(fit, model, runs)
    point = _descended(fit, model, runs, all_windows, _linearised(fit, model, runs, theta, values))
    # The load per unit of a size depends on the groups, such as a share of the power.
    loads_depend_on_groups = any(term.at_work is not None and term.linear for term in terms)
    for _ in range(_PASSES - 1):
        if not loads_depend_on_groups and not _ground_is_at_a_bound(model, point.values):
            break
        model, values = _with_loads_at(model, runs, point.theta, point.values)
        point = _descended(
            fit, model, runs, all_windows, _linearised(fit, model, runs, point.theta, values)
        )
    return model, point


def _least_efficiency(fit: Refit, model: Model, point: _Point, runs: Runs) -> float:
    """Efficiency of the drive from which on no size exceeds its bound of which only the product
    with it is known; that of `fit` where none does."""
    efficiency = fit.parameters.nominal.traction_efficiency
    if runs.unit == "A":
        return efficiency
    at_point = dataclasses.replace(fit, theta=point.theta)
    for number, unknown in enumerate(model.unknowns):
        term = model.terms[unknown.term]
        is_product = term.hypothesis.times_efficiency and not term.linear
        is_size = unknown.column is not None
        if is_product and is_size and point.values[number] >= unknown.high:
            residual = runs.observed - point.predicted
            step = _step_beyond(at_point, model, point.values, point.jacobian, residual, [number])
            size = unknown.high + float(step[len(point.theta) + number])
            efficiency *= size / unknown.high
    return min(efficiency, 1.0)


def _of_efficiency(fit: Refit, efficiency: float) -> Refit:
    """The same fit of a drive with another efficiency."""
    parameters = fit.parameters.of_efficiency(efficiency)
    theta = fit.theta * parameters.scale / fit.parameters.scale
    return dataclasses.replace(fit, parameters=parameters, theta=theta)


@dataclass(frozen=True)
class _Point:
    """A point of the descent: the fitted numbers, their prediction, and its derivatives."""

    theta: Array  # (groups,)
    values: Array  # (unknowns,)
    predicted: Array  # (windows,)
    jacobian: Array  # (windows, groups + unknowns)


def _linearised(fit: Refit, model: Model, runs: Runs, theta: Array, values: Array) -> _Point:
    """Prediction and derivatives at these parameters and values; groups that `fit` holds have no
    derivative."""
    predicted = model.predict(runs, theta, values)
    return _Point(
        theta, values, predicted, _jacobian(model, runs, theta, values, predicted, fit.held)
    )


def _shares_by_distance(model: Model, point: _Point, runs: Runs) -> Shares:
    """Of each profile of which only differences between places are known, the shares of the
    distance driven there; None for other terms.

    Where all sizes together do what other parameters do, their level is not known: rough ground all
    along is a larger C_rr, unless that is held, and so is a slope all along if the robot drives one
    way only.
    """
    driven_m = np.abs(runs.context["speed_mps"]) * runs.duration_s
    groups = len(model.parameters.groups)
    shares: list[Array | None] = []
    for index, term in enumerate(model.terms):
        is_profile = term.axis == "place" and term.schedule is None
        if not is_profile or term.at_work is None:
            shares.append(None)
            continue
        columns = [groups + number for number in model.of(index)]
        others = np.delete(point.jacobian, columns, axis=1)
        level = point.jacobian[:, columns].sum(axis=1, keepdims=True)
        if _spanned(level, others).all():
            by_place = driven_m @ term.at_work
            shares.append(by_place / by_place.sum())
        else:
            shares.append(None)
    return tuple(shares)


def _intervals(
    model: Model,
    point: _Point,
    runs: Runs,
    block: Index,
    reported: Reported,
    least_variance: Array,
) -> tuple[tuple[float, float], ...]:
    """95 % interval of each size as reported, within its bounds, by Student's t with the freedom
    that blocks leave."""
    by_columns = _by_columns(model, reported)
    clustered = covariance(point.jacobian, runs.observed - point.predicted, block)
    variance = np.einsum("ij,jk,ik->i", by_columns, clustered, by_columns)
    variance = np.maximum(variance, least_variance)
    # A meter's scale is uncertain, and every size with it.
    variance = variance + (thresholds.GAIN_ERROR * reported.sizes) ** 2
    blocks = int(block.max()) + 1
    freedom = max(blocks - point.jacobian.shape[1], 1)
    widths = float(student.ppf(0.975, freedom)) * np.sqrt(np.maximum(variance, 0.0))
    least, largest = reported.bounds
    lows = np.maximum(reported.sizes - widths, least)
    highs = np.minimum(reported.sizes + widths, largest)
    return tuple(zip(lows.tolist(), highs.tolist(), strict=True))


def _least_variance(model: Model, point: _Point, runs: Runs, reported: Reported) -> Array:
    """Variance of sizes by place, of errors that are alike in all windows and autocorrelated, shape
    (unknowns,); 0 of other sizes.

    A place is driven in few blocks, and the sums of errors over them are what its size fits away:
    clustered by block, the error of a size by place would be next to none.
    """
    in_place = [model.terms[unknown.term].axis == "place" for unknown in model.unknowns]
    if not any(in_place):
        return np.zeros(len(in_place))
    lasting = lasting_covariance(point.jacobian, runs.observed - point.predicted, runs.run)
    by_columns = _by_columns(model, reported)
    variance = np.einsum("ij,jk,ik->i", by_columns, lasting, by_columns)
    return np.where(in_place, variance, 0.0)


def _by_columns(model: Model, reported: Reported) -> Array:
    """Derivatives of the sizes as reported by the columns of the jacobian, those of groups per unit
    of `scale`."""
    unit_of_column = np.concatenate([model.parameters.scale, np.ones(len(model.unknowns))])
    return np.asarray(reported.by_all * unit_of_column)


def _ground_is_at_a_bound(model: Model, values: Array) -> bool:
    """Whether a size of rough ground is at its bound, which is meant as a share of the C_rr m
    fitted with it."""
    lowest, highest = model.bounds
    is_at_bound = (values <= lowest) | (values >= highest)
    of_ground = [model.terms[unknown.term].of_rolling_kg is not None for unknown in model.unknowns]
    return bool((is_at_bound & of_ground).any())


def _with_loads_at(model: Model, runs: Runs, theta: Array, values: Array) -> tuple[Model, Array]:
    """The model with the loads of its terms computed at these parameters instead of the refit's,
    and its values."""
    setting = model.setting(runs, theta, values)
    moved = dataclasses.replace(
        model, terms=tuple(_with_load_of(term, setting) for term in model.terms)
    )
    values = values.copy()
    for index in range(len(model.terms)):
        # Sizes of rough ground as shares of another C_rr m.
        values[model.of(index)] *= model.share(index, theta) / moved.share(index, theta)
    return moved, np.clip(values, *model.bounds)


def _with_load_of(term: Term, setting: Setting) -> Term:
    """The term with the load of these parameters, where its size is a share of a load."""
    if term.of_rolling_kg is not None:
        return _as_share_of(term, setting.rolling_kg)
    if term.at_work is None or not term.linear:
        return term
    load = term.hypothesis.load(term.hypothesis, setting)
    if load is None:
        return term
    return dataclasses.replace(term, load=load, columns=load[:, None] * term.at_work)


def _as_share_of(term: Term, rolling_kg: float) -> Term:
    """Rough ground with its sizes as shares of another C_rr m, kg."""
    assert term.of_rolling_kg is not None and term.load is not None
    ratio = rolling_kg / term.of_rolling_kg
    return dataclasses.replace(
        term, of_rolling_kg=rolling_kg, load=ratio * term.load, columns=ratio * term.columns
    )


@dataclass(frozen=True)
class _Trial:
    """A share of a step, at its replay."""

    share: float
    theta: Array  # (groups,)
    values: Array  # (unknowns,)
    predicted: Array  # (windows,)
    squared_error: float  # over the windows that are fitted


def _descended(
    fit: Refit, model: Model, runs: Runs, chosen: Mask, start: _Point, to_first: bool = False
) -> _Point:
    """Gauss-Newton over the chosen windows, each step halved until its replay is better than that
    before.

    `fit` gives the free groups and bounds. If `to_first`, it stops after a whole step that is
    better, with the derivatives of its start: near a fit the linear model holds.
    """
    point = start
    error = _squared_error(runs, point.predicted, chosen)
    for _ in range(_ITERATIONS):
        trial = _better_trial(fit, model, runs, chosen, point, error)
        if trial is None:
            break
        if to_first and trial.share == 1.0:
            return _Point(trial.theta, trial.values, trial.predicted, point.jacobian)
        hardly_falls = trial.squared_error > error * (1.0 - 1e-7)
        error = trial.squared_error
        jacobian = _jacobian(model, runs, trial.theta, trial.values, trial.predicted, fit.held)
        point = _Point(trial.theta, trial.values, trial.predicted, jacobian)
        if hardly_falls:
            break
    return point


def _better_trial(
    fit: Refit, model: Model, runs: Runs, chosen: Mask, point: _Point, error: float
) -> _Trial | None:
    """The largest share of a Gauss-Newton step whose replay lowers the squared error; None if none
    does."""
    at_point = dataclasses.replace(fit, theta=point.theta)
    residual = (runs.observed - point.predicted)[chosen]
    step = _best_step(at_point, model, point.values, point.jacobian[chosen], residual)
    whole_theta, whole_values = _moved(at_point, model, point.values, step)
    for share in _SHARES_OF_A_STEP:
        theta = point.theta + share * (whole_theta - point.theta)
        # A whole step to a bound may exceed it by rounding.
        values = np.clip(point.values + share * (whole_values - point.values), *model.bounds)
        predicted = model.predict(runs, theta, values)
        squared_error = _squared_error(runs, predicted, chosen)
        if squared_error < error:
            return _Trial(share, theta, values, predicted, squared_error)
    return None


def _squared_error(runs: Runs, predicted: Array, chosen: Mask) -> float:
    """Of a prediction, summed over the chosen windows."""
    return float(np.sum((runs.observed - predicted)[chosen] ** 2))


def immaterial(fit: Refit, runs: Runs) -> Mask:
    """Groups without a material contribution, shape (groups,): beside effects they are held as
    assumed.

    The mass on level ground also enters the force of turning, and would be confounded with it.
    """
    size = np.maximum(np.abs(fit.theta) / fit.parameters.scale, 1.0)
    return ~excited(fit, runs, thresholds.MATERIAL_SHARE / size)


def _without_spanned(fit: Refit, terms: Sequence[Term], runs: Runs) -> Refit:
    """The refit with groups held that a flexible form contains: a line is one of the rising
    functions."""
    flexible = [term.columns for term in terms if term.flexible]
    if not flexible:
        return fit
    spanned = _spanned(fit.jacobian, np.column_stack(flexible))
    if not spanned.any():
        return fit
    return holding(fit, runs, fit.held | spanned)


def _spanned(jacobian: Array, columns: Array) -> Mask:
    """Groups, by their columns, that are combinations of others, shape (groups,); both have a row
    for each window."""
    weights, *_ = np.linalg.lstsq(columns, jacobian, rcond=None)
    residual = jacobian - columns @ weights
    return np.asarray((residual**2).sum(axis=0) < thresholds.COLLINEAR * (jacobian**2).sum(axis=0))


def _unknowns(terms: Sequence[Term], nominal: Robot) -> tuple[Unknown, ...]:
    """The numbers of these terms that are fitted: sizes, and parameters of the kernel that
    recordings may identify."""
    unknowns: list[Unknown] = []
    for index, term in enumerate(terms):
        unknowns += _sizes(index, term, nominal)
        if not term.linear:
            unknowns += _searched_parameters(index, term)
    return tuple(unknowns)


def _sizes(index: int, term: Term, nominal: Robot) -> list[Unknown]:
    # Shares of the rolling resistance count from none, whatever the file has of the effect.
    in_file = nominal.effects.get(term.effect, {}) if term.of_rolling_kg is None else {}
    # Bounds of a column that is linear near one size only, such as a lag, do not hold where it is
    # replayed.
    is_form_of_kernel = not term.linear and term.at_work is None
    lows, highs = (
        term.hypothesis.limits(len(term.low)) if is_form_of_kernel else (term.low, term.high)
    )
    sizes = []
    for column, (name, unit) in enumerate(term.hypothesis.size_names(term)):
        reference = in_file.get(name, 0.0)
        low = float(lows[column])
        if term.linear:
            low += reference  # a linear column adds to what the file has of the effect
        size = Unknown(
            effect=term.effect,
            parameter=name,
            unit=unit,
            low=low,
            high=float(highs[column]),
            term=index,
            column=column,
            reference=reference,
        )
        sizes.append(size)
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
            reference=term.shape[parameter.name],
        )
        for parameter in term.hypothesis.searched
        if parameter.name in term.shape
    ]


def _start(fit: Refit, model: Model, runs: Runs) -> tuple[Array, Array]:
    """Starting parameters and values, by the terms' columns at the shapes that were tried."""
    per_rolling_kg = (
        None if fit.held[ROLLING] else fit.jacobian[:, ROLLING] / fit.parameters.scale[ROLLING]
    )
    columns = [
        _tried_column(model.terms[unknown.term], unknown, per_rolling_kg)
        for unknown in model.unknowns
    ]
    jacobian = np.column_stack([fit.jacobian, *columns])
    step = _best_step(fit, model, model.reference, jacobian, runs.observed - fit.predicted)
    return _moved(fit, model, model.reference, step)


def _tried_column(term: Term, unknown: Unknown, per_rolling_kg: Array | None) -> Array:
    """Column of an unknown before any replay, shape (windows,); 0 for a parameter of the kernel.

    `per_rolling_kg` is the derivative by C_rr m, None where it is held.
    """
    if unknown.column is None:
        return np.zeros(len(term.columns))
    if term.of_rolling_kg is not None and per_rolling_kg is not None:
        return _column_of_ground(term, unknown.column, per_rolling_kg)
    return term.columns[:, unknown.column]


def _jacobian(
    model: Model, runs: Runs, theta: Array, values: Array, predicted: Array, fixed: Mask
) -> Array:
    """Derivatives of the prediction at theta and values, which is `predicted`, shape (windows,), by
    the groups and the unknowns, (windows, columns); 0 for groups that are `fixed`."""

    def by_groups(held: Mask) -> list[Array]:
        return derivatives(
            model.parameters,
            theta,
            predicted,
            lambda moved: model.predict(runs, moved, values),
            held,
        )

    columns = by_groups(fixed)
    by_rolling = columns[ROLLING]
    if fixed[ROLLING] and any(term.of_rolling_kg is not None for term in model.terms):
        all_but_rolling = np.ones(len(fixed), np.bool_)
        all_but_rolling[ROLLING] = False
        by_rolling = by_groups(all_but_rolling)[ROLLING]
    per_rolling_kg = by_rolling / model.parameters.scale[ROLLING]
    for index, unknown in enumerate(model.unknowns):
        term = model.terms[unknown.term]
        if unknown.column is not None and term.linear:
            columns.append(term.columns[:, unknown.column])
            continue
        if unknown.column is not None and term.of_rolling_kg is not None:
            columns.append(_column_of_ground(term, unknown.column, per_rolling_kg))
            continue
        size = abs(values[index])
        if size == 0.0:
            size = SMALL_STEP * (unknown.high - unknown.low)
        step = SMALL_STEP * size
        # A difference quotient forwards or, at the upper bound, backwards.
        if values[index] + step > unknown.high:
            step = -step
        moved = values.copy()
        moved[index] += step
        columns.append((model.predict(runs, theta, moved) - predicted) / step)
    return np.column_stack(columns)


def _column_of_ground(term: Term, column: int, per_rolling_kg: Array) -> Array:
    """Derivative by a size of rough ground, from that by the C_rr m of all ground, per kg; both of
    shape (windows,).

    A window shows its own ground only, or nearly so if the reading lags. Sizes of a profile add up
    to C_rr m, and only their sum is known: difference quotients of their own, which err at kinks,
    would tell them apart.
    """
    assert term.of_rolling_kg is not None and term.at_work is not None
    return np.asarray(term.of_rolling_kg * term.at_work[:, column] * per_rolling_kg)


def _best_step(fit: Refit, model: Model, values: Array, jacobian: Array, residual: Array) -> Array:
    """Physical step of the groups (in units of `scale`) and of the unknowns that lowers the squared
    error most."""
    low, high = _bounds(fit, model, values)
    return bounded(jacobian.T @ jacobian, jacobian.T @ residual, low, high)


def _step_beyond(
    fit: Refit,
    model: Model,
    values: Array,
    jacobian: Array,
    residual: Array,
    numbers: Sequence[int],
) -> Array:
    """The same step where unknowns, by their `numbers`, have no bounds."""
    low, high = _bounds(fit, model, values)
    columns = len(model.parameters.groups) + np.asarray(numbers)
    low[columns] = -np.inf
    high[columns] = np.inf
    return bounded(jacobian.T @ jacobian, jacobian.T @ residual, low, high)


def _moved(fit: Refit, model: Model, values: Array, step: Array) -> tuple[Array, Array]:
    """Parameters and values after a step from a fit and values, within their bounds."""
    groups = len(model.parameters.groups)
    return fit.moved(step[:groups]), np.clip(values + step[groups:], *model.bounds)


def _bounds(fit: Refit, model: Model, values: Array) -> tuple[Array, Array]:
    """Least and largest physical step of the groups (in units of `scale`) and of the unknowns."""
    low, high = fit.freedom()
    lowest, highest = model.bounds
    # The margin keeps a value at a bound inside, whatever its rounding.
    low_of_values = lowest - values - 1e-12
    high_of_values = highest - values + 1e-12
    return np.concatenate([low, low_of_values]), np.concatenate([high, high_of_values])
