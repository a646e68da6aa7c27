"""What autopilot and ground station are told of an advice: texts (STATUSTEXT) and numbers (NAMED_VALUE_FLOAT)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from enum import IntEnum

from homeward import quantities
from homeward.watch.live import kind_of
from homeward.watch.online.link import News, can_reach_home, reserve

_CHUNK = 50  # characters of a STATUSTEXT, and
LONGEST_NAME = 10  # of the name of a NAMED_VALUE_FLOAT (common.xml)
_REPEATED_S = 30.0
"""Time after which the order to turn is said again: a message may be lost. Chosen."""


class Severity(IntEnum):
    """MAV_SEVERITY (common.xml)."""

    ALERT = 1
    CRITICAL = 2
    WARNING = 4
    NOTICE = 5


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


class Texts:
    """Says what has changed, and repeats an order to turn."""

    def __init__(self) -> None:
        self._order: Severity | None = None
        self._ordered_s = -math.inf
        self._warned: set[str] = set()

    def due(self, news: News, now_s: float) -> Iterator[tuple[Severity, str]]:
        """Texts to send now, with their severity.

        Args:
            news: What there is to tell.
            now_s: Time by a monotonic clock, s.
        """
        order, text = _order_of(news)
        if order != self._order or (order is not None and now_s - self._ordered_s >= _REPEATED_S):
            yield order or Severity.NOTICE, text
            self._order, self._ordered_s = order, now_s
        for warning in news.warnings:
            if kind_of(warning) not in self._warned:
                yield Severity.WARNING, f"homeward: {warning}"
        self._warned = set(map(kind_of, news.warnings))


def _order_of(news: News) -> tuple[Severity | None, str]:
    """The order to turn, by its severity, and its text; None without an order."""
    advice = news.advice
    if advice is None or (can_reach_home(advice) and not advice.turn_now):
        return None, "homeward: need not turn any more"
    way = quantities.distance(advice.way_home_m)
    if not can_reach_home(advice):
        return Severity.ALERT, f"homeward: may not get home: {advice.chance_home:.0%}, {way}"
    return Severity.CRITICAL, f"homeward: TURN NOW, way home {way}"


def chunks(text: str) -> Sequence[bytes]:
    """A text in parts that STATUSTEXT takes. A null sign ends it, so a text that fills its last part has an empty one
    more.

    >>> chunks("turn 90° now"), [len(part) for part in chunks("x" * 100)]
    ([b'turn 90? now'], [50, 50, 0])
    """
    content = text.encode("ascii", "replace")
    if len(content) <= _CHUNK:
        return [content]
    parts = [content[start : start + _CHUNK] for start in range(0, len(content), _CHUNK)]
    return [*parts, b""] if len(parts[-1]) == _CHUNK else parts
