"""The interface of all agents: from observations of a batch of missions to one action for each."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.features import INDEX

Observations = NDArray[np.float32]


class Policy(ABC):
    """Chooses actions for a batch of missions from their observations.

    Classes are abstract or final: to change the behaviour of one, wrap it.
    """

    @abstractmethod
    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission.

        Args:
            observations: float32, shape (n, features), see `homeward.envs.features.FEATURES`.
            begun: Missions that have just begun, whose memory is to be cleared, shape (n,); all of
                them in the first call and wherever n changes.

        Returns:
            Actions for the vector environment's step, shape (n, 3).
        """


def feature(observations: Observations, name: str) -> NDArray[np.float64]:
    """One column of observations by its name, float64, shape (n,)."""
    return observations[:, INDEX[name]].astype(np.float64)
