"""A batch of missions: the records, one random generator each, and the calls into the kernel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numba
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from homeward.envs import kernel
from homeward.envs.features import FEATURES, LIMIT, OBSERVATION_DTYPE
from homeward.envs.options import OptionError, Options, settle
from homeward.envs.state import MISSION_DTYPE, ROUTE_DTYPE
from homeward.physics.jit import announce_first_compilation
from homeward.physics.kernel import CAUSES, ROBOT_STATE_DTYPE
from homeward.physics.robot import ROBOT_DTYPE

_PARALLEL_FROM = 256
"""Missions from which two threads are faster than one."""

_NO_CHOICES, _NO_LEVELS = np.empty((0, 3), np.int64), np.empty((0, 3), np.float32)


class EnergyLedger(Mapping[str, Any]):
    """Energy that left the battery, J, by cause: a mapping over an array of shape (..., len(CAUSES))."""

    __slots__ = ("joules",)

    def __init__(self, joules: NDArray[np.float64]) -> None:
        self.joules = joules

    def __getitem__(self, cause: str) -> Any:
        return self.joules[..., _COLUMN[cause]]

    def __iter__(self) -> Iterator[str]:
        return iter(CAUSES)

    def __len__(self) -> int:
        return len(CAUSES)

    def total(self) -> Any:
        """Sum over all causes, J: what the battery has lost."""
        return self.joules.sum(axis=-1)


_COLUMN = {cause: column for column, cause in enumerate(CAUSES)}


INFO_KEYS = ("energy_j", "score", "cost", "position_m", "home", "stranded")
"""Keys of `info`, of the scalar and the vector environments."""


def info_of(records: NDArray[np.void]) -> dict[str, Any]:
    """Views of what missions tell in `info`: arrays of shape (n,), and the energy ledger."""
    return {
        "energy_j": EnergyLedger(records["ledger_j"]),
        "score": records["score"],
        "cost": records["cost"],
        "position_m": records["position_m"],
        "home": records["home"],
        "stranded": records["depleted"],
    }


def action_space(options: Options) -> spaces.Space[Any]:
    """Space of one action: speed, sensing rate, and stop / go / return."""
    if options.action_type == "discrete":
        return spaces.MultiDiscrete([kernel.LEVELS, kernel.LEVELS, 3])
    return spaces.Box(-1.0, 1.0, (3,), np.float32)


def observation_space() -> spaces.Box:
    """Space of one observation, see `homeward.envs.features.FEATURES`."""
    return spaces.Box(-LIMIT, LIMIT, (len(FEATURES),), np.float32)


class Batch:
    """Missions of one setting, side by side."""

    def __init__(self, options: Options, count: int) -> None:
        announce_first_compilation()
        self.options = options
        self.setting = settle(options)
        self.count = count
        self.records = np.zeros(count, MISSION_DTYPE)
        self._robots = np.full(count, self.setting.robot.record()[0], ROBOT_DTYPE)
        self._routes = np.zeros(count, ROUTE_DTYPE)
        self._nominals = self.setting.robot.record()
        self._beliefs = np.zeros(count, ROBOT_STATE_DTYPE)
        self._generators: list[np.random.Generator] = []
        self._typed_generators: Any = None
        self._step = kernel.step_in_parallel if count >= _PARALLEL_FROM else kernel.step_in_turn
        self._discrete = options.action_type == "discrete"
        self._action_shape = (count, 3)

    def __getstate__(self) -> dict[str, Any]:
        # numba's lists and functions do not travel; both are rebuilt.
        return self.__dict__ | {"_typed_generators": None, "_step": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._step = kernel.step_in_parallel if self.count >= _PARALLEL_FROM else kernel.step_in_turn

    @property
    def generators(self) -> Sequence[np.random.Generator]:
        """One random generator a mission."""
        return self._generators

    @generators.setter
    def generators(self, generators: Sequence[np.random.Generator]) -> None:
        self._generators = list(generators)
        self._typed_generators = None

    @property
    def robots(self) -> NDArray[np.void]:
        """True robots, `ROBOT_DTYPE`, shape (count,): hidden from agents, for planners with full knowledge."""
        return self._robots

    @property
    def routes(self) -> NDArray[np.void]:
        """Routes, `ROUTE_DTYPE`, shape (count,); a setting says how many of their places are used."""
        return self._routes

    def reset(self, indices: NDArray[np.int64], observations: NDArray[np.float32]) -> None:
        """Begin new missions at some indices and write their observations."""
        if self._typed_generators is None:
            self._typed_generators = numba.typed.List(self._generators)
        rows = np.ndarray(self.count, OBSERVATION_DTYPE, observations)
        kernel.reset_missions(
            indices, self._typed_generators, self.records, self._robots, self._routes, self._nominals, self._beliefs,
            self.setting.shared, rows, self.setting.fixed, self.setting.day,
        )  # fmt: skip

    def step(
        self,
        actions: Any,
        observations: NDArray[np.float32],
        rewards: NDArray[np.float64],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
    ) -> int:
        """Step every mission that is not over; write the results and return how many ended.

        Raises:
            OptionError: An action is not in the action space; no mission was stepped.
        """
        choices, levels = _NO_CHOICES, _NO_LEVELS
        if self._discrete:
            choices = self._as_actions(actions, np.int64)
        else:
            levels = self._as_actions(actions, np.float32)
        rows = np.ndarray(self.count, OBSERVATION_DTYPE, observations)
        ended: int = self._step(
            choices, levels, self.records, self._robots, self._routes, self._nominals, self._beliefs,
            self.setting.shared, rows, rewards, terminated, truncated,
        )  # fmt: skip
        if ended < 0:
            self._refuse(actions, -1 - ended)
        return ended

    def _as_actions(self, actions: Any, dtype: Any) -> Any:
        array = np.asarray(actions)
        if array.shape != self._action_shape:
            raise OptionError(f"actions have shape {array.shape}; give {self._action_shape}")
        if array.dtype != dtype:
            if array.dtype.kind not in ("iu" if dtype is np.int64 else "iuf"):
                raise OptionError(f"actions have dtype {array.dtype}; give {np.dtype(dtype)}")
            with np.errstate(over="ignore"):  # infinity is refused as any number beyond the bounds
                array = array.astype(dtype)
        return np.ascontiguousarray(array)

    def _refuse(self, actions: Any, index: int) -> None:
        allowed = (
            f"speed and sensing levels 0 to {kernel.LEVELS - 1} and 0 (stop), 1 (go) or 2 (return)"
            if self._discrete
            else "three numbers within [-1, 1]"
        )
        raise OptionError(f"action {np.asarray(actions)[index].tolist()} of env {index} is not allowed; give {allowed}")
