"""The numbers of corrected.toml: the interval of each, and whether it is proven.

What the diagnosis measures has one interval, in the report and in the file: that of the
measurement, with the errors of the instruments. A file may hold another value where it is fitted to
predict; its interval is then that of the fit, of the recordings and the prior together. No interval
leaves the bounds of its quantity, and a number that may be anything within them has none.
"""

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.channel_effects.shown import USABLE_ENERGY
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.explain.uncertainty import (
    Joint,
    by_blocks,
    joint_as_fitted,
    to_the_next,
    varied_parameters,
)
from homeward.diagnosis.fit.parameter_groups import GROUPS
from homeward.diagnosis.fit.predictive import LOSSES, MOST_LOST
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import FileNumber, Side
from homeward.diagnosis.tell.corrected import ROUNDING, ground_of
from homeward.diagnosis.tell.missing import Interval, measured_of, with_limits, within_bounds
from homeward.logs.channels import Array, Index
from homeward.physics import Robot
from homeward.physics.effects import Parameter

_GROUPS = {group.symbol for groups in GROUPS.values() for group in groups}
_PARAMETERS: Mapping[str, Parameter] = {
    f"{hypothesis.id} {parameter.name}": parameter
    for hypothesis in CATALOGUE.values()
    for parameter in (*hypothesis.entry.parameters, *hypothesis.searched)
}
"""Parameters of all effects, by effect and name."""
_SWITCHES = {f"{hypothesis.id} {hypothesis.entry.switch.name}" for hypothesis in CATALOGUE.values()}
_BESIDE_EFFECTS = {*_GROUPS, LOSSES, "turning track_m"}
"""Fitted numbers that a robot file has elsewhere than among its effects."""
_SMALL_STEP = 1e-4  # of a scale, for a derivative by a finite difference; chosen


@dataclass(frozen=True)
class _Claim:
    """What is known of a number beside its value: its interval, whether that is a proof, and the
    side if it is limited from one side only."""

    ci95: Interval | None
    proven: bool
    limit: Side | None = None


def fitted_numbers(
    robot: Robot,
    changed: Robot,
    model: Refit | Corrected,
    fitted: Joint,
    proven_effects: Collection[str],
    evidence: Evidence,
) -> tuple[FileNumber, ...]:
    """The numbers of a file that was fitted to power or current.

    Args:
        robot: The robot as its file has it.
        changed: The robot as corrected.toml has it.
        model: The fit whose effects it holds.
        fitted: What was fitted for the file, with its covariance.
        proven_effects: Effects that are proven to be in the robot.
        evidence: What was measured and named.
    """
    # What is said of a number first, if it holds the value in the file.
    sources = (
        _measured(evidence, proven_effects),
        _of_form(model, proven_effects, evidence.runs, evidence.block),
        _of_fit(fitted, evidence),
    )
    numbers = []
    for name, value, unit in _values(robot, changed, fitted):
        claims = [source[name] for source in sources if name in source]
        numbers.append(_number(name, value, unit, _first_that_holds(value, claims)))
    return tuple(numbers)


def battery_numbers(evidence: Evidence, capacity_is_written: bool) -> tuple[FileNumber, ...]:
    """The numbers of a file that voltage and state of charge show."""
    numbers = []
    for effect in evidence.channel_effects:
        parameters = measured_of(effect.parameters, effect.hypothesis)
        for name, value in parameters.items():
            if effect.in_file:
                claim = _Claim(value.ci95, proven=True)
                name_in_file = f"{effect.hypothesis.id} {name}"
                numbers.append(_number(name_in_file, value.value, value.unit, claim))
    capacity = evidence.capacity
    if capacity is not None and capacity_is_written:
        # Where a loss explains the charge as well, this is one of two explanations.
        claim = _Claim(capacity.ci95, proven=not capacity.rivals)
        numbers.append(_number(USABLE_ENERGY, capacity.fitted_j, "J", claim))
    return tuple(numbers)


def _values(robot: Robot, changed: Robot, fitted: Joint) -> list[tuple[str, float, str]]:
    """Name, value and unit of each fitted number that the file has, then of each other one that
    came with an effect, as the losses of the drive and the numbers of its form."""
    in_file = _effect_numbers(changed)
    values = []
    for name, value, unit in zip(fitted.names, fitted.values.tolist(), fitted.units, strict=True):
        if name in _BESIDE_EFFECTS:
            values.append((name, value, unit))
        elif name in in_file:
            values.append((name, in_file[name], unit))
    losses = changed.motor_loss + changed.friction_loss
    if LOSSES not in fitted.names and losses != robot.motor_loss + robot.friction_loss:
        # They were lowered for a share of regeneration that exceeds its bound.
        values.append((LOSSES, losses, "1"))
    given = _effect_numbers(robot)
    for name, value in in_file.items():
        if name not in fitted.names and value != given.get(name):
            values.append((name, value, _PARAMETERS[name].unit))
    return values


def _effect_numbers(robot: Robot) -> dict[str, float]:
    """Numbers of the effects of a robot, by effect and name."""
    numbers = {}
    for effect, values in robot.effects.items():
        for name, value in values.items():
            numbers[f"{effect} {name}"] = value
    return numbers


def _measured(evidence: Evidence, proven_effects: Collection[str]) -> dict[str, _Claim]:
    """What the diagnosis measures: groups, and numbers of named effects."""
    claims: dict[str, _Claim] = {}
    for estimate in evidence.estimates:
        if estimate.ci95 is not None:
            claims[estimate.group.symbol] = _Claim(estimate.ci95, estimate.off)
    for name, limit in evidence.limits.items():
        claims[name] = _Claim(limit.ci95, proven=False, limit=limit.side)
    if evidence.corrected is None:
        return claims
    for index, named in enumerate(evidence.naming.named):
        hypothesis = named.term.hypothesis
        fitted = evidence.corrected.parameters_of(index)
        stated = with_limits(hypothesis.id, fitted, evidence.limits)
        for name, value in measured_of(stated, hypothesis).items():
            claim = _Claim(value.ci95, hypothesis.id in proven_effects, value.limit)
            claims[f"{hypothesis.id} {name}"] = claim
    return claims


def _of_fit(fitted: Joint, evidence: Evidence) -> dict[str, _Claim]:
    """What a fit shows of its numbers: their covariance, and the error of the meter's scale, which
    no residual shows."""
    claims = {}
    variances = np.maximum(np.diag(fitted.covariance), 0.0).tolist()
    for name, value, variance in zip(fitted.names, fitted.values.tolist(), variances, strict=True):
        error = math.hypot(math.sqrt(variance), thresholds.GAIN_ERROR * value)
        half = thresholds.NORMAL_95 * error
        limit = evidence.limits.get(name)
        side = None if limit is None else limit.side
        claims[name] = _Claim((value - half, value + half), proven=False, limit=side)
    return claims


def _of_form(
    model: Refit | Corrected, proven_effects: Collection[str], runs: Runs, block: Index
) -> dict[str, _Claim]:
    """What is known of the numbers that come with the form of an effect."""
    claims: dict[str, _Claim] = {}
    if isinstance(model, Refit):
        return claims
    for index, term in enumerate(model.model.terms):
        is_proven = term.effect in proven_effects
        if term.of_rolling_kg is not None:
            for name, ci95 in _intervals_of_ground(model, index, runs, block).items():
                claims[f"{term.effect} {name}"] = _Claim(ci95, is_proven)
        for parameter in varied_parameters(term, runs):
            if parameter.name in term.shape:
                ci95 = to_the_next(parameter, [term.shape[parameter.name]])
                claims[f"{term.effect} {parameter.name}"] = _Claim(ci95, is_proven)
    return claims


def _intervals_of_ground(
    model: Corrected, index: int, runs: Runs, block: Index
) -> dict[str, Interval]:
    """Intervals of the gain and the typical roughness of the ground, which follow from all that was
    fitted, to first order.

    A wrong scale of the meter changes neither.
    """
    fitted_groups = np.flatnonzero(~model.groups.held)
    columns = []
    for group in fitted_groups:
        step = _SMALL_STEP * model.parameters.scale[group]
        theta = model.theta.copy()
        theta[group] += step
        groups = dataclasses.replace(model.groups, theta=theta)
        moved = dataclasses.replace(model, groups=groups)
        change = _of_ground(moved, index, runs) - _of_ground(model, index, runs)
        columns.append(change / (step * model.parameters.to_group[group]))
    for number in range(len(model.values)):
        values = model.values.copy()
        values[number] += _SMALL_STEP
        moved = dataclasses.replace(model, values=values)
        columns.append(
            (_of_ground(moved, index, runs) - _of_ground(model, index, runs)) / _SMALL_STEP
        )
    by_fitted = np.column_stack(columns)  # (gain and typical roughness, fitted numbers)
    covariance = joint_as_fitted(model, runs, by_blocks(block)).covariance
    variances = np.maximum(np.diag(by_fitted @ covariance @ by_fitted.T), 0.0)
    half_intervals = (thresholds.NORMAL_95 * np.sqrt(variances)).tolist()
    numbers = _of_ground(model, index, runs).tolist()
    names = [parameter.name for parameter in model.model.terms[index].hypothesis.entry.parameters]
    intervals = {}
    for name, value, half in zip(names, numbers, half_intervals, strict=True):
        intervals[name] = (value - half, value + half)
    return intervals


def _of_ground(model: Corrected, index: int, runs: Runs) -> Array:
    """Gain and typical roughness of the ground, shape (2,)."""
    ground = ground_of(model, index, runs)
    return np.array([ground.gain, ground.typical])


def _first_that_holds(value: float, claims: Sequence[_Claim]) -> _Claim:
    """The first claim whose interval holds the value; where none does, that nothing limits it."""
    for claim in claims:
        if claim.ci95 is None:
            return claim
        low, high = claim.ci95
        margin = ROUNDING * abs(value)
        if low - margin <= value <= high + margin:
            return claim
    return _Claim(None, proven=False)


def _number(name: str, value: float, unit: str, claim: _Claim) -> FileNumber:
    """A number with its interval within the bounds of its quantity.

    It is proven if its size differs from none, and if the recordings limit it.
    """
    low, high = _bounds(name, value)
    ci95 = within_bounds(claim.ci95, low, high)
    side = claim.limit
    if name in _SWITCHES and value >= high:
        side = "at least"
    if ci95 is None:
        return FileNumber(name, value, None, unit, proven=False)
    if side is not None:
        return FileNumber(name, value, ci95, unit, proven=False, limit=side)
    is_size = name in _GROUPS or name in _SWITCHES
    holds_zero = ci95[0] <= 0.0 <= ci95[1]
    return FileNumber(name, value, ci95, unit, proven=claim.proven and not (is_size and holds_zero))


def _bounds(name: str, value: float) -> Interval:
    """Bounds of a quantity by its name, as it is fitted: no group, energy or track is negative."""
    if name in _PARAMETERS:
        return _PARAMETERS[name].low, _PARAMETERS[name].high
    if name == LOSSES:
        return 0.0, max(MOST_LOST, value)
    return 0.0, math.inf
