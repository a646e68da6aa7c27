"""The native vector environment with the interface of Stable-Baselines3."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from homeward.agents.trained.inputs import COLUMNS, BeliefInputs
from homeward.agents.trained.policy_file import sensing_on_the_go
from homeward.envs.batch import INFO_KEYS
from homeward.envs.features import LIMIT, names_of
from homeward.envs.vector import HomewardVectorEnv

AnyVectorEnv = VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]


class SB3Adapter(VecEnv):
    """A `HomewardVectorEnv` behind the interface of Stable-Baselines3's vector environments.

    Ended missions restart in the same step. Their entry of `infos` has the mission's `info`, its
    `terminal_observation`, `TimeLimit.truncated`, `is_success` (home), and `episode` with return
    `r`, length `l` and time `t`, as Stable-Baselines3's `Monitor` writes them. The entries of other
    missions hold `info_keys`.

    Args:
        env: A `HomewardVectorEnv` made with `autoreset_mode="SameStep"` or, for Gymnasium's
            wrappers of observations, which refuse that, `"Disabled"`; or Gymnasium's vector
            wrappers around one.
        stranding_cost: Subtracted from the reward of a mission that strands, as it is after
            wrappers.
        inputs: Computes the learner's inputs from observations, if they are not the observations.
        late_is_lost: Whether the time limit ends a mission as stranding does, with a score of 0 and
            no value to bootstrap: the time is observed and is a part of the task. Otherwise it
            truncates, as in Gymnasium, and a mission that stays at home loses nothing. With
            `inputs` it is always lost. Terms that wrappers add stay; wrappers that scale the reward
            do not scale this loss.
        senses_on_the_go: Whether a robot that stops or heads home does not sense, see
            `sensing_on_the_go`.
        info_keys: Keys of the environment's `info` that `infos` also hold while missions go on;
            each takes time.

    Raises:
        ValueError: The environment resets in another way, `late_is_lost` is False with `inputs`, a
            wrapper or flat actions change what `inputs` or `senses_on_the_go` need, or a key is no
            key of `info`.
    """

    def __init__(
        self,
        env: AnyVectorEnv,
        stranding_cost: float = 0.0,
        inputs: BeliefInputs | None = None,
        *,
        late_is_lost: bool = False,
        senses_on_the_go: bool = False,
        info_keys: Sequence[str] = (),
    ) -> None:
        missions = env.unwrapped
        if not isinstance(missions, HomewardVectorEnv):
            raise ValueError(
                f"{missions} is no HomewardVectorEnv; make one, or use Stable-Baselines3's own wrappers"
            )
        if missions.autoreset_mode is AutoresetMode.NEXT_STEP:
            mode = missions.autoreset_mode.value
            raise ValueError(
                f"autoreset_mode is {mode}; make the environment with SameStep, or Disabled"
            )
        if inputs is not None and not late_is_lost:
            raise ValueError("late_is_lost = False is not possible with inputs; leave it out")
        if inputs is not None and env.single_observation_space != missions.single_observation_space:
            raise ValueError(
                "inputs need the observations of the missions; leave out the wrapper that changes them"
            )
        if senses_on_the_go and isinstance(env.single_action_space, spaces.Discrete):
            raise ValueError(
                "senses_on_the_go needs the three parts of an action; choose action_type 'discrete'"
            )
        for key in info_keys:
            if key not in INFO_KEYS:
                raise ValueError(f"info_keys has {key!r}; choose from {', '.join(INFO_KEYS)}")
        self.env = env
        self.missions = missions
        space = env.single_observation_space
        if inputs is not None:
            features = len(names_of(bool(missions.options.docks)))
            space = spaces.Box(-LIMIT, LIMIT, (features + len(COLUMNS),), np.float32)
        super().__init__(env.num_envs, space, env.single_action_space)
        self._stranding_cost = stranding_cost
        self._inputs = inputs
        self._late_is_lost = late_is_lost
        self._senses_on_the_go = senses_on_the_go
        self._info_keys = tuple(info_keys)
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, np.int64)
        self._start_s = time.time()

    @property
    def as_missions(self) -> bool:
        """Whether observations and actions are those of the missions: no wrapper or input changes
        their spaces."""
        missions = self.missions
        spaces_of_one = missions.single_observation_space, missions.single_action_space
        return (self.observation_space, self.action_space) == spaces_of_one

    def reset(self) -> NDArray[np.float32]:
        """Begin all missions, with the seeds given to `seed()` if there are any."""
        batch = self.missions.batch
        if not batch.generators or any(seed is not None for seed in self._seeds):
            batch.generators = [seeding.np_random(seed)[0] for seed in self._seeds]
        self._reset_seeds()
        observations, _ = self.env.reset()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return self._seen(observations, np.ones(self.num_envs, np.bool_))

    def begin(self, which: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Restart the missions of a mask of shape (num_envs,), whatever their state; the others
        wait."""
        observations, _ = self.env.reset(options={"reset_mask": which})
        self._returns[which] = 0.0
        self._lengths[which] = 0
        return self._seen(observations, which)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Store the actions of the next step."""
        if self._senses_on_the_go:
            actions = sensing_on_the_go(np.asarray(actions))
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step all missions."""
        potentials = self.missions.batch.records["potential"].copy()
        observations, rewards, terminated, truncated, info = self.env.step(self._actions)
        ended = terminated | truncated
        step_info = info.get("final_info", info)  # after the decision, before missions restart
        last_observations = info.get("final_obs", observations)
        if ended.any():
            rewards = rewards - self._stranding_cost * (step_info["stranded"] & ended)
            if self._late_is_lost:
                late = truncated & ~terminated
                rewards = np.where(
                    late, rewards - step_info["reward_terms"]["shaping"] - potentials, rewards
                )
                truncated = terminated
        self._returns += rewards
        self._lengths += 1
        infos = self._infos(step_info)
        for i in np.flatnonzero(ended).tolist():
            cut_off = bool(truncated[i] and not terminated[i])
            infos[i] = self._final_info(step_info, last_observations, i) | {
                "TimeLimit.truncated": cut_off
            }
        self._returns[ended] = 0.0
        self._lengths[ended] = 0
        if ended.any() and self.missions.autoreset_mode is AutoresetMode.DISABLED:
            observations, _ = self.env.reset(options={"reset_mask": ended})
        return self._seen(observations, ended), rewards.astype(np.float32), ended, infos

    def _seen(
        self, observations: NDArray[np.float32], begun: NDArray[np.bool_]
    ) -> NDArray[np.float32]:
        """Observations as the policy gets them."""
        if self._inputs is None:
            return observations
        return self._inputs(observations, begun)

    def _infos(self, step_info: dict[str, Any]) -> list[dict[str, Any]]:
        """The chosen keys of `info`, for each mission."""
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for key in self._info_keys:
            for info, value in zip(infos, _of_each(step_info[key]), strict=True):
                info[key] = value
        return infos

    def _final_info(
        self, step_info: dict[str, Any], last_observations: Any, i: int
    ) -> dict[str, Any]:
        elapsed_s = round(time.time() - self._start_s, 6)
        return {
            **{key: _of_one(step_info[key], i) for key in INFO_KEYS},
            "terminal_observation": last_observations[i],
            "is_success": bool(step_info["home"][i]),
            "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i]), "t": elapsed_s},
        }

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Attribute of the vector environment, its wrappers first, once for each mission."""
        layer: Any = self.env
        while layer is not self.missions and not hasattr(layer, attr_name):
            layer = layer.env
        return [getattr(layer, attr_name)] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Refused (NotImplementedError): missions share one environment."""
        raise NotImplementedError("missions share one environment; set its attribute instead")

    def env_method(
        self, method_name: str, *args: Any, indices: VecEnvIndices = None, **keywords: Any
    ) -> list[Any]:
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
    if isinstance(values, dict):
        return {name: column[i].item() for name, column in values.items()}
    return values[i].item()


def _of_each(values: Any) -> list[Any]:
    """The values of all missions, from an array or a dictionary of arrays: one entry a mission."""
    if not isinstance(values, dict):
        return list(values.tolist())
    columns = [column.tolist() for column in values.values()]
    return [dict(zip(values, row, strict=True)) for row in zip(*columns, strict=True)]
