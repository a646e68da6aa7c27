"""A robot file made to predict: all numbers that a file may hold, fitted together and held near what is known of them.

    x_j = c_j + s_j z_j within bounds;   min over z of  sum_i d_i (P_i - replay_i(x))^2 / S0 + lambda |z|^2 / n

d_i is the length of a window, n the minutes recorded, S0 the same sum at a first fit: a minute counts as one
independent observation of power. c_j and s_j are the mean and standard deviation of what is known of a number before
any drive; lambda is what predicts drives best that a fit has not seen. Nothing is named here and nothing is proven: a
number that the drives do not show stays where it was.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.fitted import bounded
from homeward.diagnosis.fit.folds import per_block
from homeward.diagnosis.fit.parameter_groups import (
    DRAG,
    MASS,
    ROLLING,
    parameters,
    with_ancillary,
    with_effects_of,
)
from homeward.diagnosis.fit.replay import Runs, thrust_n_per_a
from homeward.logs.channels import Array, Index, Mask
from homeward.physics import Robot
from homeward.physics.effects import (
    EFFECTS,
    air_temperature,
    cooler,
    heater,
    inertia,
    regeneration,
    turning,
    viscous,
)

Replay = Callable[[Robot], Array]
"""Prediction for the windows by a robot."""

LOSSES = "losses"
INERTIA = f"{inertia.EFFECT.id}.{inertia.EFFECT.switch.name}"
REGENERATION = f"{regeneration.EFFECT.id}.{regeneration.EFFECT.switch.name}"
TURNING = f"{turning.EFFECT.id}.{turning.EFFECT.switch.name}"
ROLLING_PER_K = f"{air_temperature.EFFECT.id}.{air_temperature.EFFECT.switch.name}"
HEATER = f"{heater.EFFECT.id}.{heater.EFFECT.switch.name}"
SET_POINT = f"{heater.EFFECT.id}.{heater.EFFECT.parameters[1].name}"

_SWITCHES = {effect.id: effect.switch for effect in EFFECTS}

_MOST_LOST = 0.6
"""Losses of the drive, a share: the largest that is tried. Chosen: a small brushed motor with a worm gear."""
_STEPS, _HALVINGS = 15, 6  # most Gauss-Newton steps, and halvings of one that overshoots; chosen
_PRECISE = 1e-7  # of the sum that is minimised, relative: a fit ends; chosen
_SMALL = 1e-4  # of a scale, for a derivative by a finite difference; chosen
_HARDLY = 1e-3
"""Lambda of the first fit, whose error is what drives leave unexplained: hardly any prior. Chosen."""
_SURE = 1e-6
"""Least relative standard deviation of a measured number. Chosen: above rounding."""
_PENALTIES = np.logspace(-1.0, 1.0, 7)
"""Lambdas that are tried, about 1: prior and minutes then count as stated. Chosen: half a decade apart or less."""
_FEW_RUNS, _OF_FEW = 8, 0.3
"""Drives below which their errors are too few to choose by, and lambda then. Chosen: the middle of 0.1 and 1."""


@dataclass(frozen=True)
class Scales:
    """Standard deviations of the priors; `times` of the file's value, `of_power` of the mean power or current."""

    idle_of_power: float = 0.05
    """Electronics are the best known number of a file, as they are measured on a bench. Chosen."""
    rolling_times: float = 1.0
    """A coefficient is 0.01 on asphalt and 0.3 in sand (Wong, Theory of Ground Vehicles, ch. 1)."""
    drag_times: float = 1.0
    """A drag area is rarely known: it is guessed from a shape."""
    mass_times: float = 0.3
    """A load or a rider beside the weighed robot. Chosen: up to half of it."""
    losses: float = _MOST_LOST / 12.0**0.5
    """Anything between none and the most, as a uniform distribution."""
    inertia_times: float = 0.5
    """Of the moved mass: rotating parts add 0.04 + 0.0025 N^2, N the gear ratio (Gillespie, Fundamentals of Vehicle
    Dynamics, ch. 2), half of it at N = 14."""
    regeneration: float = 0.5
    """A share between none, which is expected where no drive shows it, and all."""
    turning: float = 0.3
    """Scrub over weight: rubber on hard ground rubs with 0.3 to 0.8, and a part of it is dragged sideways. Chosen."""
    climate_of_power: float = 0.02
    """Per kelvin of a heater or cooler: electric cars go 41 % less far at -7 C than at 24 C (AAA, 2019), which is 70 %
    more energy over 31 K."""
    rolling_per_k: float = 0.0026
    """From passenger cars (0.0086, UN GTR 15, Annex 4) to the tyres of lorries (0.006, ISO 28580)."""
    set_point_k: float = 3.0
    """Degree days count heating below 15 C to a base of 18 C, and cooling above 24 C to a base of 21 C (Eurostat)."""


SCALES = Scales()
_FACTOR = 1.0  # of inertia over mass: Newton's second law without rotating parts
_ROLLING_PER_K = 0.0086  # UN GTR 15, Annex 4
_SET_POINTS_C = {heater.EFFECT: 18.0, cooler.EFFECT: 24.0}  # of degree days, as above


@dataclass(frozen=True)
class Entry:
    """One number of a robot file: its name in `[uncertainty]`, unit, prior and bounds.

    Forces are over the efficiency of the drive, as recordings show them: C_rr m / Gamma, c / Gamma, m / Gamma. Inertia
    is the accelerated mass over Gamma, kg: only the product of mass and `mass_factor` is known.
    """

    name: str
    unit: str
    centre: float
    scale: float
    low: float
    high: float


def entries(runs: Runs, robot: Robot, named: Robot, scales: Scales = SCALES) -> tuple[Entry, ...]:
    """The numbers that are fitted to these runs.

    Args:
        runs: The runs.
        robot: The robot as its file has it: what is known of it.
        named: The same with named effects: further numbers, which may be as large as found.
        scales: Standard deviations of the priors.
    """
    problem = parameters(runs, robot)
    mean = float(np.average(np.abs(runs.observed), weights=runs.duration_s))
    wide = {
        "idle_power": scales.idle_of_power * mean,
        "rest_current": mean,  # hardly any file states it
        "rolling": scales.rolling_times * problem.scale[ROLLING],
        "drag": scales.drag_times * problem.scale[DRAG],
        "mass": scales.mass_times * problem.scale[MASS],
    }
    values = {group.name: float(problem.start[index]) for index, group in enumerate(problem.groups)}
    for name, measured in _measured(runs, robot, scales, values).items():
        wide[name] = min(wide.get(name, measured), measured)
    found = []
    for index, group in enumerate(problem.groups):
        per = float(problem.to_group[index])
        low, high = float(problem.low[index]), float(problem.high[index])
        if group.name == "sample_energy" and not np.ptp(runs.sensing_hz):
            continue
        scale = wide.get(group.name, float(problem.scale[index]))
        found.append(
            Entry(group.name, group.unit, per * float(problem.start[index]), per * scale, per * low, per * high)
        )
    found += _of_effects(runs, robot, mean, float(problem.to_group[MASS]), scales)
    found += _of_viscous(robot)
    known = {entry.name for entry in found}
    for effect, numbers in named.effects.items():
        switch = _SWITCHES[effect]
        name = f"{effect}.{switch.name}"
        size = numbers.get(switch.name, 0.0)
        if name not in known and size and numbers != robot.effects.get(effect):
            found.append(Entry(name, switch.unit, size, abs(size), switch.low, switch.high))
    return tuple(found)


def _measured(runs: Runs, robot: Robot, scales: Scales, values: Mapping[str, float]) -> dict[str, float]:
    """Standard deviations of what a coast-down test and a scale measured at the wheels, by name of the group.

    Recordings of power show the same over the drive's efficiency, which the test does not know: the drive's losses are
    as uncertain as without it. Recordings of motor current show it over the thrust per ampere of the file.
    """
    losses = scales.losses / robot.traction_efficiency if runs.unit == "W" else 0.0
    if runs.unit == "A" and robot.traction_n_per_a == 0.0:
        return {}
    measured = {name: _measured_share(robot, name) for name in values}
    return {
        name: values[name] * float(np.hypot(share, losses)) for name, share in measured.items() if share is not None
    }


def _measured_share(robot: Robot, name: str) -> float | None:
    """Relative standard deviation of a force or mass that was measured; None if it was not."""
    given = robot.uncertainty
    variance = given.variance(name) if given is not None and given.of == "force" else None
    return None if variance is None else max(float(np.sqrt(variance)), _SURE)


def _of_viscous(robot: Robot) -> list[Entry]:
    """Friction that grows with speed, where a coast-down test measured it."""
    switch = viscous.EFFECT.switch
    name = f"{viscous.EFFECT.id}.{switch.name}"
    size = robot.effects.get(viscous.EFFECT.id, {}).get(switch.name, 0.0)
    share = _measured_share(robot, name)
    if share is None or size == 0.0:
        return []
    return [Entry(name, switch.unit, size, share * size, switch.low, switch.high)]


def _of_effects(runs: Runs, robot: Robot, mean: float, per: float, scales: Scales) -> list[Entry]:
    """Effects that most robots have, whether or not a drive proves them."""

    def given(effect: str, number: str, otherwise: float) -> float:
        return robot.effects.get(effect, {}).get(number, otherwise)

    mass_kg = per * robot.mass_kg
    factor = inertia.EFFECT.switch
    found = [
        Entry(
            INERTIA, "kg", mass_kg * given(inertia.EFFECT.id, factor.name, _FACTOR), scales.inertia_times * mass_kg,
            0.0, factor.high * thresholds.MOST_TIMES * mass_kg,
        )
    ]  # fmt: skip
    if runs.unit == "W":
        share = regeneration.EFFECT.switch
        centre = given(regeneration.EFFECT.id, share.name, 0.0)
        found.append(Entry(REGENERATION, share.unit, centre, scales.regeneration, share.low, share.high))
        losses = robot.motor_loss + robot.friction_loss
        found.append(Entry(LOSSES, "1", losses, scales.losses, 0.0, max(_MOST_LOST, losses)))
    if runs.has("yaw_rate_radps") and robot.track_m > 0.0:
        scrub = turning.EFFECT.switch
        centre = given(turning.EFFECT.id, scrub.name, 0.0)
        found.append(Entry(TURNING, scrub.unit, centre, scales.turning, 0.0, scrub.high))
    if runs.has("temperature_c"):
        tyres = air_temperature.EFFECT.switch
        centre = given(air_temperature.EFFECT.id, tyres.name, _ROLLING_PER_K)
        found.append(Entry(ROLLING_PER_K, tyres.unit, centre, scales.rolling_per_k, tyres.low, tyres.high))
    # In one temperature a heater, a cooler and idle power are the same.
    if runs.unit == "W" and runs.has("temperature_c") and np.ptp(runs.context["temperature_c"]) > scales.set_point_k:
        for effect, set_point_c in _SET_POINTS_C.items():
            size, limit = effect.parameters
            centre = given(effect.id, size.name, 0.0)
            wide = scales.climate_of_power * mean
            found.append(Entry(f"{effect.id}.{size.name}", size.unit, centre, wide, size.low, size.high))
            centre = given(effect.id, limit.name, set_point_c)
            found.append(
                Entry(f"{effect.id}.{limit.name}", limit.unit, centre, scales.set_point_k, limit.low, limit.high)
            )
    return found


def robot_of(robot: Robot, numbers: Mapping[str, float]) -> Robot:
    """A robot with these numbers, by the names of entries."""
    if LOSSES in numbers:
        before = robot.motor_loss + robot.friction_loss
        motor = robot.motor_loss / before if before else 1.0
        lost = numbers[LOSSES]
        robot = dataclasses.replace(robot, motor_loss=motor * lost, friction_loss=(1.0 - motor) * lost)
    gamma = robot.traction_efficiency if LOSSES in numbers else thrust_n_per_a(robot)
    mass_kg = gamma * numbers["mass"]
    accelerated_kg = gamma * numbers[INERTIA]
    factor = inertia.EFFECT.switch
    effects: dict[str, dict[str, float]] = {
        inertia.EFFECT.id: {factor.name: min(accelerated_kg / mass_kg, factor.high)}
    }
    for name, value in numbers.items():
        effect, _, number = name.partition(".")
        if number and name != INERTIA:
            own = effects.setdefault(effect, dict(robot.effects.get(effect, {})))
            own[number] = value
    robot = dataclasses.replace(
        with_effects_of(robot, effects),
        mass_kg=mass_kg,
        rolling_resistance=float(np.clip(gamma * numbers["rolling"] / mass_kg, 1e-9, 1.0)),
        drag_ns2_per_m2=gamma * numbers["drag"],
    )
    if "rest_current" in numbers:
        robot = dataclasses.replace(robot, rest_current_a=numbers["rest_current"])
    if "idle_power" in numbers:
        sample_j = robot.sensing_j_per_sample + robot.computer_j_per_sample
        robot = with_ancillary(robot, numbers["idle_power"], numbers.get("sample_energy", sample_j))
    return robot


@dataclass(frozen=True)
class Predictive:
    """The fit, linearised so that it can be repeated on a part of the windows."""

    robot: Robot  # that the numbers are written into
    entries: tuple[Entry, ...]
    values: Array  # (entries,)
    predicted: Array  # (windows,)
    jacobian: Array  # (windows, entries), per unit of z
    total: float  # S0
    penalty: float  # lambda

    @property
    def numbers(self) -> dict[str, float]:
        """The fitted numbers, by name."""
        return dict(zip((entry.name for entry in self.entries), self.values.tolist(), strict=True))

    @property
    def changed(self) -> Robot:
        """The robot with the fitted numbers."""
        return robot_of(self.robot, self.numbers)

    def covariance(self, runs: Runs, block: Index) -> Array:
        """Of the numbers in their units, by the windows and the prior, shape (entries, entries).

        By the sandwich estimator, the windows clustered by `block`, (windows,), and the prior as one more observation
        of each number.
        """
        scale = np.array([entry.scale for entry in self.entries])
        residual = runs.observed - self.predicted
        sums = _sums(self.jacobian, residual, runs.duration_s)
        weight = sums.minutes / sums.squared
        scores = weight * per_block(self.jacobian * (residual * runs.duration_s)[:, None], block)
        prior = self.penalty * np.eye(len(scale))
        bread = np.linalg.inv(weight * sums.gram + prior)
        return np.asarray(bread @ (scores.T @ scores + prior) @ bread * np.outer(scale, scale))

    def fitted_to(self, chosen: Mask, runs: Runs) -> Predictive:
        """The same fitted to the chosen windows only, linearised at this fit."""
        duration_s = np.where(chosen, runs.duration_s, 0.0)
        residual = runs.observed - self.predicted
        total = self.total * float(duration_s.sum() / runs.duration_s.sum())
        sums = _sums(self.jacobian, residual, duration_s)
        return dataclasses.replace(self, values=_moved(self, sums, total, self.penalty))


@dataclass(frozen=True)
class _Sums:
    """A linear problem summed over windows: J' d J, J' d r, r' d r, and the minutes."""

    gram: Array
    moment: Array
    squared: float
    minutes: float

    def without(self, part: _Sums) -> _Sums:
        return _Sums(
            self.gram - part.gram, self.moment - part.moment, self.squared - part.squared, self.minutes - part.minutes
        )

    def error(self, step: Array) -> float:
        """Squared error of these windows after a step of z."""
        return float(self.squared - 2.0 * step @ self.moment + step @ self.gram @ step)


def _sums(jacobian: Array, residual: Array, duration_s: Array) -> _Sums:
    weighted = jacobian * duration_s[:, None]
    return _Sums(
        weighted.T @ jacobian, weighted.T @ residual, float(duration_s @ residual**2), float(duration_s.sum() / 60.0)
    )


def _minutes(runs: Runs) -> float:
    return float(runs.duration_s.sum() / 60.0)


def _step(fit: Predictive, sums: _Sums, total: float, penalty: float) -> Array:
    """Step of z that minimises the linearised sum within bounds, shape (entries,)."""
    centre, scale, low, high = (
        np.array([getattr(entry, name) for entry in fit.entries]) for name in ("centre", "scale", "low", "high")
    )
    about = (fit.values - centre) / scale
    weight = penalty / sums.minutes
    gram = sums.gram / total + weight * np.eye(len(scale))
    moment = sums.moment / total - weight * about
    return bounded(gram, moment, (low - fit.values) / scale - 1e-12, (high - fit.values) / scale + 1e-12)


def _moved(fit: Predictive, sums: _Sums, total: float, penalty: float, share: float = 1.0) -> Array:
    """Values after a share of the step, within their bounds."""
    moved = [
        float(np.clip(value + share * step * entry.scale, entry.low, entry.high))
        for value, step, entry in zip(fit.values, _step(fit, sums, total, penalty), fit.entries, strict=True)
    ]
    return np.array(moved)


def fit_predictive(
    runs: Runs, robot: Robot, named: Robot, replay: Replay, fold: Index, scales: Scales = SCALES
) -> Predictive:
    """Fit a robot file that predicts.

    Args:
        runs: The runs.
        robot: The robot as its file has it.
        named: The same with named effects.
        replay: Prediction for the runs by a robot.
        fold: Windows held out together to choose lambda have one number, shape (windows,).
        scales: Standard deviations of the priors.
    """
    numbers = entries(runs, robot, named, scales)
    start = np.array([float(np.clip(entry.centre, entry.low, entry.high)) for entry in numbers])
    empty = np.zeros((len(runs.observed), len(numbers)))
    fit = Predictive(named, numbers, start, np.zeros(len(empty)), empty, 1.0, _HARDLY)
    fit = dataclasses.replace(fit, predicted=_replayed(fit, start, replay))
    fit = dataclasses.replace(fit, total=_squared(fit, runs))
    fit = _descended(fit, runs, replay)
    fit = dataclasses.replace(fit, total=_squared(fit, runs), penalty=_OF_FEW)
    if len(runs.signals) >= _FEW_RUNS:
        fit = dataclasses.replace(fit, penalty=_best_penalty(fit, runs, fold))
    return _descended(fit, runs, replay)


def _best_penalty(fit: Predictive, runs: Runs, fold: Index) -> float:
    """The lambda whose linearised fits predict windows best that are held out."""
    residual = runs.observed - fit.predicted
    of_fold = [
        _sums(fit.jacobian, residual, np.where(fold == number, runs.duration_s, 0.0)) for number in np.unique(fold)
    ]
    everything = _sums(fit.jacobian, residual, runs.duration_s)

    def held_out_error(penalty: float) -> float:
        left = [everything.without(part) for part in of_fold]
        steps = [_step(fit, sums, sums.squared, penalty) for sums in left]
        return float(sum(part.error(step) for part, step in zip(of_fold, steps, strict=True)))

    return float(min(_PENALTIES.tolist(), key=held_out_error))


def _descended(fit: Predictive, runs: Runs, replay: Replay) -> Predictive:
    """The fit after Gauss-Newton steps through the replay, until the sum no longer falls."""
    least = _objective(fit, runs)
    for _ in range(_STEPS):
        fit = dataclasses.replace(fit, jacobian=_derivatives(fit, replay))
        sums = _sums(fit.jacobian, runs.observed - fit.predicted, runs.duration_s)
        share, before = 1.0, least
        for _ in range(_HALVINGS):
            values = _moved(fit, sums, fit.total, fit.penalty, share)
            tried = dataclasses.replace(fit, values=values, predicted=_replayed(fit, values, replay))
            error = _objective(tried, runs)
            if error < least:
                fit, least = tried, error
                break
            share /= 2.0
        if before - least <= _PRECISE * before:
            break
    return dataclasses.replace(fit, jacobian=_derivatives(fit, replay))


def _squared(fit: Predictive, runs: Runs) -> float:
    return float(runs.duration_s @ (runs.observed - fit.predicted) ** 2)


def _objective(fit: Predictive, runs: Runs) -> float:
    away = [(value - entry.centre) / entry.scale for value, entry in zip(fit.values, fit.entries, strict=True)]
    return _squared(fit, runs) / fit.total + fit.penalty / _minutes(runs) * float(np.sum(np.square(away)))


def _replayed(fit: Predictive, values: Array, replay: Replay) -> Array:
    return replay(dataclasses.replace(fit, values=values).changed)


def _derivatives(fit: Predictive, replay: Replay) -> Array:
    """Derivative of the prediction per unit of z by finite differences, shape (windows, entries)."""
    columns = []
    for index, entry in enumerate(fit.entries):
        step = _SMALL * entry.scale
        if fit.values[index] + step > entry.high:
            step = -step
        moved = fit.values.copy()
        moved[index] += step
        columns.append((_replayed(fit, moved, replay) - fit.predicted) * (entry.scale / step))
    return np.column_stack(columns)
