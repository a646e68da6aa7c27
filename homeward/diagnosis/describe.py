"""The named effects as the result has them: where each was at work, what it is, and what it may be confused with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby

import numpy as np

from homeward.diagnosis.charge import Fading
from homeward.diagnosis.hypotheses import CATALOGUE, Term
from homeward.diagnosis.location import Location, Place, at_work, condition_of, places_of, stretch_words
from homeward.diagnosis.modelling import Corrected
from homeward.diagnosis.naming import Named
from homeward.diagnosis.replay import Runs
from homeward.diagnosis.result import Evidence, MissingPhysics
from homeward.diagnosis.signals import Array
from homeward.diagnosis.structure import CHANNELS

SHOWN_BY: Mapping[str, tuple[str, ...]] = {
    "turning": ("yaw_rate_radps", "wheel_difference_mps"),
    "inertia": ("accel_mps2",),
    "regeneration": ("accel_mps2", "grade_rad"),
    "viscous": ("speed_mps",),
    "no_load": ("speed_mps",),
    "slip": ("grade_rad", "accel_mps2"),
    "copper_loss": ("grade_rad", "accel_mps2"),
    "wind": ("heading_rad",),
    "heater": ("temperature_c",),
    "cold_battery": ("temperature_c",),
    "radio": ("base_distance_m",),
    "surface": ("base_distance_m",),
    "hidden_grade": ("base_distance_m",),
    "compute": ("sensing_hz",),
    "rate_capacity": ("soc",),
}
"""Channels whose values say when an effect is at work, the most telling first."""

_OTHERWISE: Mapping[str, str] = {
    "breakaway": "at every start from standstill",
    "motor_heating": "as the motors warm up",
    "internal_resistance": "at high power",
    "rate_capacity": "at high power",
    "copper_loss": "at high load",
    "slip": "at high load",
    "clock_lag": "wherever the power changes",
    "inertia": "when speeding up",
    "turning": "in turns",
    "intermittent_load": "in stretches that repeat",
}


_FULL_DISCHARGE = (
    "Discharge the battery from full to empty at its usual load and at room temperature, and count the energy: "
    "what is gone then is gone by age."
)


def missing_physics(
    corrected: Corrected, named: Sequence[Named], runs: Runs, to_tell_apart: Sequence[str]
) -> tuple[MissingPhysics, ...]:
    """Each named effect with its fitted parameters, places and evidence.

    Args:
        corrected: The fitted model.
        named: Its effects, in the same order.
        runs: The runs.
        to_tell_apart: For each effect the drive that would separate it from its rivals.
    """
    return tuple(
        MissingPhysics(
            effect=one.term.effect,
            name=one.term.effect.replace("_", " "),
            sentence=CATALOGUE[one.term.effect].sentence,
            equation=CATALOGUE[one.term.effect].equation,
            source=CATALOGUE[one.term.effect].source,
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
        return stretch_words(places_of(contribution, runs, "", on), runs)
    channels = {channel.name: channel for channel in CHANNELS}
    told = (condition_of(channels[name], contribution, runs) for name in SHOWN_BY.get(term.effect, ()))
    words = next((one for one in told if one is not None), None)
    return places_of(contribution, runs, words or _OTHERWISE.get(term.effect, "while driving"))


def ageing(fading: Fading, wasted: Array, runs: Runs) -> MissingPhysics:
    """The fading of a battery, which its gauge shows and no power does."""
    entry = CATALOGUE["ageing"]
    return MissingPhysics(
        effect="ageing",
        name="ageing",
        sentence=entry.sentence,
        equation=entry.equation,
        source=entry.source,
        parameters={"lost_share": fading.lost_share},
        where=stretch_words(places_of(wasted, runs, "", wasted > 0.0), runs),
        evidence=Evidence(fading.delta_bic, fading.held_out_gain, fading.p_value),
        confused_with=fading.rivals,
        to_tell_apart=_FULL_DISCHARGE if fading.rivals else "",
    )


def where_at_work(term: Term, contribution: Array, runs: Runs) -> Location:
    """Where something was at work whose name does not hold: the same stretches, as a location."""
    found = places(term, contribution, runs)
    return Location("in some stretches of time", at_work(contribution), contribution, found)


def condition(found: Sequence[Place]) -> str:
    """One phrase for all the places of an effect."""
    if not found:
        return "nowhere"
    conditions = [key for key, _ in groupby(sorted(place.condition for place in found))]
    if len(conditions) == 1:
        return conditions[0]
    largest = max(found, key=lambda place: place.share_of_excess)
    more = len(found) - 1
    name = largest.recording.rsplit("/", 1)[-1]
    return f"{largest.condition} in {name} and in {more} more stretch{'es' if more > 1 else ''} of time"


def total_share(contribution: Array, runs: Runs) -> float:
    """Energy (or charge) of an effect over all that was recorded."""
    drawn = float(np.abs(runs.observed * runs.duration_s).sum())
    return float(np.abs(contribution * runs.duration_s).sum()) / drawn if drawn > 0.0 else 0.0
