"""The native vector environment: all missions in one compiled step."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from homeward.envs.actions import space_of, unflatten_actions
from homeward.envs.batch import INFO_KEYS, Batch, info_of, observation_space
from homeward.envs.options import OptionError, check_reset_options, parse_options


class HomewardVectorEnv(VectorEnv[NDArray[np.float32], NDArray[Any], NDArray[Any]]):
    """Missions side by side; equal, step for step, to scalar environments with the same seeds.

    The arrays in `info` are read-only views of the running missions: copy what you keep beyond the
    next step.

    Args:
        num_envs: Number of missions.
        mission: `OutAndBack`, `Survey` or `Patrol`.
        autoreset_mode: A `gymnasium.vector.AutoresetMode` or its value.
        render_mode: Only `None`; render the scalar environment.
        **options: See `homeward.envs.options.Options`.

    Raises:
        OptionError: A keyword or value is not allowed.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012 (as Gymnasium has it)

    def __init__(
        self,
        num_envs: int = 1,
        *,
        mission: str = "Survey",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: None = None,
        **options: Any,
    ) -> None:
        if not isinstance(num_envs, int) or num_envs < 1:
            raise OptionError(
                f"num_envs = {num_envs!r} is not allowed; give a whole number of at least 1"
            )
        if render_mode is not None:
            raise OptionError(
                f"render_mode = {render_mode!r} is not allowed here; render a scalar environment"
            )
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError:
            modes = ", ".join(mode.value for mode in AutoresetMode)
            raise OptionError(
                f"autoreset_mode = {autoreset_mode!r} is not allowed; choose from {modes}"
            ) from None
        self.metadata = {**type(self).metadata, "autoreset_mode": self.autoreset_mode}
        self.options = parse_options(
            {"mission": mission, **options}, ("num_envs", "autoreset_mode", "render_mode")
        )
        self.num_envs = num_envs
        self.render_mode = None
        self.single_observation_space = observation_space(bool(self.options.docks))
        self.single_action_space = space_of(self.options.action_type)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.batch = Batch(self.options, num_envs)
        self._flat = self.options.action_type == "flat"
        self._over = np.zeros(num_envs, np.bool_)
        self._any_over = False
        self._everyone = np.ones(num_envs, np.bool_)
        self._last_observations: NDArray[np.float32] | None = None
        self._live = self._live_info()
        self._observation_shape = (num_envs, *(self.single_observation_space.shape or ()))

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin new missions, all or those of `options["reset_mask"]`.

        Args:
            seed: One seed (environment i uses `seed + i`), or one for each mission.
            options: `reset_mask`, bool of shape (num_envs,): which missions to restart.

        Raises:
            OptionError: The seeds or the mask have the wrong length or type, or an option is not
                known.
        """
        check_reset_options(options, ("reset_mask",))
        restarts = self._restarts(options)
        self._seed(seed, restarts)
        observations = np.empty(self._observation_shape, np.float32)
        if self._last_observations is not None:
            observations[:] = self._last_observations
        self.batch.reset(restarts, observations)
        self._over[restarts] = False
        self._any_over = bool(self._over.any())
        self._last_observations = observations
        return observations, self._info()

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[
        NDArray[np.float32],
        NDArray[np.float64],
        NDArray[np.bool_],
        NDArray[np.bool_],
        dict[str, Any],
    ]:
        """Step all missions; finished ones restart as the autoreset mode says.

        Raises:
            OptionError: An action is not in the action space, or with autoreset disabled a mission
                is over.
            gymnasium.error.ResetNeeded: No mission has begun.
        """
        if not self.batch.generators:
            raise ResetNeeded("no mission has begun; call reset() before step()")
        count = self.num_envs
        observations = np.empty(self._observation_shape, np.float32)
        rewards = np.empty(count)
        terminated = np.empty(count, np.bool_)
        truncated = np.empty(count, np.bool_)
        if self._any_over and self.autoreset_mode is AutoresetMode.DISABLED:
            over = np.flatnonzero(self._over).tolist()
            raise OptionError(
                f"missions {over} are over; reset them with options={{'reset_mask': mask}} before the step"
            )
        if self._flat:
            actions = unflatten_actions(actions, count)
        # In the mode next-step, missions that ended in the step before begin anew in this one.
        begin = self._over if self._any_over else None
        ended = self.batch.step(actions, observations, rewards, terminated, truncated, begin)
        info = self._info()
        if ended or self._any_over:
            self._any_over = ended > 0
            np.logical_or(terminated, truncated, out=self._over)
            if ended and self.autoreset_mode is AutoresetMode.SAME_STEP:
                self._reset_at_once(observations, info)
        self._last_observations = observations
        return observations, rewards, terminated, truncated, info

    def _restarts(self, options: dict[str, Any] | None) -> NDArray[np.bool_]:
        """Which missions a reset restarts, shape (num_envs,)."""
        if not options or "reset_mask" not in options:
            return self._everyone
        mask = np.asarray(options["reset_mask"])
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise OptionError(
                f"reset_mask must be a bool array of shape ({self.num_envs},) with at least one True"
            )
        if not self.batch.generators:
            raise OptionError(
                "a reset_mask needs missions that have begun; call reset() without one first"
            )
        return mask

    def _seed(self, seed: int | Sequence[int | None] | None, restarts: NDArray[np.bool_]) -> None:
        seeds = self._one_each(seed)
        if self.batch.generators and all(generator_seed is None for generator_seed in seeds):
            return
        generators = list(self.batch.generators) or [
            seeding.np_random(generator_seed)[0] for generator_seed in seeds
        ]
        for i in np.flatnonzero(restarts):
            if seeds[i] is not None:
                generators[i] = seeding.np_random(seeds[i])[0]
        self.batch.generators = generators

    def _one_each(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        numbers: Sequence[int | None]
        try:
            numbers = (
                [seed + i for i in range(self.num_envs)]
                if isinstance(seed, int | np.integer)
                else seed
            )
            seeds = [None if number is None else operator.index(number) for number in numbers]
        except TypeError:
            raise OptionError(
                f"seed = {seed!r} is not allowed; give a whole number, or one a mission"
            ) from None
        if len(seeds) != self.num_envs:
            raise OptionError(
                f"{len(seeds)} seeds were given for {self.num_envs} missions; give one each"
            )
        if any(number is not None and number < 0 for number in seeds):
            raise OptionError(f"seed = {seed!r} is not allowed; seeds are not negative")
        return seeds

    def _reset_at_once(self, observations: NDArray[np.float32], info: dict[str, Any]) -> None:
        """Same-step mode: keep the results of the ended missions, and restart them."""
        over = np.flatnonzero(self._over)
        final = np.full(self.num_envs, None, dtype=object)
        for i in over:
            final[i] = observations[i].copy()
        mask = self._over.copy()
        info["final_obs"] = final
        info["_final_obs"] = mask
        info["final_info"] = info_of(self.batch.records, live=False) | {
            f"_{key}": mask for key in INFO_KEYS
        }
        info["_final_info"] = mask
        self.batch.reset(mask, observations)
        self._over[:] = False
        self._any_over = False

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_live": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._live = self._live_info()  # views of the new records

    def _live_info(self) -> dict[str, Any]:
        everyone = np.ones(self.num_envs, np.bool_)
        everyone.flags.writeable = False
        return info_of(self.batch.records) | {f"_{key}": everyone for key in INFO_KEYS}

    def _info(self) -> dict[str, Any]:
        return dict(self._live)
