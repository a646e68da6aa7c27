"""The named effects as the result has them: where each was at work, what it is, and what it may be confused with."""

from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from homeward.diagnosis.explain.hypothesis import Hypothesis, Term
from homeward.diagnosis.explain.joint_fit import Corrected
from homeward.diagnosis.explain.naming import Named
from homeward.diagnosis.explain.places import WHOLE_RUN, Location, Place, at_work, condition_of, places_of
from homeward.diagnosis.explain.residual_test import CHANNELS
from homeward.diagnosis.explain.witnesses import Witnessed
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.channels import Array
from homeward.diagnosis.result import Evidence, MissingPhysics


def missing_physics(
    corrected: Corrected, named: Sequence[Named], runs: Runs, to_tell_apart: Sequence[str]
) -> tuple[MissingPhysics, ...]:
    """Each named effect with its fitted parameters, places, evidence, and the drive that tells it from its rivals."""
    return tuple(
        _of(
            one.term.hypothesis,
            parameters=corrected.parameters_of(index),
            where=places(one.term, corrected.contribution[index], runs),
            evidence=Evidence(one.delta_bic, one.held_out_gain, one.p_value),
            confused_with=tuple(rival.effect for rival in one.rivals),
            to_tell_apart=drive,
        )
        for index, (one, drive) in enumerate(zip(named, to_tell_apart, strict=True))
    )


def places(term: Term, contribution: Array, runs: Runs) -> tuple[Place, ...]:
    """Where an effect was at work, stretch by stretch, each with its condition in plain words."""
    if term.axis == "time":
        on = None if term.schedule is None else term.schedule.level > 0
        return places_of(contribution, runs, None, on)
    channels = {channel.name: channel for channel in CHANNELS}
    told = (condition_of(channels[name], contribution, runs) for name in term.hypothesis.channels)
    words = next((one for one in told if one is not None), None)
    return places_of(contribution, runs, words or term.hypothesis.otherwise)


def witnessed(found: Witnessed, runs: Runs) -> MissingPhysics:
    """An effect that another channel than power shows."""
    measurement = found.hypothesis.measurement
    return _of(
        found.hypothesis,
        parameters=dict(found.parameters),
        where=places_of(found.contribution, runs, None, found.contribution != 0.0),
        evidence=found.proof,
        confused_with=found.rivals,
        to_tell_apart=f"{measurement[0].upper()}{measurement[1:]}." if found.rivals else "",
    )


def _of(one: Hypothesis, **found: Any) -> MissingPhysics:
    entry = one.entry
    return MissingPhysics(one.id, one.name, entry.sentence, entry.equation, entry.source, **found)


def where_at_work(term: Term, contribution: Array, runs: Runs) -> Location:
    """Where something was at work whose name does not hold: the same stretches, as a location."""
    found = places(term, contribution, runs)
    return Location("in some stretches of time", at_work(contribution), contribution, found)


def condition(found: Sequence[Place]) -> str:
    """One phrase for all the places of an effect."""
    if not found:
        return "nowhere"
    return found[0].condition if len({place.condition for place in found}) == 1 else largest(found)


def largest(found: Sequence[Place]) -> str:
    """The place that holds most, and how many more there are."""
    first, more = max(found, key=lambda place: place.share_of_excess), len(found) - 1
    name = PurePath(first.recording).name
    start = f"all through {name}" if first.condition == WHOLE_RUN else f"{first.condition} in {name}"
    return start + (f" and in {more} more stretch{'es' if more > 1 else ''} of time" if more else "")


def total_share(contribution: Array, runs: Runs) -> float:
    """Energy (or charge) of an effect over all that was recorded."""
    drawn = float(np.abs(runs.observed * runs.duration_s).sum())
    return float(np.abs(contribution * runs.duration_s).sum()) / drawn if drawn > 0.0 else 0.0
