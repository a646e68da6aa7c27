"""Policies that never turn back, to tune and test the shield."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, Policy
from homeward.envs.actions import LEVELS, at_level, encode_actions, limits
from homeward.envs.options import Known
from homeward.envs.state import GO, STOP


@final
class Onward(Policy):
    """Drives on at cruise without sensing: only the shield turns it back, as late as possible."""

    def __init__(self, known: Known) -> None:
        self._action = encode_actions(known, known.shared["cruise_mps"][0], 0.0, GO)

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission, see `Policy.act`."""
        return np.repeat(self._action, len(observations), axis=0)


@final
class Wanderer(Policy):
    """Random speed, sensing rate and, in a tenth of decisions, a stop; it never turns back."""

    def __init__(self, known: Known, rng: np.random.Generator) -> None:
        self._known = known
        self._rng = rng

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission, see `Policy.act`."""
        count = len(observations)
        speed_levels, rate_levels = self._rng.integers(0, LEVELS, (2, count))
        speed_limits, rate_limits = limits(self._known)
        speed_mps = at_level(speed_levels, *speed_limits)
        sensing_hz = at_level(rate_levels, *rate_limits)
        # a tenth: chosen, so that it gets far
        mode = np.where(self._rng.random(count) < 0.1, STOP, GO)
        return encode_actions(self._known, speed_mps, sensing_hz, mode)
