"""The corrected robot: identifiable groups and effects written back into a robot file."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from homeward.diagnosis.explain.hypothesis import Term
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.fit.parameter_groups import ROLLING, with_ancillary, with_effects_of
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs, WithEffects, predict, thrust_n_per_a
from homeward.diagnosis.read.signals import Unit
from homeward.diagnosis.result import FileNumber
from homeward.logs.channels import Array, Mask
from homeward.physics import Robot


@dataclass(frozen=True)
class FileContent:
    """The part of a fit that a robot file contains, and what these drives or their instruments add to it."""

    theta: Array  # (groups,)
    effects: Mapping[str, Mapping[str, float]]
    met: WithEffects  # ground of these drives, lag and scale of their instruments
    reading: Array | float = 0.0  # what instruments add, (windows,)
    before: Mapping[str, Mask] = field(default_factory=dict)  # windows in which an effect had not begun, (windows,)
    given: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # effects of the given file


def is_expressible(term: Term) -> bool:
    """Whether a robot file can express an effect: of one size, begun at some moment to stay, or uneven ground."""
    if not term.hypothesis.physical or term.hypothesis.is_weather or term.flexible:
        return False
    return term.axis == "steady" or term.of_rolling_kg is not None or _stays(term)


def _stays(term: Term) -> bool:
    """Whether an effect begins once and is then at work to the end, as in the robot's present state."""
    one = term.schedule
    if one is None or term.axis != "time" or one.levels != 2:
        return False
    return bool(one.level[-1] == 1) and int(np.count_nonzero(np.diff(one.level))) == 1


def file_content(model: Refit | Corrected, runs: Runs) -> FileContent:
    """Separate what a robot file can express of a fit from what it cannot: times, places, and instruments."""
    if isinstance(model, Refit):
        return FileContent(model.theta, {}, WithEffects())
    terms, theta = model.model.terms, model.theta
    effects: dict[str, dict[str, float]] = {}
    met = replace(model.model.within(runs, model.values), effects={})
    before: dict[str, Mask] = {}
    given = model.parameters.nominal.effects
    reading = np.zeros(len(runs.observed))
    for index, term in enumerate(terms):
        if term.of_rolling_kg is not None:
            smoothest, gain, roughness = _ground(model, index, runs)
            of_gain, of_typical = term.hypothesis.entry.parameters
            given_gain, given_typical = (given.get(term.effect, {}).get(of.name, 0.0) for of in (of_gain, of_typical))
            theta = theta.copy()
            theta[ROLLING] *= smoothest * (1.0 + given_gain * given_typical)
            typical = float(np.average(roughness, weights=np.abs(runs.context["speed_mps"]) * runs.duration_s))
            effects[term.effect] = {of_gain.name: gain, of_typical.name: typical}
            met = replace(met, roughness=roughness)
        elif is_expressible(term):
            shape = given.get(term.effect, {})
            effects[term.effect] = {**shape, **_numbers(model, index), **term.hypothesis.reach(runs)}
            if _stays(term) and term.schedule is not None:
                before[term.effect] = term.schedule.level == 0
        elif term.misread:
            reading += term.columns @ model.sizes(index)
    return FileContent(theta, effects, met, reading, before, given)


def _ground(model: Corrected, index: int, runs: Runs) -> tuple[float, float, Array]:
    """C_rr of the smoothest ground over the fitted one, gain of the roughest, and roughness of each, shape (windows,).

    The ends of a smooth profile are quantiles: a hat function that covers few windows is poorly estimated.
    """
    term = model.model.terms[index]
    switch = term.hypothesis.entry.switch
    assert term.at_work is not None
    share = model.share(index)
    rolls = 1.0 + np.clip(term.at_work @ model.sizes(index) * share, switch.low, switch.high)
    driven = np.abs(runs.context["speed_mps"]) > 0.0
    ends = (0.0, 1.0) if term.schedule is not None else _ENDS
    smoothest, roughest = np.quantile(rolls[driven], ends).tolist()
    gain = roughest / smoothest - 1.0
    if gain <= 0.0:
        return smoothest, 0.0, np.zeros(len(rolls))
    return smoothest, gain, np.clip((rolls / smoothest - 1.0) / gain, 0.0, 1.0)


_ENDS = (0.05, 0.95)  # quantiles; chosen: a twentieth of what was driven is left out at each end


def _numbers(model: Corrected, index: int) -> dict[str, float]:
    term = model.model.terms[index]
    one, switch = term.hypothesis, term.hypothesis.entry.switch
    known = {parameter.name for parameter in (*one.entry.parameters, *one.searched)}
    numbers = {name: value.value for name, value in model.parameters_of(index).items() if name in known}
    if term.of_rolling_kg is not None:
        numbers[switch.name] = float(np.clip(numbers[switch.name], switch.low, switch.high))
    return {**{name: value for name, value in term.shape.items() if name in known}, **numbers}


def written(robot: Robot, content: FileContent, unit: Unit) -> Robot:
    """Robot with the fitted groups, with losses as assumed, and the effects.

    Groups that the fit holds are unchanged, and so is ancillary power where motor current was recorded.
    """
    *ancillary, rolling_kg, drag, mass_kg = content.theta.tolist()
    if content.effects:
        effects = {name: {key: rounded(value) for key, value in one.items()} for name, one in content.effects.items()}
        robot = with_effects_of(robot, effects)
    if unit == "W":
        robot = with_ancillary(robot, *ancillary)
    else:
        robot = dataclasses.replace(robot, rest_current_a=rounded(max(ancillary[0], 0.0)))
        if thrust_n_per_a(robot) == 0.0:
            return robot
    return dataclasses.replace(
        robot,
        mass_kg=_unless_equal(robot.mass_kg, mass_kg),
        drag_ns2_per_m2=_unless_equal(robot.drag_ns2_per_m2, drag),
        rolling_resistance=_unless_equal(robot.rolling_resistance, float(np.clip(rolling_kg / mass_kg, 1e-9, 1.0))),
    )


def replayed(robot: Robot, content: FileContent, runs: Runs) -> Array:
    """Prediction of a robot file for these drives, shape (windows,).

    With what no file contains: ground, errors of instruments, and the time before an effect began.
    """
    predicted = predict(runs, robot, content.met)
    masks = np.array(list(content.before.values()), np.bool_).reshape(-1, len(predicted))
    for absent in np.unique(masks, axis=1).T:
        if absent.any():
            names = {effect for effect, lacks in zip(content.before, absent, strict=True) if lacks}
            effects = {name: numbers for name, numbers in robot.effects.items() if name not in names}
            effects |= {name: numbers for name, numbers in content.given.items() if name in names}
            earlier = predict(runs, dataclasses.replace(robot, effects=effects), content.met)
            predicted = np.where((absent == masks.T).all(axis=1), earlier, predicted)
    return content.reading + predicted


def _unless_equal(before: float, after: float) -> float:
    return before if math.isclose(after, before) else rounded(after)


def rounded(value: float) -> float:
    """A number rounded to the six digits of a robot file."""
    return float(f"{value:.6g}")


def rounded_robot(before: Robot, after: Robot) -> Robot:
    """The robot with the numbers that differ from those before rounded to the six digits of a robot file."""
    values: dict[str, Any] = {}
    for quantity in dataclasses.fields(Robot):
        old, new = getattr(before, quantity.name), getattr(after, quantity.name)
        if isinstance(new, float):
            values[quantity.name] = _unless_equal(old, new)
    values["effects"] = {
        effect: {name: rounded(value) for name, value in numbers.items()} for effect, numbers in after.effects.items()
    }
    return dataclasses.replace(after, **values)


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
}
"""Fields of a robot file by what is fitted, without the losses or the thrust per ampere that divide it."""


def comments(before: Robot, after: Robot, numbers: Sequence[FileNumber] = ()) -> dict[str, str]:
    """Comment for each number of the robot file that was changed: how sure it is, what it was fitted as, what it was.

    The number of an effect is named as `effect.number`.
    """
    said = {}
    for number in numbers:
        low, high = number.ci95
        sure = "proven" if number.proven else "fitted, not proven"
        for name in _FIELDS.get(number.name.split(" / ")[0], (number.name.replace(" ", "."),)):
            unit = "" if number.unit == "1" else f" {number.unit}"
            said[name] = f"{sure}: {number.name} = {number.value:.4g} ({low:.4g} to {high:.4g}){unit}"
    changed = {}
    for quantity in dataclasses.fields(Robot):
        old, new = getattr(before, quantity.name), getattr(after, quantity.name)
        if isinstance(new, float) and new != old:
            how = said.get(quantity.name, "from the recorded state of charge against the energy drawn")
            changed[quantity.name] = f"by diagnose.py, {how}; it was {old:.6g}"
    for effect, own in after.effects.items():
        for name in own:
            if f"{effect}.{name}" in said:
                changed[f"{effect}.{name}"] = f"by diagnose.py, {said[f'{effect}.{name}']}"
    return changed
