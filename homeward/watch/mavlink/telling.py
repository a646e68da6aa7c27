"""How autopilot and ground station are told of an advice: numbers (NAMED_VALUE_FLOAT), texts in
parts (STATUSTEXT)."""

from __future__ import annotations

from collections.abc import Sequence

from homeward.watch.online.link import News, can_reach_home, reserve

_CHUNK = 50  # characters of a STATUSTEXT, and
LONGEST_NAME = 10  # of the name of a NAMED_VALUE_FLOAT (common.xml)


def numbers(news: News) -> dict[str, float]:
    """Values of an advice by the names that they are sent under; none before the first."""
    advice = news.advice
    if advice is None:
        return {}
    return {
        "hw_reach": float(can_reach_home(advice)), "hw_turn": float(advice.turn_now), "hw_chance": advice.chance_home,
        "hw_way_m": advice.way_home_m, "hw_left_j": advice.energy_left_j.mean, "hw_home_j": advice.energy_home_j.mean,
        "hw_marg_j": advice.margin_j.mean, "hw_reserve": reserve(advice, news.full_j), "hw_turn_m": advice.turn_in_m,
        "hw_turn_s": advice.turn_in_s,
    }  # fmt: skip


def chunks(text: str) -> Sequence[bytes]:
    """A text in parts that STATUSTEXT takes. A null sign ends it, so a text that fills its last
    part has an empty one more.

    >>> chunks("turn 90° now"), [len(part) for part in chunks("x" * 100)]
    ([b'turn 90? now'], [50, 50, 0])
    """
    content = text.encode("ascii", "replace")
    if len(content) <= _CHUNK:
        return [content]
    parts = [content[start : start + _CHUNK] for start in range(0, len(content), _CHUNK)]
    return [*parts, b""] if len(parts[-1]) == _CHUNK else parts
