"""The scalar environment: a batch of one mission."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from homeward.envs.actions import space_of, unflatten_actions
from homeward.envs.batch import Batch, EnergyLedger, info_of, observation_space
from homeward.envs.options import check_reset_options, parse_options
from homeward.envs.viewer.viewer import FRAMES_PER_S, MODES, Viewer


class HomewardEnv(gym.Env[NDArray[np.float32], NDArray[Any]]):
    """One mission: drive out, collect score, and be home before the battery is empty.

    Args:
        mission: `OutAndBack`, `Survey` or `Patrol`.
        render_mode: `None`, `human` (a window), `rgb_array` (a picture) or `ansi` (lines of text).
        **options: See `homeward.envs.options.Options`.

    Raises:
        OptionError: A keyword or value is not allowed.

    Example:
        >>> import gymnasium as gym, homeward
        >>> env = gym.make("homeward/Survey-v0", difficulty="known")
        >>> observation, info = env.reset(seed=0)
        >>> observation, reward, terminated, truncated, info = env.step([4, 2, 1])  # top speed, half rate, go
        >>> bool(abs(info["energy_j"].total() - info["energy_j"]["rolling"]) > 0)
        True
    """

    metadata = {"render_modes": list(MODES), "render_fps": FRAMES_PER_S}  # noqa: RUF012 (as Gymnasium has it)

    def __init__(
        self, *, mission: str = "Survey", render_mode: str | None = None, **options: Any
    ) -> None:
        self.render_mode = render_mode
        self.options = parse_options({"mission": mission, **options}, ("render_mode",))
        self.observation_space: Any = observation_space(bool(self.options.docks))
        self.action_space = space_of(self.options.action_type)
        self._flat = self.options.action_type == "flat"
        self.batch = Batch(self.options, 1)
        self._viewer: Viewer | None = None
        if render_mode is not None:
            self._viewer = Viewer(self.batch, render_mode)
        self._live = info_of(self.batch.records)
        self._first = np.ones(1, np.bool_)
        self._observation_shape = (1, *(self.observation_space.shape or ()))
        self._rewards = np.zeros(1)
        self._terminated = np.zeros(1, np.bool_)
        self._truncated = np.zeros(1, np.bool_)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin a new mission.

        Raises:
            OptionError: `options` are given: there are none.
        """
        check_reset_options(options)
        super().reset(seed=seed)
        generators = self.batch.generators
        if not generators or generators[0] is not self.np_random:
            self.batch.generators = [self.np_random]
        observations = np.empty(self._observation_shape, np.float32)
        self.batch.reset(self._first, observations)
        if self._viewer is not None:
            self._viewer.begin()
        return observations[0], self._info()

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Carry out one decision.

        Raises:
            OptionError: The action is not in the action space.
            gymnasium.error.ResetNeeded: No mission has begun, or it is over.
        """
        batch = self.batch
        if not batch.generators or batch.records["over"][0]:
            raise gym.error.ResetNeeded(
                "the mission is over or has not begun; call reset() before step()"
            )
        observations = np.empty(self._observation_shape, np.float32)
        actions = np.asarray(action)[None]
        parts = unflatten_actions(actions) if self._flat else actions
        batch.step(parts, observations, self._rewards, self._terminated, self._truncated)
        if self._viewer is not None:
            self._viewer.note()
        return (
            observations[0],
            self._rewards.item(),
            self._terminated.item(),
            self._truncated.item(),
            self._info(),
        )

    def render(self) -> NDArray[np.uint8] | str | None:
        """Show the mission as it is now, see `homeward.envs.viewer.Viewer.render`.

        Raises:
            gymnasium.error.ResetNeeded: No mission has begun.
        """
        if self._viewer is None:
            gym.logger.warn(
                "render() shows nothing without a render mode, as in gym.make(..., render_mode='rgb_array')"
            )
            return None
        if not self.batch.generators:
            raise gym.error.ResetNeeded("no mission has begun; call reset() before render()")
        return self._viewer.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._viewer is not None:
            self._viewer.close()

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_live": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._live = info_of(self.batch.records)  # views of the new records

    def _info(self) -> dict[str, Any]:
        live = self._live
        return {
            "energy_j": EnergyLedger(self.batch.records["ledger_j"][0].copy()),
            "reward_terms": {term: values.item() for term, values in live["reward_terms"].items()},
            "score": live["score"].item(),
            "cost": live["cost"].item(),
            "position_m": live["position_m"].item(),
            "home": live["home"].item(),
            "stranded": live["stranded"].item(),
        }
