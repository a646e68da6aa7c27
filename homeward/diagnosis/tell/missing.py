"""Missing physics for the result: each effect with its parameters, its places and the evidence for
it."""

import math
from collections.abc import Mapping
from dataclasses import replace

from homeward.diagnosis.evidence import Evidence
from homeward.diagnosis.explain.channel_effects.shown import ChannelEffect
from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.explain.limits import Limit
from homeward.diagnosis.explain.named import Named
from homeward.diagnosis.explain.places import places, places_of
from homeward.diagnosis.fit.parameter_groups import ROLLING
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import MissingPhysics, NotNamed, Proof, Value
from homeward.diagnosis.tell.next_drive import to_tell_apart

Interval = tuple[float, float]

_ROUNDING = 1e-9  # share of what lies between two bounds


def missing_physics(evidence: Evidence) -> tuple[MissingPhysics, ...]:
    """The named effects, then those that other channels than power show."""
    named = [
        _named_effect(index, effect, evidence) for index, effect in enumerate(evidence.naming.named)
    ]
    shown_by_channels = [
        _channel_effect(effect, evidence.runs) for effect in evidence.channel_effects
    ]
    return (*named, *shown_by_channels)


def _named_effect(index: int, named: Named, evidence: Evidence) -> MissingPhysics:
    corrected = evidence.corrected
    assert corrected is not None
    hypothesis = named.term.hypothesis
    return MissingPhysics(
        effect=hypothesis.id,
        name=hypothesis.name,
        sentence=" ".join([hypothesis.entry.sentence, *_relative_to(index, corrected)]),
        equation=hypothesis.entry.equation,
        source=hypothesis.entry.source,
        parameters=measured_of(
            with_limits(hypothesis.id, corrected.parameters_of(index), evidence.limits), hypothesis
        ),
        where=places(named.term, corrected.contribution[index], evidence.runs),
        evidence=Proof(named.delta_bic, named.held_out_gain, named.p_value),
        confused_with=tuple(rival.effect for rival in named.rivals),
        to_tell_apart=to_tell_apart(
            evidence.fitted, evidence.runs, evidence.residual, named.term, named.rivals
        ),
        conditions=named.checks,
    )


def with_limits(
    effect: str, parameters: Mapping[str, Value], limits: Mapping[str, Limit]
) -> dict[str, Value]:
    """The parameters of an effect, those that are limited from one side with that side."""
    stated = dict(parameters)
    for name, value in parameters.items():
        limit = limits.get(f"{effect} {name}")
        if limit is not None:
            stated[name] = replace(value, ci95=limit.ci95, limit=limit.side)
    return stated


def measured_of(parameters: Mapping[str, Value], hypothesis: Hypothesis) -> dict[str, Value]:
    """Parameters of an effect, without an interval where the recordings do not limit them."""
    bounds = {}
    for parameter in (*hypothesis.entry.parameters, *hypothesis.searched):
        bounds[parameter.name] = (parameter.low, parameter.high)
    measured = {}
    for name, value in parameters.items():
        measured[name] = value
        if name in bounds and value.limit is None:
            measured[name] = replace(value, ci95=within_bounds(value.ci95, *bounds[name]))
    return measured


def within_bounds(ci95: Interval | None, least: float, most: float) -> Interval | None:
    """An interval within the bounds of its quantity; None if it is all that lies between them."""
    if ci95 is None:
        return None
    low = min(max(ci95[0], least), most)
    high = min(max(ci95[1], least), most)
    span = most - least
    left_out = (low - least) + (most - high)
    if math.isfinite(span) and left_out <= _ROUNDING * span:
        return None
    return low, high


def _relative_to(index: int, corrected: Corrected) -> list[str]:
    """What the sizes of a profile are relative to, in a sentence, where only their differences are
    known."""
    if corrected.by_distance[index] is None:
        return []
    is_ground = corrected.model.terms[index].of_rolling_kg is not None
    if is_ground and not corrected.groups.held[ROLLING]:
        return [
            "Its sizes are relative to the mean ground by distance, as rougher ground all along is a larger C_rr."
        ]
    return [
        "Its sizes are relative to their mean by distance, as what is the same all along cannot be known."
    ]


def _channel_effect(effect: ChannelEffect, runs: Runs) -> MissingPhysics:
    hypothesis = effect.hypothesis
    advice = ""
    if effect.rivals:
        measurement = hypothesis.measurement
        advice = f"{measurement[0].upper()}{measurement[1:]}."
    return MissingPhysics(
        effect=hypothesis.id,
        name=hypothesis.name,
        sentence=hypothesis.entry.sentence,
        equation=hypothesis.entry.equation,
        source=hypothesis.entry.source,
        parameters=measured_of(effect.parameters, hypothesis),
        where=places_of(
            effect.contribution, runs, condition=None, inside=effect.contribution != 0.0
        ),
        evidence=effect.proof,
        confused_with=effect.rivals,
        to_tell_apart=advice,
    )


def not_named(evidence: Evidence) -> tuple[NotNamed, ...]:
    """Effects that were tried and not named, with their conditions: of each the try that met
    most."""
    named = {effect.term.effect for effect in evidence.naming.named}
    furthest: dict[str, NotNamed] = {}
    for refused in evidence.naming.refused:
        if refused.effect in named:
            continue
        earlier_try = furthest.get(refused.effect)
        if earlier_try is None or len(earlier_try.conditions) < len(refused.checks):
            furthest[refused.effect] = NotNamed(refused.effect, refused.checks)
    return tuple(furthest.values())
