"""Acts at random: the least that any agent must beat."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from homeward.agents.base import Observations, Policy


@final
class RandomPolicy(Policy):
    """Draws from the whole action space evenly, every decision anew.

    A third of the draws are returns: it heads home as often as not, and for good once enough of them come in a row.

    Args:
        action_space: Space of one action: `MultiDiscrete` or `Box`.
        rng: Source of the draws.
    """

    def __init__(self, action_space: spaces.Space[Any], rng: np.random.Generator) -> None:
        self._space, self._rng = action_space, rng

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action a mission, see `Policy.act`."""
        shape = (len(observations), *(self._space.shape or ()))
        if isinstance(self._space, spaces.MultiDiscrete):
            return self._rng.integers(0, self._space.nvec, shape)
        assert isinstance(self._space, spaces.Box)
        return self._rng.uniform(self._space.low, self._space.high, shape).astype(np.float32)
