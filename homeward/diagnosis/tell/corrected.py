"""The corrected robot: identifiable groups and effects written back into a robot file."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from homeward.diagnosis.explain.channel_effects.shown import USABLE_ENERGY
from homeward.diagnosis.explain.hypothesis import Term
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.fit.parameter_groups import ROLLING, with_ancillary, with_effects_of
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs, WithEffects, predict, thrust_n_per_a
from homeward.diagnosis.read.signals import Unit
from homeward.diagnosis.result import FileNumber, limit_end
from homeward.diagnosis.tell.words import UNLIMITED
from homeward.layout.notation import unit_after
from homeward.logs.channels import Array, Mask
from homeward.physics import Robot
from homeward.physics.effects import surface


@dataclass(frozen=True)
class FileContent:
    """The part of a fit that a robot file contains, and what these drives or their instruments add
    to it."""

    theta: Array  # (groups,)
    effects: Mapping[str, Mapping[str, float]]
    met: WithEffects  # ground of these drives, lag and scale of their instruments
    reading: Array | float = 0.0  # what instruments add, (windows,)
    # windows before an effect began, (windows,)
    not_begun: Mapping[str, Mask] = field(default_factory=dict)
    # of the given file
    given_effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def is_expressible(term: Term) -> bool:
    """Whether a robot file can express an effect: of one size, begun at some moment to stay, or
    uneven ground."""
    if not term.hypothesis.physical or term.hypothesis.is_weather or term.flexible:
        return False
    return term.axis == "steady" or term.of_rolling_kg is not None or _stays(term)


def _stays(term: Term) -> bool:
    """Whether an effect begins once and is then at work to the end, as in the robot's present
    state."""
    schedule = term.schedule
    if schedule is None or term.axis != "time" or schedule.levels != 2:
        return False
    is_on_at_the_end = bool(schedule.level[-1] == 1)
    changes = int(np.count_nonzero(np.diff(schedule.level)))
    return is_on_at_the_end and changes == 1


def file_content(model: Refit | Corrected, runs: Runs) -> FileContent:
    """Separate what a robot file can express of a fit from what it cannot: times, places, and
    instruments."""
    if isinstance(model, Refit):
        return FileContent(model.theta, {}, WithEffects())
    theta = model.theta
    effects: dict[str, dict[str, float]] = {}
    met = replace(model.model.within(runs, theta, model.values), effects={})
    not_begun: dict[str, Mask] = {}
    given_effects = model.parameters.nominal.effects
    reading = np.zeros(len(runs.observed))
    for index, term in enumerate(model.model.terms):
        in_given_file = given_effects.get(term.effect, {})
        if term.of_rolling_kg is not None:
            ground = ground_of(model, index, runs)
            gain_entry, typical_entry = term.hypothesis.entry.parameters
            given_gain = in_given_file.get(gain_entry.name, 0.0)
            given_typical = in_given_file.get(typical_entry.name, 0.0)
            # It was fitted on top of the given file's typical roughness; a file holds that of the
            # smoothest ground.
            theta = theta.copy()
            theta[ROLLING] *= ground.smoothest * (1.0 + given_gain * given_typical)
            effects[term.effect] = {
                gain_entry.name: ground.gain,
                typical_entry.name: ground.typical,
            }
            met = replace(met, roughness=ground.roughness)
        elif is_expressible(term):
            effects[term.effect] = {
                **in_given_file,
                **_numbers(model, index),
                **term.hypothesis.reach(runs),
            }
            if _stays(term) and term.schedule is not None:
                not_begun[term.effect] = term.schedule.level == 0
        elif term.misread:
            reading += term.columns @ model.sizes(index)
    return FileContent(
        theta=theta,
        effects=effects,
        met=met,
        reading=reading,
        not_begun=not_begun,
        given_effects=given_effects,
    )


@dataclass(frozen=True)
class Ground:
    """Ground of unequal roughness, as a robot file has it."""

    smoothest: float  # C_rr of the smoothest ground over the fitted one
    gain: float  # by how much the roughest rolls harder, a share
    roughness: Array  # from 0 to 1, (windows,)
    typical: float  # mean roughness by distance


def ground_of(model: Corrected, index: int, runs: Runs) -> Ground:
    """The ground by an effect of a model, by its index.

    The ends of a smooth profile are quantiles: a hat function that covers few windows is poorly
    estimated. Ground that is smoother than the largest gain of a file can say counts as the
    smoothest that it can.
    """
    term = model.model.terms[index]
    largest_gain = term.hypothesis.entry.switch.high
    assert term.at_work is not None
    rise = term.at_work @ model.sizes(index) * model.share(index)
    # C_rr of each window over the fitted one, (windows,)
    over_fitted = 1.0 + np.maximum(rise, -1.0)
    driven = np.abs(runs.context["speed_mps"]) > 0.0
    ends = _ENDS
    if term.schedule is not None:
        ends = (0.0, 1.0)
    smoothest, roughest = np.quantile(over_fitted[driven], ends).tolist()
    smoothest = max(smoothest, roughest / (1.0 + largest_gain))
    if roughest <= smoothest:
        return Ground(smoothest, gain=0.0, roughness=np.zeros(len(over_fitted)), typical=0.0)
    gain = min(roughest / smoothest - 1.0, largest_gain)
    roughness = np.clip((over_fitted / smoothest - 1.0) / gain, 0.0, 1.0)
    driven_m = np.abs(runs.context["speed_mps"]) * runs.duration_s
    typical = float(np.average(roughness, weights=driven_m))
    return Ground(smoothest, gain, roughness, typical)


_ENDS = (0.05, 0.95)  # quantiles; chosen: a twentieth of what was driven is left out at each end


def _numbers(model: Corrected, index: int) -> dict[str, float]:
    """The numbers of an effect that a robot file has: those of its form, and over them the fitted
    ones."""
    term = model.model.terms[index]
    hypothesis = term.hypothesis
    allowed = {parameter.name for parameter in (*hypothesis.entry.parameters, *hypothesis.searched)}
    of_form = {name: value for name, value in term.shape.items() if name in allowed}
    fitted = {
        name: value.value for name, value in model.parameters_of(index).items() if name in allowed
    }
    return {**of_form, **fitted}


def written(robot: Robot, content: FileContent, unit: Unit) -> Robot:
    """Robot with the fitted groups, with losses as assumed, and the effects.

    Groups that the fit holds are unchanged, and so is ancillary power where motor current was
    recorded.
    """
    # Of power the ancillary groups are idle power and energy per sample, of current that at rest.
    *ancillary, rolling_kg, drag, mass_kg = content.theta.tolist()
    if content.effects:
        robot = with_effects_of(robot, _rounded_effects(content.effects))
    if unit == "W":
        robot = with_ancillary(robot, *ancillary)
    else:
        robot = dataclasses.replace(robot, rest_current_a=rounded(max(ancillary[0], 0.0)))
        if thrust_n_per_a(robot) == 0.0:
            return robot  # a current then says nothing of forces
    # Fitted is the product with the mass; a robot file requires a coefficient above 0.
    rolling_resistance = float(np.clip(rolling_kg / mass_kg, 1e-9, 1.0))
    return dataclasses.replace(
        robot,
        mass_kg=_unless_equal(robot.mass_kg, mass_kg),
        drag_ns2_per_m2=_unless_equal(robot.drag_ns2_per_m2, drag),
        rolling_resistance=_unless_equal(robot.rolling_resistance, rolling_resistance),
    )


def with_losses_of(robot: Robot, model: Refit | Corrected) -> Robot:
    """The robot with the losses of the drive that a fit is relative to: the file's, or less."""
    nominal = model.parameters.nominal
    return dataclasses.replace(
        robot,
        motor_loss=_unless_equal(robot.motor_loss, nominal.motor_loss),
        friction_loss=_unless_equal(robot.friction_loss, nominal.friction_loss),
    )


def replayed(robot: Robot, content: FileContent, runs: Runs) -> Array:
    """Prediction of a robot file for these drives, shape (windows,).

    With what no file contains: ground, errors of instruments, and the time before an effect began.
    """
    predicted = predict(runs, robot, content.met)
    # (effects, windows)
    not_begun = np.array(list(content.not_begun.values()), np.bool_).reshape(-1, len(predicted))
    # One replay for each set of effects that are absent together; effects of the given file are as
    # that has them.
    for absent in np.unique(not_begun, axis=1).T:
        if absent.any():
            absent_effects = {
                effect
                for effect, is_absent in zip(content.not_begun, absent, strict=True)
                if is_absent
            }
            effects = {
                effect: numbers
                for effect, numbers in robot.effects.items()
                if effect not in absent_effects
            }
            effects |= {
                effect: numbers
                for effect, numbers in content.given_effects.items()
                if effect in absent_effects
            }
            without_them = predict(runs, dataclasses.replace(robot, effects=effects), content.met)
            windows = (absent == not_begun.T).all(axis=1)
            predicted = np.where(windows, without_them, predicted)
    return content.reading + predicted


def _unless_equal(given: float, fitted: float) -> float:
    """The fitted number, rounded; the given one where they hardly differ, so that no digit of it is
    lost."""
    if math.isclose(fitted, given):
        return given
    return rounded(fitted)


ROUNDING = 1e-5
"""Relative error of a number that is rounded to the six digits of a robot file, at most."""


def rounded(value: float) -> float:
    """A number rounded to the six digits of a robot file."""
    return float(f"{value:.6g}")


def _rounded_effects(effects: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    return {effect: _rounded_numbers(numbers) for effect, numbers in effects.items()}


def _rounded_numbers(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: rounded(value) for name, value in numbers.items()}


def rounded_robot(robot: Robot, changed: Robot) -> Robot:
    """The changed robot, with the numbers that differ from `robot` rounded to the six digits of a
    robot file."""
    values: dict[str, Any] = {"effects": _rounded_effects(changed.effects)}
    for quantity in dataclasses.fields(Robot):
        new = getattr(changed, quantity.name)
        if isinstance(new, float):
            values[quantity.name] = _unless_equal(getattr(robot, quantity.name), new)
    return dataclasses.replace(changed, **values)


def of_capacity(robot: Robot, factor: float) -> Robot:
    """The robot with the capacity of its battery times a factor."""
    return dataclasses.replace(robot, rated_energy_j=rounded(robot.rated_energy_j * factor))


_FIELDS = {
    "P_anc, idle part": ("sensing_idle_w", "communication_w", "controller_w"),
    "P_anc, per sample": ("sensing_j_per_sample", "computer_j_per_sample"),
    "current at rest": ("rest_current_a",),
    "losses": ("motor_loss", "friction_loss"),
    "C_rr m": ("rolling_resistance",),
    "c": ("drag_ns2_per_m2",),
    "m": ("mass_kg",),
    "turning track_m": ("track_m",),
    USABLE_ENERGY: ("rated_energy_j",),
}
"""Fields of a robot file by what is fitted, without the losses or the thrust per ampere that divide
it."""
_FOLLOWS = "fitted, not proven: it follows from the others, as its product with them was held"
"""Origin of a number that was not fitted, such as the rolling resistance of another mass."""


def comments(robot: Robot, corrected: Robot, numbers: Sequence[FileNumber]) -> dict[str, str]:
    """Comment for each number of the robot file that was changed: how sure it is, what it was
    fitted as, what it was.

    The number of an effect is named as `effect.number`.
    """
    origins = {}
    for number in numbers:
        # Of `C_rr m / Gamma` the first part: the losses, by which it is divided, stay as assumed.
        symbol = number.name.split(" / ")[0]
        as_effect = number.name.replace(" ", ".")
        for name in _FIELDS.get(symbol, (as_effect,)):
            origins[name] = _origin(number)
    changed = {}
    for quantity in dataclasses.fields(Robot):
        old = getattr(robot, quantity.name)
        new = getattr(corrected, quantity.name)
        if isinstance(new, float) and new != old:
            origin = origins.get(quantity.name, _FOLLOWS)
            changed[quantity.name] = f"by diagnose.py, {origin}; it was {old:.6g}"
    if "rolling_resistance" in changed and surface.EFFECT.id in corrected.effects:
        # What is fitted is that of the mean ground.
        changed["rolling_resistance"] += "; the number of this line is that of the smoothest ground"
    for effect, effect_numbers in corrected.effects.items():
        for number_name in effect_numbers:
            name = f"{effect}.{number_name}"
            if name in origins:
                changed[name] = f"by diagnose.py, {origins[name]}"
    return changed


def _origin(number: FileNumber) -> str:
    """How sure a fitted number is, what it was fitted as, and its interval, in words."""
    certainty = "proven" if number.proven else "fitted, not proven"
    unit = unit_after(number.unit)
    size = f"{number.value:.4g}{unit} ({UNLIMITED})"
    if number.ci95 is not None:
        low, high = number.ci95
        size = f"{number.value:.4g} ({low:.4g} to {high:.4g}){unit}"
    if number.limit is not None:
        size = f"{number.value:.4g} ({number.limit} {limit_end(number):.4g}){unit}"
    return f"{certainty}: {number.name} = {size}"
