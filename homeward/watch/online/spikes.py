"""Live readings that no motion explains, by the same bounds as those of files
(`homeward.logs.plausible`)."""

from __future__ import annotations

from collections import deque

import numpy as np

from homeward.logs import thresholds
from homeward.logs.channels import MOTION

_SPEEDS = frozenset(name for names in MOTION for name in names)
_LEAST = thresholds.SPIKE_SAMPLES // 2 + 1
"""Readings from which a median is taken: a majority of those of a file."""


class Spikes:
    """Compares each reading with the median of those before it.

    A file's reading is compared with those around it as well. Live they have not come yet, so a
    value that stays is believed from the third reading on.

    Args:
        max_speed_mps: Top speed of the robot, m/s.

    Attributes:
        counts: Number of spikes by channel.
    """

    def __init__(self, max_speed_mps: float) -> None:
        self._fastest_mps = thresholds.FASTER_THAN_TOP * max_speed_mps
        # by channel: time and value, with spikes
        self._past: dict[str, deque[tuple[float, float]]] = {}
        self.counts: dict[str, int] = {}

    def see(self, channel: str, value: float, now_s: float) -> bool:
        """Whether a finite reading is a spike; it is counted.

        Args:
            channel: Its channel.
            value: Its value, SI.
            now_s: Time of receipt by a monotonic clock, s.
        """
        if channel not in thresholds.FASTEST_CHANGES:
            return False
        past = self._past.setdefault(channel, deque(maxlen=thresholds.SPIKE_SAMPLES))
        is_spike = len(past) >= _LEAST and self._is_spike(channel, value, now_s, np.array(past))
        past.append((now_s, value))
        count = self.counts.get(channel, 0)
        self.counts[channel] = count + 1 if is_spike else count
        return is_spike

    def _is_spike(self, channel: str, value: float, now_s: float, past: np.ndarray) -> bool:
        usual_s, usual = np.median(past, axis=0)
        largest_change = thresholds.FASTEST_CHANGES[channel] * max(
            now_s - usual_s, thresholds.SPIKE_S
        )
        is_too_fast = channel in _SPEEDS and abs(value) > self._fastest_mps >= abs(usual)
        return bool(abs(value - usual) > largest_change or is_too_fast)
