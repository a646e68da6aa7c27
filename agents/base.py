"""The interface of all agents: observations of a batch of missions in, one action for each out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.features import INDEX

Observations = NDArray[np.float32]


class Policy(ABC):
    """Decides for a batch of missions from what their robots can know.

    Classes are abstract or final: to change what one does, wrap it.
    """

    @abstractmethod
    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action a mission.

        Args:
            observations: float32, shape (n, features), see `homeward.envs.features.FEATURES`.
            begun: Missions that have just begun, whose memory is to be cleared, shape (n,); all of them at the first
                call and wherever n changes.

        Returns:
            Actions for the vector environment's step, shape (n, 3).
        """


def feature(observations: Observations, name: str) -> NDArray[np.float64]:
    """One column of observations by its name, float64, shape (n,)."""
    return observations[:, INDEX[name]].astype(np.float64)
