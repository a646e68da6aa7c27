"""A robot file made to predict: all numbers that a file may hold, fitted together and held near
what is known of them.

    x_j = c_j + s_j z_j within bounds;   min over z of  sum_i d_i (P_i - replay_i(x))^2 / S0 + lambda |z|^2 / n

d_i is the length of a window, n the minutes recorded, S0 the same sum at a first fit: a minute
counts as one independent observation of power. c_j and s_j are the mean and standard deviation of
what is known of a number before any drive; lambda is what predicts drives best that a fit has not
seen. Nothing is named here and nothing is proven: a number that the drives do not show stays where
it was.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.bounded import bounded
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
    Effect,
    Parameter,
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

MOST_LOST = 0.6
"""Losses of the drive, a share: the largest that is tried. Chosen: a small brushed motor with a
worm gear."""
_MOST_STEPS = 15  # of Gauss-Newton; chosen
_MOST_HALVINGS = 6  # of a step that overshoots; chosen
_PRECISE = 1e-7  # of the sum that is minimised, relative: a fit ends; chosen
_SMALL_STEP = 1e-4  # of a scale, for a derivative by a finite difference; chosen
_PENALTY_OF_FIRST_FIT = 1e-3
"""Lambda of the first fit, whose error is what drives leave unexplained: hardly any prior.
Chosen."""
_SMALLEST_SHARE = 1e-6
"""Least relative standard deviation of a measured number. Chosen: above rounding."""
_PENALTIES = np.logspace(-1.0, 1.0, 7)
"""Lambdas that are tried, about 1: prior and minutes then count as stated. Chosen: half a decade
apart or less."""
_FEWEST_RUNS = 8
"""Drives below which their errors are too few to choose lambda by. Chosen."""
_PENALTY_OF_FEW = 0.3
"""Lambda then. Chosen: the middle of 0.1 and 1."""


@dataclass(frozen=True)
class Scales:
    """Standard deviations of the priors; `times` of the file's value, `of_power` of the mean power
    or current."""

    idle_of_power: float = 0.05
    """Electronics are the best known number of a file, as they are measured on a bench. Chosen."""
    rolling_times: float = 1.0
    """A coefficient is 0.01 on asphalt and 0.3 in sand (Wong, Theory of Ground Vehicles, ch. 1)."""
    drag_times: float = 1.0
    """A drag area is rarely known: it is guessed from a shape."""
    mass_times: float = 0.3
    """A load or a rider beside the weighed robot. Chosen: up to half of it."""
    losses: float = MOST_LOST / 12.0**0.5
    """Anything between none and the most, as a uniform distribution."""
    inertia_times: float = 0.5
    """Of the moved mass: rotating parts add 0.04 + 0.0025 N^2, N the gear ratio (Gillespie,
    Fundamentals of Vehicle Dynamics, ch. 2), half of it at N = 14."""
    regeneration: float = 0.5
    """A share between none, which is expected where no drive shows it, and all."""
    turning: float = 0.3
    """Scrub over weight: rubber on hard ground rubs with 0.3 to 0.8, and a part of it is dragged
    sideways. Chosen."""
    climate_of_power: float = 0.02
    """Per kelvin of a heater or cooler: electric cars go 41 % less far at -7 C than at 24 C (AAA,
    2019), which is 70 % more energy over 31 K."""
    rolling_per_k: float = 0.0026
    """From passenger cars (0.0086, UN GTR 15, Annex 4) to the tyres of lorries (0.006, ISO
    28580)."""
    set_point_k: float = 3.0
    """Degree days count heating below 15 C to a base of 18 C, and cooling above 24 C to a base of
    21 C (Eurostat)."""


SCALES = Scales()
_MASS_FACTOR = 1.0  # of inertia over mass: Newton's second law without rotating parts
_ROLLING_PER_K = 0.0086  # UN GTR 15, Annex 4
_SET_POINTS_C = {heater.EFFECT: 18.0, cooler.EFFECT: 24.0}  # of degree days, as above


@dataclass(frozen=True)
class Entry:
    """One number of a robot file: its name in `[uncertainty]`, unit, prior and bounds.

    Forces are over the efficiency of the drive, as recordings show them: C_rr m / Gamma, c / Gamma,
    m / Gamma. Inertia is the accelerated mass over Gamma, kg: only the product of mass and
    `mass_factor` is known.
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
    mean = float(np.average(np.abs(runs.observed), weights=runs.duration_s))
    numbers = _groups(runs, robot, mean, scales)
    numbers += _inertia_and_losses(runs, robot, scales)
    numbers += _effects_of_the_way(runs, robot, scales)
    numbers += _climate(runs, robot, mean, scales)
    numbers += _viscous(robot)
    names = {entry.name for entry in numbers}
    numbers += [entry for entry in _named_effects(robot, named) if entry.name not in names]
    return tuple(numbers)


def _groups(runs: Runs, robot: Robot, mean: float, scales: Scales) -> list[Entry]:
    """The identifiable groups; `mean` is the mean power, W, or motor current, A."""
    problem = parameters(runs, robot)
    deviations = {
        "idle_power": scales.idle_of_power * mean,
        "rest_current": mean,  # hardly any file states it
        "rolling": scales.rolling_times * problem.scale[ROLLING],
        "drag": scales.drag_times * problem.scale[DRAG],
        "mass": scales.mass_times * problem.scale[MASS],
    }
    values = {group.name: float(problem.start[index]) for index, group in enumerate(problem.groups)}
    for name, measured in _measured(runs, robot, scales, values).items():
        deviations[name] = min(deviations.get(name, measured), measured)
    numbers = []
    for index, group in enumerate(problem.groups):
        if group.name == "sample_energy" and not np.ptp(runs.sensing_hz):
            continue  # at one sensing rate it is a part of the idle power
        to_group = float(problem.to_group[index])
        numbers.append(
            Entry(
                name=group.name,
                unit=group.unit,
                centre=to_group * float(problem.start[index]),
                scale=to_group * deviations.get(group.name, float(problem.scale[index])),
                low=to_group * float(problem.low[index]),
                high=to_group * float(problem.high[index]),
            )
        )
    return numbers


def _measured(
    runs: Runs, robot: Robot, scales: Scales, values: Mapping[str, float]
) -> dict[str, float]:
    """Standard deviations of what a coast-down test and a scale measured at the wheels, by name of
    the group.

    Recordings of power show the same over the drive's efficiency, which the test does not know: the
    drive's losses are as uncertain as without it. Recordings of motor current show it over the
    thrust per ampere of the file.
    """
    if runs.unit == "A" and robot.traction_n_per_a == 0.0:
        return {}
    share_of_losses = scales.losses / robot.traction_efficiency if runs.unit == "W" else 0.0
    measured = {}
    for name, value in values.items():
        share = _measured_share(robot, name)
        if share is not None:
            measured[name] = value * float(np.hypot(share, share_of_losses))
    return measured


def _measured_share(robot: Robot, name: str) -> float | None:
    """Relative standard deviation of a force or mass that was measured; None if it was not."""
    if robot.uncertainty is None or robot.uncertainty.of != "force":
        return None
    variance = robot.uncertainty.variance(name)
    if variance is None:
        return None
    return max(float(np.sqrt(variance)), _SMALLEST_SHARE)


def _in_file(robot: Robot, effect: Effect, parameter: Parameter, otherwise: float) -> float:
    """Value of an effect's parameter in the robot's file, or another where the file does not have
    it."""
    return robot.effects.get(effect.id, {}).get(parameter.name, otherwise)


def _entry(effect: Effect, parameter: Parameter, centre: float, scale: float) -> Entry:
    """The entry of an effect's parameter, within its bounds."""
    name = f"{effect.id}.{parameter.name}"
    return Entry(name, parameter.unit, centre, scale, low=parameter.low, high=parameter.high)


def _inertia_and_losses(runs: Runs, robot: Robot, scales: Scales) -> list[Entry]:
    """Inertia and, of power, the share that the drive loses and the share that braking gives
    back."""
    to_group = float(parameters(runs, robot).to_group[MASS])
    mass_kg = to_group * robot.mass_kg
    factor = inertia.EFFECT.switch
    numbers = [
        Entry(
            name=INERTIA,
            unit="kg",
            centre=mass_kg * _in_file(robot, inertia.EFFECT, factor, _MASS_FACTOR),
            scale=scales.inertia_times * mass_kg,
            low=0.0,
            high=factor.high * thresholds.MOST_TIMES * mass_kg,
        )
    ]
    if runs.unit == "W":
        share = regeneration.EFFECT.switch
        recovered = _in_file(robot, regeneration.EFFECT, share, 0.0)
        numbers.append(_entry(regeneration.EFFECT, share, recovered, scales.regeneration))
        losses = robot.motor_loss + robot.friction_loss
        numbers.append(
            Entry(LOSSES, "1", losses, scales.losses, low=0.0, high=max(MOST_LOST, losses))
        )
    return numbers


def _effects_of_the_way(runs: Runs, robot: Robot, scales: Scales) -> list[Entry]:
    """Turning and the temperature of the tyres, which most robots have, whether or not a drive
    proves them."""
    numbers = []
    if runs.has("yaw_rate_radps") and robot.track_m > 0.0:
        scrub = turning.EFFECT.switch
        centre = _in_file(robot, turning.EFFECT, scrub, 0.0)
        numbers.append(Entry(TURNING, scrub.unit, centre, scales.turning, low=0.0, high=scrub.high))
    if runs.has("temperature_c"):
        per_k = air_temperature.EFFECT.switch
        centre = _in_file(robot, air_temperature.EFFECT, per_k, _ROLLING_PER_K)
        numbers.append(_entry(air_temperature.EFFECT, per_k, centre, scales.rolling_per_k))
    return numbers


def _climate(runs: Runs, robot: Robot, mean_w: float, scales: Scales) -> list[Entry]:
    """A heater and a cooler: power per kelvin and set point of each."""
    if runs.unit == "A" or not runs.has("temperature_c"):
        return []
    # In one temperature a heater, a cooler and idle power are the same.
    if np.ptp(runs.context["temperature_c"]) <= scales.set_point_k:
        return []
    numbers = []
    for effect, set_point_c in _SET_POINTS_C.items():
        per_k, limit = effect.parameters
        centre_w = _in_file(robot, effect, per_k, 0.0)
        numbers.append(_entry(effect, per_k, centre_w, scales.climate_of_power * mean_w))
        centre_c = _in_file(robot, effect, limit, set_point_c)
        numbers.append(_entry(effect, limit, centre_c, scales.set_point_k))
    return numbers


def _viscous(robot: Robot) -> list[Entry]:
    """Friction that grows with speed, where a coast-down test measured it."""
    effect = viscous.EFFECT
    size = _in_file(robot, effect, effect.switch, 0.0)
    share = _measured_share(robot, f"{effect.id}.{effect.switch.name}")
    if share is None or size == 0.0:
        return []
    return [_entry(effect, effect.switch, centre=size, scale=share * size)]


def _named_effects(robot: Robot, named: Robot) -> list[Entry]:
    """Sizes of the effects that were named; they may be as large as found."""
    numbers = []
    for effect, values in named.effects.items():
        switch = _SWITCHES[effect]
        size = values.get(switch.name, 0.0)
        if size != 0.0 and values != robot.effects.get(effect):
            name = f"{effect}.{switch.name}"
            numbers.append(
                Entry(
                    name,
                    switch.unit,
                    centre=size,
                    scale=abs(size),
                    low=switch.low,
                    high=switch.high,
                )
            )
    return numbers


def robot_of(robot: Robot, numbers: Mapping[str, float]) -> Robot:
    """A robot with these numbers, by the names of entries."""
    if LOSSES in numbers:
        robot = _with_losses(robot, numbers[LOSSES])
        divisor = robot.traction_efficiency
    else:
        divisor = thrust_n_per_a(robot)
    mass_kg = divisor * numbers["mass"]
    accelerated_kg = divisor * numbers[INERTIA]
    factor = inertia.EFFECT.switch
    effects: dict[str, dict[str, float]] = {
        inertia.EFFECT.id: {factor.name: min(accelerated_kg / mass_kg, factor.high)}
    }
    for name, value in numbers.items():
        effect, _, parameter = name.partition(".")
        if parameter and name != INERTIA:
            values = effects.setdefault(effect, dict(robot.effects.get(effect, {})))
            values[parameter] = value
    robot = dataclasses.replace(
        with_effects_of(robot, effects),
        mass_kg=mass_kg,
        rolling_resistance=float(np.clip(divisor * numbers["rolling"] / mass_kg, 1e-9, 1.0)),
        drag_ns2_per_m2=divisor * numbers["drag"],
    )
    if "rest_current" in numbers:
        robot = dataclasses.replace(robot, rest_current_a=numbers["rest_current"])
    if "idle_power" in numbers:
        sample_j = robot.sensing_j_per_sample + robot.computer_j_per_sample
        robot = with_ancillary(robot, numbers["idle_power"], numbers.get("sample_energy", sample_j))
    return robot


def _with_losses(robot: Robot, losses: float) -> Robot:
    """The robot with another share of losses, divided between motor and friction as in its file."""
    file_losses = robot.motor_loss + robot.friction_loss
    share_of_motor = 1.0
    if file_losses != 0.0:
        share_of_motor = robot.motor_loss / file_losses
    return dataclasses.replace(
        robot, motor_loss=share_of_motor * losses, friction_loss=(1.0 - share_of_motor) * losses
    )


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
        names = [entry.name for entry in self.entries]
        return dict(zip(names, self.values.tolist(), strict=True))

    @property
    def changed(self) -> Robot:
        """The robot with the fitted numbers."""
        return robot_of(self.robot, self.numbers)

    def covariance(self, runs: Runs, block: Index) -> Array:
        """Of the numbers in their units, by the windows and the prior, shape (entries, entries).

        By the sandwich estimator, the windows clustered by `block`, (windows,), and the prior as
        one more observation of each number.
        """
        scale = np.array([entry.scale for entry in self.entries])
        residual = runs.observed - self.predicted
        sums = _sums(self.jacobian, residual, runs.duration_s)
        weight = sums.minutes / sums.squared
        weighted_residual = residual * runs.duration_s
        scores = weight * per_block(self.jacobian * weighted_residual[:, None], block)
        prior = self.penalty * np.eye(len(scale))
        bread = np.linalg.inv(weight * sums.gram + prior)
        meat = scores.T @ scores + prior
        return np.asarray(bread @ meat @ bread * np.outer(scale, scale))

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
        """The sums over the other windows."""
        return _Sums(
            gram=self.gram - part.gram,
            moment=self.moment - part.moment,
            squared=self.squared - part.squared,
            minutes=self.minutes - part.minutes,
        )

    def error(self, step: Array) -> float:
        """Squared error of these windows after a step of z."""
        linear = 2.0 * step @ self.moment
        quadratic = step @ self.gram @ step
        return float(self.squared - linear + quadratic)


def _sums(jacobian: Array, residual: Array, duration_s: Array) -> _Sums:
    weighted = jacobian * duration_s[:, None]
    return _Sums(
        gram=weighted.T @ jacobian,
        moment=weighted.T @ residual,
        squared=float(duration_s @ residual**2),
        minutes=_minutes(duration_s),
    )


def _minutes(duration_s: Array) -> float:
    return float(duration_s.sum() / 60.0)


def _step(fit: Predictive, sums: _Sums, total: float, penalty: float) -> Array:
    """Step of z that minimises the linearised sum within bounds, shape (entries,)."""
    centre = np.array([entry.centre for entry in fit.entries])
    scale = np.array([entry.scale for entry in fit.entries])
    low = np.array([entry.low for entry in fit.entries])
    high = np.array([entry.high for entry in fit.entries])
    z = (fit.values - centre) / scale
    prior_weight = penalty / sums.minutes
    return bounded(
        gram=sums.gram / total + prior_weight * np.eye(len(scale)),
        moment=sums.moment / total - prior_weight * z,
        low=(low - fit.values) / scale - 1e-12,
        high=(high - fit.values) / scale + 1e-12,
    )


def _moved(fit: Predictive, sums: _Sums, total: float, penalty: float, share: float = 1.0) -> Array:
    """Values after a share of the step, within their bounds, shape (entries,)."""
    steps = _step(fit, sums, total, penalty)
    moved = []
    for value, step, entry in zip(fit.values, steps, fit.entries, strict=True):
        moved.append(float(np.clip(value + share * step * entry.scale, entry.low, entry.high)))
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
    windows = len(runs.observed)
    fit = Predictive(
        robot=named,
        entries=numbers,
        values=start,
        predicted=np.zeros(windows),  # replayed below
        jacobian=np.zeros((windows, len(numbers))),
        total=1.0,
        penalty=_PENALTY_OF_FIRST_FIT,
    )
    fit = dataclasses.replace(fit, predicted=_replayed(fit, start, replay))
    fit = dataclasses.replace(fit, total=_squared(fit, runs))
    fit = _descended(fit, runs, replay)
    fit = dataclasses.replace(fit, total=_squared(fit, runs), penalty=_PENALTY_OF_FEW)
    if len(runs.signals) >= _FEWEST_RUNS:
        fit = dataclasses.replace(fit, penalty=_best_penalty(fit, runs, fold))
    return _descended(fit, runs, replay)


def _best_penalty(fit: Predictive, runs: Runs, fold: Index) -> float:
    """The lambda whose linearised fits predict windows best that are held out."""
    residual = runs.observed - fit.predicted
    tests = []
    for number in np.unique(fold):
        duration_s = np.where(fold == number, runs.duration_s, 0.0)
        tests.append(_sums(fit.jacobian, residual, duration_s))
    sums_of_all = _sums(fit.jacobian, residual, runs.duration_s)

    def held_out_error(penalty: float) -> float:
        error = 0.0
        for test in tests:
            training = sums_of_all.without(test)
            error += test.error(_step(fit, training, training.squared, penalty))
        return error

    return float(min(_PENALTIES.tolist(), key=held_out_error))


def _descended(fit: Predictive, runs: Runs, replay: Replay) -> Predictive:
    """The fit after Gauss-Newton steps through the replay, until the sum no longer falls."""
    error = _objective(fit, runs)
    for _ in range(_MOST_STEPS):
        fit = dataclasses.replace(fit, jacobian=_derivatives(fit, replay))
        stepped = _stepped(fit, runs, replay)
        error_before = error
        error = _objective(stepped, runs)
        fit = stepped
        if error_before - error <= _PRECISE * error_before:
            break
    return dataclasses.replace(fit, jacobian=_derivatives(fit, replay))


def _stepped(fit: Predictive, runs: Runs, replay: Replay) -> Predictive:
    """The fit after a step, halved until it lowers the sum; the same fit where none does."""
    error = _objective(fit, runs)
    sums = _sums(fit.jacobian, runs.observed - fit.predicted, runs.duration_s)
    share = 1.0
    for _ in range(_MOST_HALVINGS):
        values = _moved(fit, sums, fit.total, fit.penalty, share)
        stepped = dataclasses.replace(fit, values=values, predicted=_replayed(fit, values, replay))
        if _objective(stepped, runs) < error:
            return stepped
        share /= 2.0
    return fit


def _squared(fit: Predictive, runs: Runs) -> float:
    return float(runs.duration_s @ (runs.observed - fit.predicted) ** 2)


def _objective(fit: Predictive, runs: Runs) -> float:
    """The sum that is minimised: squared error over S0 and the penalty of z."""
    z = [
        (value - entry.centre) / entry.scale
        for value, entry in zip(fit.values, fit.entries, strict=True)
    ]
    penalty = fit.penalty / _minutes(runs.duration_s) * float(np.sum(np.square(z)))
    return _squared(fit, runs) / fit.total + penalty


def _replayed(fit: Predictive, values: Array, replay: Replay) -> Array:
    """Prediction by the fit with other values, shape (windows,)."""
    return replay(dataclasses.replace(fit, values=values).changed)


def _derivatives(fit: Predictive, replay: Replay) -> Array:
    """Derivative of the prediction per unit of z by finite differences, shape (windows,
    entries)."""
    columns = []
    for index, entry in enumerate(fit.entries):
        step = _SMALL_STEP * entry.scale
        # At a bound backwards: beyond it the number means nothing.
        if fit.values[index] + step > entry.high:
            step = -step
        moved = fit.values.copy()
        moved[index] += step
        columns.append((_replayed(fit, moved, replay) - fit.predicted) * (entry.scale / step))
    return np.column_stack(columns)
