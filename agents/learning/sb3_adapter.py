"""The native vector environment as Stable-Baselines3 sees it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from homeward.agents.learning.guide import Guide
from homeward.agents.learning.insight import Insight
from homeward.envs.batch import INFO_KEYS
from homeward.envs.features import FEATURES, LIMIT
from homeward.envs.vector import HomewardVectorEnv


@dataclass(frozen=True)
class MissionLog:
    """How missions came to where they are: enough to drive them there again, with nothing of their memory.

    Attributes:
        generators: State of each mission's random generator when it began, JSON.
        lengths: Decisions of each mission so far, int64, shape (n,).
        actions: Those of the last decisions, as many as the longest mission has, shape (decisions, n, 3).
    """

    generators: list[Mapping[str, Any]]
    lengths: NDArray[np.int64]
    actions: NDArray[Any]


class SB3Adapter(VecEnv):
    """A `HomewardVectorEnv` behind the interface of Stable-Baselines3's vector environments.

    Missions that end begin anew in the same step; their entry of `infos` holds the mission's `info`, its
    `terminal_observation`, `TimeLimit.truncated`, `is_success` (home), and `episode` with return `r`, length `l` and
    time `t`, as Stable-Baselines3's `Monitor` writes them. The entries of missions that go on are empty.

    Args:
        env: Made with `autoreset_mode="SameStep"`.
        stranding_cost: Taken from the reward of a mission that strands.
        guide: What makes the learner's inputs from observations, if they are not the observations.
        late_is_lost: Whether the time limit ends a mission as stranding does: nothing is scored and nothing is left to
            hope for, as the time is observed and a part of the task. Else it truncates, as Gymnasium has it.
        insight: Whether the learner's inputs begin with what only the critic is to see; with `late_is_lost` only.

    Raises:
        ValueError: The environment resets in another way.
    """

    def __init__(
        self,
        env: HomewardVectorEnv,
        stranding_cost: float = 0.0,
        guide: Guide | None = None,
        *,
        late_is_lost: bool = False,
        insight: bool = False,
    ) -> None:
        if env.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode is {env.autoreset_mode.value}; make the environment with SameStep")
        self.env = env
        self._insight = Insight(env.batch) if insight else None
        self._around = Insight.columns if insight else 0, 0 if guide is None else guide.extra
        space = spaces.Box(-LIMIT, LIMIT, (len(FEATURES) + sum(self._around),), np.float32)
        super().__init__(env.num_envs, space, env.single_action_space)
        self._stranding_cost, self._guide, self._late_is_lost = stranding_cost, guide, late_is_lost
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, np.int64)
        self._start_s = time.time()
        decisions = int(env.batch.known.shared["max_decisions"][0])
        self._actions_before: deque[NDArray[Any]] = deque(maxlen=decisions)
        self._began_from: list[Mapping[str, Any]] = []
        self._begins_from: list[Mapping[str, Any]] = []

    def reset(self) -> NDArray[np.float32]:
        """Begin all missions, with the seeds given to `seed()` if there are any."""
        batch = self.env.batch
        if not batch.generators or any(seed is not None for seed in self._seeds):
            batch.generators = [seeding.np_random(seed)[0] for seed in self._seeds]
        self._reset_seeds()
        self._begins_from = [generator.bit_generator.state for generator in batch.generators]
        self._began_from = list(self._begins_from)
        self._actions_before.clear()
        return self._begin(np.ones(self.num_envs, np.bool_))

    @property
    def log(self) -> MissionLog:
        """How the missions came to where they are."""
        longest = int(self._lengths.max())
        actions = list(self._actions_before)[len(self._actions_before) - longest :]
        kept = np.array(actions, self.action_space.dtype).reshape(longest, self.num_envs, 3)
        return MissionLog(list(self._began_from), self._lengths.copy(), kept)

    def relive(self, log: MissionLog) -> NDArray[np.float32]:
        """Drive the missions of a log again, to where they were; what is inferred on the way is inferred anew.

        Returns:
            What the learner saw last.

        Raises:
            ValueError: The log is of other missions.
        """
        longest = len(log.actions)
        if log.actions.dtype != self.action_space.dtype or log.lengths.dtype != np.int64:
            raise ValueError(f"a log of {log.actions.dtype} actions and {log.lengths.dtype} lengths")
        if longest > (self._actions_before.maxlen or 0):
            raise ValueError(f"a log of {longest} decisions: no mission takes so many")
        if log.actions.shape != (longest, self.num_envs, 3) or log.lengths.shape != (self.num_envs,):
            raise ValueError(f"a log of {log.lengths.shape} missions and {log.actions.shape} actions does not fit")
        if len(log.generators) != self.num_envs or not ((log.lengths >= 0) & (log.lengths <= longest)).all():
            raise ValueError("a log of too few or too many decisions")
        inputs = self.reset()  # until a mission of the log begins, another one is driven in its place
        for decision in range(longest + 1):
            begins = log.lengths == longest - decision
            if begins.any():
                self._set_generators(log.generators, begins)
                inputs = self._begin(begins)
            if decision < longest:
                self.step_async(log.actions[decision])
                inputs = self._step()[0]
        return inputs

    def _begin(self, begins: NDArray[np.bool_]) -> NDArray[np.float32]:
        observations, _ = self.env.reset(options=None if begins.all() else {"reset_mask": begins})
        self._note_begin(begins)
        self._returns[begins] = 0.0
        self._lengths[begins] = 0
        return self._inputs(observations, begins)

    def _set_generators(self, states: Sequence[Mapping[str, Any]], chosen: NDArray[np.bool_]) -> None:
        generators = list(self.env.batch.generators)
        for i in np.flatnonzero(chosen).tolist():
            generators[i] = seeding.np_random(0)[0]
            generators[i].bit_generator.state = states[i]
            self._begins_from[i] = states[i]
        self.env.batch.generators = generators

    def _note_begin(self, begun: NDArray[np.bool_]) -> None:
        """Note what missions began from; as only their beginnings draw, that is the state after the one before."""
        for i in np.flatnonzero(begun).tolist():
            self._began_from[i] = self._begins_from[i]
            self._begins_from[i] = self.env.batch.generators[i].bit_generator.state

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step all missions."""
        return self._step()

    def _step(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        potentials = self.env.batch.records["potential"].copy()
        self._actions_before.append(np.array(self._actions))
        observations, rewards, terminated, truncated, info = self.env.step(self._actions)
        ended = terminated | truncated
        if "final_info" in info:
            rewards = rewards - self._stranding_cost * info["final_info"]["stranded"]
            if self._late_is_lost:
                rewards = np.where(truncated & ~terminated, -potentials, rewards)
                terminated = ended
        self._returns += rewards
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if "final_info" in info:
            last = observations.copy()
            last[ended] = np.stack(info["final_obs"][ended])
            if self._late_is_lost:  # nobody asks for its value: all but the observation is 0
                last = np.pad(last, ((0, 0), self._around))
            else:
                last = self._inputs(last, np.zeros(self.num_envs, np.bool_))
            for i in np.flatnonzero(ended).tolist():
                late = bool(truncated[i] and not terminated[i])
                infos[i] = self._final_info(info, i, last[i]) | {"TimeLimit.truncated": late}
            self._returns[ended] = 0.0
            self._lengths[ended] = 0
            self._note_begin(ended)
        return self._inputs(observations, ended), rewards.astype(np.float32), ended, infos

    def _inputs(self, observations: NDArray[np.float32], begun: NDArray[np.bool_]) -> NDArray[np.float32]:
        inputs = observations if self._guide is None else self._guide.inputs(observations, begun)
        return inputs if self._insight is None else np.concatenate((self._insight.see(begun), inputs), axis=1)

    def _final_info(self, info: dict[str, Any], i: int, last: NDArray[np.float32]) -> dict[str, Any]:
        final = info["final_info"]
        elapsed_s = round(time.time() - self._start_s, 6)
        return {
            **{key: _of_one(final[key], i) for key in INFO_KEYS},
            "terminal_observation": last,
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


def _of_one(values: Any, i: int) -> Any:
    """What one mission tells, of arrays or dictionaries of them."""
    return {name: one[i].item() for name, one in values.items()} if isinstance(values, dict) else values[i].item()
