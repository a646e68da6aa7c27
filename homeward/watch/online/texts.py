"""Texts on what has changed in an advice, with their severity: what MAVLink and Foxglove are
told."""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import IntEnum

from homeward import quantities
from homeward.watch.live import kind_of
from homeward.watch.online.link import News, can_reach_home

_REPEATED_S = 30.0
"""Time after which the order to turn is said again: a message may be lost. Chosen."""


class Severity(IntEnum):
    """MAV_SEVERITY (common.xml)."""

    ALERT = 1
    CRITICAL = 2
    WARNING = 4
    NOTICE = 5


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
            self._order = order
            self._ordered_s = now_s
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
