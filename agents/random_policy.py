"""Acts at random: the least that any agent must beat."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, Policy
from homeward.envs.actions import encode_actions
from homeward.envs.options import Setting


@final
class RandomPolicy(Policy):
    """Draws speed, sensing rate and mode evenly, every decision anew.

    Args:
        setting: Constants of the environment.
        rng: Source of the draws.
    """

    def __init__(self, setting: Setting, rng: np.random.Generator) -> None:
        self._setting, self._rng = setting, rng

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action a mission, see `Policy.act`."""
        s, n = self._setting.shared[0], len(observations)
        speed_mps = self._rng.uniform(s["min_speed_mps"], s["max_speed_mps"], n)
        sensing_hz = self._rng.uniform(0.0, s["max_sensing_hz"], n)
        return encode_actions(self._setting, speed_mps, sensing_hz, self._rng.integers(0, 3, n))
