"""Random actions: a lower baseline."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from homeward.agents.base import Observations, Policy


@final
class RandomPolicy(Policy):
    """Samples uniformly from the whole action space, independently at every decision.

    A third of the samples are returns, which become final once enough of them come in a row.

    Args:
        action_space: Space of one action: `MultiDiscrete` or `Box`.
        rng: Random generator.
    """

    def __init__(self, action_space: spaces.Space[Any], rng: np.random.Generator) -> None:
        self._space = action_space
        self._rng = rng

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission, see `Policy.act`."""
        shape = (len(observations), *(self._space.shape or ()))
        if isinstance(self._space, spaces.MultiDiscrete):
            return self._rng.integers(0, self._space.nvec, shape)
        assert isinstance(self._space, spaces.Box)
        return self._rng.uniform(self._space.low, self._space.high, shape).astype(np.float32)
