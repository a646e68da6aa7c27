"""What an estimate rests on, in words."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from homeward.companion.prior_knowledge import PriorKnowledge

_HOME = {
    "trail": "home is back over the way out",
    "route": "home is back along the route, of which slopes and directions ahead are known",
    "loop": "the route ends where it begins, and home is back along it: of a way out and back, give the way out",
    "moved": "home has moved: back along the way out as far as that helps, then straight on, times 1.3",
    "other way": "home is by the way given, over ground that rolls as here",
}


def rests_on(has: Mapping[str, bool], known: PriorKnowledge, home: str, has_cutoff: bool) -> tuple[str, ...]:
    """Sentences, the most telling first.

    Args:
        has: Which readings there have been: power, soc, grade, heading, position.
        known: What was known beforehand.
        home: `trail`, `route`, `loop`, `moved` or `other way`.
        has_cutoff: Whether a cut-off voltage was given.
    """
    return _said(tuple(sorted(name for name, there in has.items() if there)), known.words, home, has_cutoff)


@cache
def _said(has: tuple[str, ...], words: tuple[str, ...], home: str, has_cutoff: bool) -> tuple[str, ...]:
    energy = {
        (True, True): "energy by the power meter, the battery's capacity by the state of charge",
        (True, False): "energy by the power meter; no state of charge: the battery's capacity is as known beforehand",
        (False, True): "no power: energy by the model and the state of charge",
        (False, False): "neither power nor state of charge: energy by the model alone",
    }[("power" in has, "soc" in has)]
    sentences = [energy, _HOME[home]]
    if "position" not in has:
        sentences.append("no position: home is where it began, and the way is reckoned from speed and heading")
    if "grade" not in has and home not in ("route", "loop"):
        sentences.append("no slopes: the ground is taken to be flat, within 4 %")
    if "heading" not in has:
        sentences.append("no heading: the way is taken to be straight, so that a wind that helped will hurt")
    sentences += words
    sentences.append(
        "the battery is cut off by its voltage, which is taken to go on falling as it does" if has_cutoff
        else "the battery lasts to its end: no cut-off voltage was given"
    )  # fmt: skip
    return tuple(sentences)
