"""The environments with a vector of rewards, for MO-Gymnasium and multi-objective learners."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from homeward.envs.scalar import HomewardEnv

OBJECTIVES = ("reward", "stranding", "energy", "time")
"""Entries of the vector, each to be maximised:

- `reward`: the reward of the environment with one objective: the score over that of a good mission,
  and its shaping.
- `stranding`: -1 when the robot strands, otherwise 0.
- `energy`: minus the energy drawn from the battery in the decision, over the usable energy of the
  robot's file.
- `time`: minus one decision, over the time limit.
"""


class MultiObjectiveEnv(HomewardEnv):
    """A mission whose reward is a vector, see `OBJECTIVES`; the weights (1, 0, 0, 0) give the
    scalar reward.

    `mo_gymnasium.make("homeward/MOSurvey-v0")` and `gymnasium.make` create it, by default without
    shaping, so that returns are the objectives themselves.

    Args:
        **options: As of `HomewardEnv`.

    Attributes:
        reward_space: `Box` of float32, shape (4,).

    Raises:
        OptionError: A keyword or value is not allowed.

    Example:
        >>> import gymnasium as gym, homeward
        >>> env = gym.make("homeward/MOOutAndBack-v0", difficulty="known")
        >>> _ = env.reset(seed=0)
        >>> _, rewards, terminated, truncated, info = env.step([4, 0, 1])  # top speed, no sensing, go
        >>> {name: round(float(one), 4) for name, one in zip(OBJECTIVES, rewards)}
        {'reward': 0.0, 'stranding': -0.0, 'energy': -0.0033, 'time': -0.0026}
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        low = np.array([-np.inf, -1.0, -np.inf, -1.0], np.float32)
        high = np.array([np.inf, 0.0, np.inf, 0.0], np.float32)
        self.reward_space = spaces.Box(low, high, dtype=np.float32)
        self.reward_dim = len(OBJECTIVES)
        shared = self.batch.known.shared[0]
        self._per_j = 1.0 / float(shared["usable_j"])
        self._per_decision = 1.0 / float(shared["max_decisions"])
        self._drawn_j = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin a new mission; raises as `HomewardEnv.reset`."""
        self._drawn_j = 0.0
        return super().reset(seed=seed, options=options)

    def step(  # type: ignore[override]  # the reward is a vector
        self, action: Any
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], bool, bool, dict[str, Any]]:
        """Carry out one decision; raises as `HomewardEnv.step`."""
        observation, reward, terminated, truncated, info = super().step(action)
        drawn_before_j = self._drawn_j
        self._drawn_j = info["energy_j"].total() - info["energy_j"]["below_cutoff"]
        energy = (drawn_before_j - self._drawn_j) * self._per_j
        rewards = np.array((reward, -info["cost"], energy, -self._per_decision), np.float32)
        return observation, rewards, terminated, truncated, info
