"""A model of Stable-Baselines3 as an agent, so that it is compared like any other."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm

from homeward.agents.base import Observations, Policy
from homeward.envs.actions import unflatten_actions


@final
class SB3Policy(Policy):
    """Acts as a model of Stable-Baselines3 that observes missions and nothing else.

    Args:
        model: The model, such as a trained `PPO`; of flat actions, this policy gives the three
            parts.
        greedy: Whether it takes the most probable action; otherwise it samples one.
    """

    def __init__(self, model: BaseAlgorithm, greedy: bool = True) -> None:
        self._model, self._greedy = model, greedy

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission, see `Policy.act`."""
        actions, _ = self._model.predict(observations, deterministic=self._greedy)
        return (
            unflatten_actions(actions)
            if isinstance(self._model.action_space, spaces.Discrete)
            else actions
        )
