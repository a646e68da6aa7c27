"""The native vector environment as Stable-Baselines3 sees it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from homeward.envs.batch import INFO_KEYS
from homeward.envs.vector import HomewardVectorEnv


class SB3Adapter(VecEnv):
    """A `HomewardVectorEnv` behind the interface of Stable-Baselines3's vector environments.

    Missions that end begin anew in the same step; their entry of `infos` holds the mission's `info`, its
    `terminal_observation`, `TimeLimit.truncated`, `is_success` (home), and `episode` with return `r`, length `l` and
    time `t`, as Stable-Baselines3's `Monitor` writes them. The entries of missions that go on are empty.

    Args:
        env: Made with `autoreset_mode="SameStep"`.
        stranding_cost: Taken from the reward of a mission that strands.

    Raises:
        ValueError: The environment resets in another way.
    """

    def __init__(self, env: HomewardVectorEnv, stranding_cost: float = 0.0) -> None:
        if env.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode is {env.autoreset_mode.value}; make the environment with SameStep")
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self._stranding_cost = stranding_cost
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, np.int64)
        self._start_s = time.time()

    def reset(self) -> NDArray[np.float32]:
        """Begin all missions, with the seeds given to `seed()` if there are any."""
        observations, _ = self.env.reset(seed=self._seeds)
        self._reset_seeds()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step all missions."""
        observations, rewards, terminated, truncated, info = self.env.step(self._actions)
        if "final_info" in info:
            rewards = rewards - self._stranding_cost * info["final_info"]["stranded"]
        self._returns += rewards
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        dones = terminated | truncated
        if "final_info" in info:
            for i in np.flatnonzero(dones).tolist():
                infos[i] = self._final_info(info, i) | {"TimeLimit.truncated": bool(truncated[i] and not terminated[i])}
            self._returns[dones] = 0.0
            self._lengths[dones] = 0
        return observations, rewards.astype(np.float32), dones, infos

    def _final_info(self, info: dict[str, Any], i: int) -> dict[str, Any]:
        final = info["final_info"]
        elapsed_s = round(time.time() - self._start_s, 6)
        return {
            **{key: final[key][i].item() for key in INFO_KEYS if key != "energy_j"},
            "energy_j": {cause: joules[i].item() for cause, joules in final["energy_j"].items()},
            "terminal_observation": info["final_obs"][i],
            "is_success": bool(final["home"][i]),
            "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i]), "t": elapsed_s},
        }

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Attribute of the vector environment, once for each mission."""
        return [getattr(self.env, attr_name)] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Refused: missions share one environment.

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError("missions share one environment; set its attribute instead")

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **keywords: Any) -> list[Any]:
        """Refused: missions share one environment.

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError("missions share one environment; call its method instead")

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Whether each mission is wrapped: none is."""
        return [False] * len(self._chosen(indices))

    def _chosen(self, indices: VecEnvIndices) -> Sequence[int]:
        return list(self._get_indices(indices))
