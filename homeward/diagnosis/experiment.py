"""The next experiment: the drive of the menu after which the candidates would be told apart best.

The information of the recordings at hand is a matrix for the groups of the refit and the size of each candidate; each
drive of the menu would add its own, from what the kernel says that the candidates would add there. The groups are a
nuisance, so the determinant of what is left for the candidates counts (D_s-optimality: Atkinson & Donev, Optimum
Experimental Designs, 1992). Before anything is recorded a candidate is known to within its fitted size, a group to
within a plausible change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from homeward.diagnosis.blocks import noise_of
from homeward.diagnosis.hypotheses import CATALOGUE, Term
from homeward.diagnosis.location import Location
from homeward.diagnosis.menu import KNOWN_MASS, MENU, Course, Manoeuvre
from homeward.diagnosis.parameters import DRAG, MASS, ROLLING, WithEffects
from homeward.diagnosis.refit import Estimate, Refit
from homeward.diagnosis.regression import bounded
from homeward.diagnosis.replay import Runs
from homeward.diagnosis.signals import Array, Unit

_SEPARATES = np.log(2.0)  # of the determinant: the variance of what is least known is halved
_MEASURES = 0.1
_SMALL_STEP = 1e-4

MEASUREMENTS: Mapping[str, str] = {
    "sensor_offset": "read a clamp meter on the battery lead with the robot switched off: the log must show the same",
    "sensor_gain": "read a clamp meter on the battery lead, standing and at top speed, beside the log",
    "clock_lag": "start sharply a few times and compare when wheels and power move in the logs with one clock for both",
    "odometry_scale": "drive along a tape measure and compare the distance with the log",
    "payload": "weigh the robot as it drove",
    "ageing": "discharge a full battery through a known load and compare its energy with the rated one",
    "rate_capacity": "discharge a full battery once slowly and once fast through known loads",
    "internal_resistance": "read the battery voltage at rest and under a known load",
    "surface": "tow the robot over the ground with a spring balance, its drive disengaged",
    "hidden_grade": "survey the slope of the route with a level",
    "wind": "measure the wind with an anemometer, or repeat the drive on a calm day",
    "slip": "compare wheel revolutions with the distance along a tape measure on a slope",
    "turning": "tow the robot sideways with a spring balance",
    "standby": "unplug one device after the other with a clamp meter on the battery lead",
    "intermittent_load": "log a clamp meter on each device for the length of a drive",
    "heater": "put a clamp meter on the lead of the heater",
    "compute": "put a clamp meter on the lead of the computer",
    "radio": "put a clamp meter on the lead of the radio",
    "no_load": "lift the wheels off the ground and log the power at several speeds",
    "viscous": "lift the wheels off the ground and log the power at several speeds",
    "copper_loss": "measure the resistance of the motor windings",
    "motor_heating": "put a thermometer on a motor for the length of a drive",
    "cold_battery": "discharge the battery once cold and once warm through a known load",
    "inertia": "let the robot coast to a stop on level ground and log its speed",
    "breakaway": "pull the robot with a spring balance until it starts to roll",
    "regeneration": "put a clamp meter on the battery lead while braking",
}
"""What a drive cannot show but a measurement does, by effect."""


@dataclass(frozen=True)
class Candidate:
    """An effect at the size that the recordings give it; `column` is what it adds there, shape (windows,)."""

    effect: str
    size: float
    shape: Mapping[str, float]
    column: Array


def candidate(fit: Refit, runs: Runs, term: Term) -> Candidate:
    """A hypothesis at its fitted size; of several sizes (levels, places) the one that adds most."""
    columns = np.column_stack([fit.jacobian, term.columns])
    low, high = fit.freedom()
    weights = bounded(
        columns.T @ columns,
        columns.T @ (runs.observed - fit.predicted),
        np.concatenate([low, term.low]),
        np.concatenate([high, term.high]),
    )[fit.jacobian.shape[1] :]
    largest = int(np.argmax(np.abs(weights) * np.linalg.norm(term.columns, axis=0)))
    blows = term.effect == "wind" and term.axis == "steady"  # its sizes are the components of one wind
    size = float(np.hypot(*weights)) if blows else float(weights[largest])
    return Candidate(term.effect, size, term.shape, term.columns @ weights)


def gains(
    fit: Refit, runs: Runs, left: Array, candidates: Sequence[Candidate], groups: Sequence[str] = ()
) -> dict[str, float]:
    """Rise of the log-determinant of the information by each drive of the menu.

    Args:
        fit: The refit.
        runs: The recordings at hand.
        left: What the best model leaves, shape (windows,).
        candidates: Effects to tell apart.
        groups: Names of groups to determine; the others are a nuisance.
    """
    names = [group.name for group in fit.parameters.groups]
    of_interest = np.array([name in groups for name in names] + [True] * len(candidates))
    noise_w = max(noise_of(left, runs.run).long_run, 1e-6 * float(np.abs(runs.observed).max()))
    known = np.column_stack([fit.jacobian, *(one.column for one in candidates)]) / noise_w
    before = known.T @ known + np.eye(known.shape[1])
    windows_a_second = 1.0 / float(np.median(runs.duration_s))
    found = {}
    for manoeuvre in MENU:
        added = responses(fit, runs, manoeuvre, candidates) / noise_w
        if candidates and not added[:, len(names) :].any():
            found[manoeuvre.id] = (
                0.0  # a drive without the effect may settle the groups, but nobody would call it a test
            )
            continue
        after = before + windows_a_second * added.T @ added
        found[manoeuvre.id] = _determinant(after, of_interest) - _determinant(before, of_interest)
    return found


def _determinant(information: Array, of_interest: NDArray[np.bool_]) -> float:
    """Log-determinant of the information about some of the parameters when the others are unknown."""
    whole = np.linalg.slogdet(information)[1]
    return float(whole - np.linalg.slogdet(information[np.ix_(~of_interest, ~of_interest)])[1])


def responses(fit: Refit, runs: Runs, manoeuvre: Manoeuvre, candidates: Sequence[Candidate]) -> Array:
    """What the groups (per unit of `scale`) and the candidates add on a drive, shape (samples, groups + candidates).

    Args:
        fit: The refit.
        runs: The recordings at hand.
        manoeuvre: The drive.
        candidates: Effects to tell apart.
    """
    usual_c = float(np.mean(np.concatenate([run.temperature_c for run in runs.signals])))
    return _Drive(fit, manoeuvre.course(fit.parameters.nominal), runs.unit, usual_c).responses(candidates)


class _Drive:
    """One drive of the menu, simulated with the refitted robot."""

    def __init__(self, fit: Refit, course: Course, unit: Unit, usual_c: float) -> None:
        self.fit, self.course = fit, course
        self.runs = course.runs(unit, usual_c)
        self.plain = self.predict(fit.theta)

    def responses(self, candidates: Sequence[Candidate]) -> Array:
        problem, theta = self.fit.parameters, self.fit.theta
        columns = []
        for index in problem.active():
            step = _SMALL_STEP * problem.scale[index]
            step = -step if theta[index] + step > problem.high[index] else step
            moved = theta.copy()
            moved[index] += step
            columns.append((self.predict(moved) - self.plain) / (step / problem.scale[index]))
        return np.column_stack([*columns, *(self.added(one) for one in candidates)])

    def predict(self, theta: Array, extra: WithEffects | None = None) -> Array:
        """What would be recorded; nothing is drawn where everything is off."""
        predict = self.fit.parameters.predict
        power = predict(self.runs, theta, extra)
        if self.course.known_mass.any():
            loaded, on_top_kg = theta.copy(), KNOWN_MASS * self.fit.parameters.nominal.mass_kg
            loaded[ROLLING] *= 1.0 + on_top_kg / theta[MASS]
            loaded[MASS] += on_top_kg
            power = np.where(self.course.known_mass > 0.0, predict(self.runs, loaded, extra), power)
        return power * self.course.switched_on

    def added(self, one: Candidate) -> Array:
        """What a candidate adds to what would be recorded, shape (samples,)."""
        theta, size = self.fit.theta, one.size
        if one.effect == "sensor_offset":
            return np.full(len(self.plain), size)  # also when everything is off
        if one.effect in ("sensor_gain", "ageing"):
            return size * np.maximum(self.plain, 0.0)
        if one.effect == "clock_lag":
            return self.predict(theta, WithEffects(lag_s=size)) - self.plain
        if one.effect == "odometry_scale":
            return self.predict(theta, WithEffects(speed_factors=[1.0 / (1.0 + size)])) - self.plain
        there = self.course.exposure.get(one.effect, 1.0)
        if one.effect == "surface":
            rougher = theta.copy()
            rougher[ROLLING] *= 1.0 + max(size, -0.9)
            return there * (self.predict(rougher) - self.plain)
        if one.effect == "wind":
            exposed = theta.copy()
            exposed[DRAG] = max(exposed[DRAG], self.fit.parameters.start[DRAG])  # a refit without wind may take it away
            headwind = [size * np.cos(self.course.heading_rad)]
            return self.predict(exposed, WithEffects({"wind": {"exposure": 1.0}}, headwind)) - self.predict(exposed)
        # What brakes a robot on the level is its inertia: without it there is nothing to regenerate.
        base = {"inertia": {"mass_factor": 1.0}} if one.effect == "regeneration" else {}
        switch = CATALOGUE[one.effect].parameters[0].name
        with_it = self.predict(theta, WithEffects({**base, one.effect: {**one.shape, switch: size}}))
        return there * (with_it - (self.predict(theta, WithEffects(base)) if base else self.plain))


def to_tell_apart(fit: Refit, runs: Runs, left: Array, first: Term, rivals: Sequence[Term]) -> str:
    """The drive or, where no drive of the menu does, the measurement that separates an effect from its rivals.

    Without rivals: the drive that would determine its size best.

    Args:
        fit: The refit.
        runs: The recordings at hand.
        left: What the best model leaves, shape (windows,).
        first: The effect.
        rivals: What the recordings cannot separate from it.
    """
    candidates = [candidate(fit, runs, term) for term in (first, *rivals)]
    best, gain = _best(gains(fit, runs, left, [one for one in candidates if one.size != 0.0]))
    worthwhile = gain >= (_SEPARATES if rivals else _MEASURES)
    advice = best.sentence if worthwhile else MEASUREMENTS[_measured(first, rivals)]
    name = first.effect.replace("_", " ")
    if not rivals:
        return f"To measure {name} better, {advice}."
    others = " and ".join(rival.effect.replace("_", " ") for rival in rivals)
    return f"To tell {name} from {others}, {advice}."


def _measured(first: Term, rivals: Sequence[Term]) -> str:
    """Which of the effects to measure: a fault of the instrument before physics."""
    effects = [first.effect, *(rival.effect for rival in rivals)]
    return next((one for one in effects if one.startswith(("sensor_", "clock_", "odometry_"))), effects[0])


def _best(found: Mapping[str, float]) -> tuple[Manoeuvre, float]:
    best = max(MENU, key=lambda one: found[one.id])
    return best, found[best.id]


def next_experiment(
    fit: Refit,
    runs: Runs,
    left: Array,
    estimates: Sequence[Estimate],
    named: Sequence[tuple[Term, Sequence[Term]]],
    unexplained: Location | None,
    enough: bool,
) -> str | None:
    """The one thing to do next, or None where nothing is open.

    Args:
        fit: The refit.
        runs: The recordings at hand.
        left: What the best model leaves, shape (windows,).
        estimates: What the recordings say of each group.
        named: Each named effect with its rivals.
        unexplained: Where the mismatch sits, if nothing explains it.
        enough: Whether the recordings are long enough for a test.
    """
    for first, rivals in named:
        if rivals:
            return to_tell_apart(fit, runs, left, first, rivals)
    if unexplained is not None and not named:
        return repeat(unexplained)
    open_groups = [one.group for one in estimates if one.fitted is None]
    best, gain = _best(gains(fit, runs, left, [], [group.name for group in open_groups]))
    if open_groups and gain >= _MEASURES:
        longer = "" if enough else ", for five minutes or more"
        return f"To determine {', '.join(group.symbol for group in open_groups)}, {best.sentence}{longer}."
    return None if enough else "Record the same drive for longer, at least five minutes."


def repeat(location: Location) -> str:
    """The drive that shows whether a condition is behind what nothing explains."""
    if all(place.condition == location.condition for place in location.places):
        return (
            f"To find out what is missing, alternate a minute with {location.condition} and a minute without, "
            "ten times, and change nothing else."
        )
    first = max(location.places, key=lambda place: place.share_of_excess)
    return (
        f"To find out what is missing, repeat the drive of {first.recording.rsplit('/', 1)[-1]} and note what is "
        f"switched on, carried or different on the way ({first.condition})."
    )
