"""Several batteries of a network: which are used is chosen as in bags, once, from what they report
at first."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from homeward.logs.bags.batteries import ADDED, Battery, choose
from homeward.logs.bags.topics import Topic
from homeward.logs.columns import RecordingError

_READINGS = 20
"""Readings of a battery that are kept for the choice. Chosen: bounds memory; a mean needs no
more."""

Readings = Mapping[str, float]
"""Values of the channels of a battery."""


class Batteries:
    """The batteries of one entry of a mapping, by the names of their topics."""

    def __init__(self, entry: Topic) -> None:
        self._entry = entry
        self._heard: dict[str, deque[Readings]] = {}
        self._used: tuple[str, ...] | None = None  # None until they are chosen
        self._alone: str | None = None  # the one that drew while no other did

    def hear(self, name: str, readings: Readings) -> None:
        """Keep what a battery reports."""
        self._heard.setdefault(name, deque(maxlen=_READINGS)).append(readings)

    def choose(self) -> str | None:
        """Choose, the first time that several report what is drawn; why, in a line.

        A robot on its way keeps the battery that it had, with a line: advice that ends there
        strands it.

        Raises:
            RecordingError: It is not clear which is the whole, from the first reading on.
        """
        if self._used is not None:
            return None
        reported = [self._battery(name) for name in self._heard]
        drawing = [battery for battery in reported if battery is not None]
        if len(drawing) < 2:
            self._alone = drawing[0].name if drawing else None
            return None
        try:
            choice = choose(drawing, self._entry.several)
        except RecordingError as error:
            if self._alone is None:
                raise
            self._used = (self._alone,)
            return f"{error}; until then {self._alone}, which drew alone before, is used"
        self._used = choice.names
        return choice.why

    def value(self, name: str, channel: str, value: float) -> float:
        """The value of a channel when a battery reports it: NaN if others are used, or are added
        with its first."""
        if self._used is None or self._used == (name,):
            return value
        if name != self._used[0]:
            return math.nan
        latest = [self._heard[pack][-1].get(channel, math.nan) for pack in self._used]
        total = sum(latest)
        return total if channel in ADDED else total / len(latest)

    def _battery(self, name: str) -> Battery | None:
        """What a battery reported; None if that is nothing drawn."""
        heard = self._heard[name]
        drawn = np.array(
            [readings.get("current_a", readings.get("power_w", math.nan)) for readings in heard]
        )
        if not np.nan_to_num(drawn).any():
            return None
        voltage_v = np.array([readings.get("voltage_v", math.nan) for readings in heard])
        return Battery(name, voltage_v, drawn)
