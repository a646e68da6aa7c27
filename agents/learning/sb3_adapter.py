"""The native vector environment with the interface of Stable-Baselines3."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from homeward.agents.trained.inputs import COLUMNS, BeliefInputs
from homeward.agents.trained.policy_file import sensing_on_the_go
from homeward.envs.batch import INFO_KEYS
from homeward.envs.features import FEATURES, LIMIT
from homeward.envs.vector import HomewardVectorEnv


class SB3Adapter(VecEnv):
    """A `HomewardVectorEnv` behind the interface of Stable-Baselines3's vector environments.

    Ended missions restart in the same step. Their entry of `infos` has the mission's `info`, its
    `terminal_observation`, `TimeLimit.truncated`, `is_success` (home), and `episode` with return `r`, length `l` and
    time `t`, as Stable-Baselines3's `Monitor` writes them. The entries of other missions are empty.

    Args:
        env: Made with `autoreset_mode="SameStep"`.
        stranding_cost: Subtracted from the reward of a mission that strands.
        inputs: Computes the learner's inputs from observations, if they are not the observations.
        late_is_lost: Whether the time limit ends a mission as stranding does, with a score of 0 and no value to
            bootstrap: the time is observed and is a part of the task. Otherwise it truncates, as in Gymnasium. With
            `inputs` it is always lost.
        senses_on_the_go: Whether a robot that stops or heads home does not sense, see `sensing_on_the_go`.

    Raises:
        ValueError: The environment resets in another way, or `late_is_lost` is False with `inputs`.
    """

    def __init__(
        self,
        env: HomewardVectorEnv,
        stranding_cost: float = 0.0,
        inputs: BeliefInputs | None = None,
        *,
        late_is_lost: bool = False,
        senses_on_the_go: bool = False,
    ) -> None:
        if env.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode is {env.autoreset_mode.value}; make the environment with SameStep")
        if inputs is not None and not late_is_lost:
            raise ValueError("late_is_lost = False is not possible with inputs; leave it out")
        self.env = env
        columns = len(FEATURES) + (0 if inputs is None else len(COLUMNS))
        space = spaces.Box(-LIMIT, LIMIT, (columns,), np.float32)
        super().__init__(env.num_envs, space, env.single_action_space)
        self._stranding_cost, self._inputs, self._late_is_lost = stranding_cost, inputs, late_is_lost
        self._senses_on_the_go = senses_on_the_go
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, np.int64)
        self._start_s = time.time()

    def reset(self) -> NDArray[np.float32]:
        """Begin all missions, with the seeds given to `seed()` if there are any."""
        batch = self.env.batch
        if not batch.generators or any(seed is not None for seed in self._seeds):
            batch.generators = [seeding.np_random(seed)[0] for seed in self._seeds]
        self._reset_seeds()
        observations, _ = self.env.reset()
        self._returns[:], self._lengths[:] = 0.0, 0
        return self._seen(observations, np.ones(self.num_envs, np.bool_))

    def begin(self, which: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Restart the missions of a mask of shape (num_envs,), whatever their state; the others wait."""
        observations, _ = self.env.reset(options={"reset_mask": which})
        self._returns[which], self._lengths[which] = 0.0, 0
        return self._seen(observations, which)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Store the actions of the next step."""
        self._actions = sensing_on_the_go(np.asarray(actions)) if self._senses_on_the_go else actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step all missions."""
        potentials = self.env.batch.records["potential"].copy()
        observations, rewards, terminated, truncated, info = self.env.step(self._actions)
        ended = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if "final_info" in info:
            rewards = rewards - self._stranding_cost * info["final_info"]["stranded"]
            if self._late_is_lost:
                rewards = np.where(truncated & ~terminated, -potentials, rewards)
                truncated = terminated
        self._returns += rewards
        self._lengths += 1
        for i in np.flatnonzero(ended).tolist():
            late = bool(truncated[i] and not terminated[i])
            infos[i] = self._final_info(info, i) | {"TimeLimit.truncated": late}
        self._returns[ended], self._lengths[ended] = 0.0, 0
        return self._seen(observations, ended), rewards.astype(np.float32), ended, infos

    def _seen(self, observations: NDArray[np.float32], begun: NDArray[np.bool_]) -> NDArray[np.float32]:
        return observations if self._inputs is None else self._inputs(observations, begun)

    def _final_info(self, info: dict[str, Any], i: int) -> dict[str, Any]:
        final = info["final_info"]
        elapsed_s = round(time.time() - self._start_s, 6)
        return {
            **{key: _of_one(final[key], i) for key in INFO_KEYS},
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
        """Refused (NotImplementedError): missions share one environment."""
        raise NotImplementedError("missions share one environment; set its attribute instead")

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **keywords: Any) -> list[Any]:
        """Refused (NotImplementedError): missions share one environment."""
        raise NotImplementedError("missions share one environment; call its method instead")

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Whether each mission is wrapped: none is."""
        return [False] * len(self._chosen(indices))

    def _chosen(self, indices: VecEnvIndices) -> Sequence[int]:
        return list(self._get_indices(indices))


def _of_one(values: Any, i: int) -> Any:
    """The values of one mission, from arrays or dictionaries of them."""
    return {name: one[i].item() for name, one in values.items()} if isinstance(values, dict) else values[i].item()
