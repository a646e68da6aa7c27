"""Readings and assumptions behind the advice, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache

from homeward.companion import thresholds
from homeward.companion.prior_knowledge import PriorKnowledge

_HOME = {
    "trail": "the way home is back along the way out",
    "route": "the way home is back along the route, whose slopes and directions are known",
    "loop": "the route ends where it begins, and the way home is back along all of it",
    "moved": "home has moved: back along the way out as far as that helps, then straight on, times "
    f"{thresholds.DETOUR:g}",
    "other way": "the way home is the one given, over ground with the rolling resistance estimated here",
    "dock": "the way to the dock leads along the way driven or the route as far as that helps, then straight on, "
    f"times {thresholds.DETOUR:g}",
}


def rests_on(
    has: Mapping[str, bool],
    knowledge: PriorKnowledge,
    home: str,
    battery: tuple[str, ...],
    pace: str,
) -> tuple[str, ...]:
    """Sentences, the most important first.

    Args:
        has: Which readings there have been: power, soc, grade, heading, position.
        knowledge: The prior.
        home: `trail`, `route`, `loop`, `moved`, `other way` or `dock`.
        battery: What is assumed of it.
        pace: What is assumed of the speed on the way home.
    """
    read = tuple(sorted(name for name, was_read in has.items() if was_read))
    energy, way, *assumptions = _said(read, knowledge.words, home, battery)
    # The pace changes as the robot drives, so it is not kept.
    return energy, way, pace, *assumptions


@cache
def _said(
    has: tuple[str, ...], words: tuple[str, ...], home: str, battery: tuple[str, ...]
) -> tuple[str, ...]:
    energy = {
        (
            True,
            True,
        ): "energy from the power meter, capacity of the battery from the state of charge",
        (
            True,
            False,
        ): "energy from the power meter; no state of charge: the battery's capacity keeps its prior",
        (False, True): "no power: energy from the model and the state of charge",
        (False, False): "neither power nor state of charge: energy from the model alone",
    }[("power" in has, "soc" in has)]
    sentences = [energy, _HOME[home]]
    if "position" in has and "heading" in has:
        sentences.append("positions filtered by speed and heading, which takes their noise away")
    if "grade" in has and home not in ("route", "loop"):
        tilt_deg = math.degrees(thresholds.SLOPE_OFFSET)
        sentences.append(
            f"slopes from a sensor that is mounted within {tilt_deg:.1g} degrees, one standard deviation"
        )
    if "position" not in has:
        sentences.append(
            "no position: the robot started at home, and its way is reckoned from speed and heading"
        )
    if "grade" not in has and home not in ("route", "loop"):
        sentences.append(
            f"no slopes: the ground is assumed to be flat, within {100.0 * thresholds.NO_SLOPE_SD:g} %"
        )
    if "heading" not in has:
        sentences.append(
            "no heading: the way is assumed to be straight, so a tail wind becomes a head wind"
        )
    sentences += words
    sentences += battery
    return tuple(sentences)
