"""A batch of missions: the records, one random generator each, and the calls of the kernel."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numba
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from homeward.envs import kernel, reward
from homeward.envs.actions import allowed_actions
from homeward.envs.docks import observe_docks
from homeward.envs.features import FEATURES, LIMIT, OBSERVATION_DTYPE, names_of
from homeward.envs.options import OptionError, Options, constants_of
from homeward.envs.state import CONSTANTS_DTYPE, MISSION_DTYPE, ROUTE_DTYPE
from homeward.envs.threads import Threads
from homeward.physics.jit import announce_compilation, uninterrupted
from homeward.physics.kernel import CAUSES
from homeward.physics.robot import ROBOT_DTYPE

_CACHE_LINE = 64  # bytes; of x86-64 and most ARM cores
_NO_CHOICES, _NO_LEVELS = np.empty((0, 3), np.int64), np.empty((0, 3), np.float32)


def _by_cache_lines(count: int, dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """Zeros that begin at a cache line of the processor."""
    room = np.zeros(count * dtype.itemsize + _CACHE_LINE, np.uint8)
    start = -room.ctypes.data % _CACHE_LINE
    return room[start : start + count * dtype.itemsize].view(dtype)


class EnergyLedger(Mapping[str, float]):
    """Energy that left the battery, J, by cause: a mapping over an array, because filling a
    dictionary is slow.

    Args:
        joules: Energy of each cause, J, shape (len(CAUSES),).
    """

    __slots__ = ("joules",)

    def __init__(self, joules: NDArray[np.float64]) -> None:
        self.joules = joules

    def __getitem__(self, cause: str) -> float:
        return float(self.joules[_COLUMN[cause]])

    def __iter__(self) -> Iterator[str]:
        return iter(CAUSES)

    def __len__(self) -> int:
        return len(CAUSES)

    def __repr__(self) -> str:
        return repr(dict(zip(CAUSES, self.joules.tolist(), strict=True)))

    def total(self) -> float:
        """Sum over all causes, J: the energy that the battery has lost."""
        return float(self.joules.sum())


_COLUMN = {cause: column for column, cause in enumerate(CAUSES)}


INFO_KEYS = ("energy_j", "reward_terms", "score", "cost", "position_m", "home", "stranded")
"""Keys of `info`, of the scalar and the vector environments."""


def info_of(records: NDArray[np.void], *, live: bool = True) -> dict[str, Any]:
    """The `info` of missions: true values, for scoring, not the robot's readings.

    Read-only arrays of shape (n,); `energy_j` has one per cause, `reward_terms` one per term.

    Args:
        records: `MISSION_DTYPE`, shape (n,).
        live: Whether the arrays follow the missions or are copies.
    """

    def column(field: str) -> NDArray[Any]:
        values = records[field].T if live else records[field].T.copy()
        values.flags.writeable = False
        return values

    return {
        "energy_j": dict(zip(CAUSES, column("ledger_j"), strict=True)),
        "reward_terms": {term: column(f"{term}_reward") for term in reward.TERMS},
        "score": column("score"),
        "cost": column("cost"),
        "position_m": column("position_m"),
        "home": column("home"),
        "stranded": column("depleted"),
    }


def observation_space(docks: bool = False) -> spaces.Box:
    """Space of one observation, see `homeward.envs.features.FEATURES`; with docks `DOCK_FEATURES`
    follow."""
    return spaces.Box(-LIMIT, LIMIT, (len(names_of(docks)),), np.float32)


class Batch:
    """Missions with the same options, stepped together."""

    def __init__(self, options: Options, count: int) -> None:
        announce_compilation()
        self.options = options
        self.known, self.hidden = constants_of(options)
        self.count = count
        self.records = _by_cache_lines(count, MISSION_DTYPE)
        self._robots = np.full(count, self.hidden.robot.record()[0], ROBOT_DTYPE)
        self._routes = _by_cache_lines(count, ROUTE_DTYPE)
        self._constants = np.zeros(1, CONSTANTS_DTYPE)
        self._write_constants()
        self._generators: list[np.random.Generator] = []
        self._typed_generators: Any = None
        self.threads = Threads(count) if Threads.worthwhile(count) else None
        self._none = np.zeros(count, np.bool_)
        self._discrete = options.action_type != "continuous"
        self._action_shape = (count, 3)
        # The kernels write the features that all missions have; where docks add some, into an array
        # of their own.
        self._features = np.zeros((count, len(FEATURES)), np.float32) if options.docks else None

    def __getstate__(self) -> dict[str, Any]:
        # numba's lists cannot be pickled; this one is rebuilt.
        return self.__dict__ | {"_typed_generators": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._write_constants()
        # of the present machine
        self.threads = Threads(self.count) if Threads.worthwhile(self.count) else None

    def _write_constants(self) -> None:
        """Write the known and the hidden constants into one record for the kernels."""
        constants = self._constants[0]
        constants["shared"] = self.known.shared[0]
        constants["nominal"] = self.known.robot.record()[0]
        constants["hidden"] = self.hidden.record[0]

    @property
    def generators(self) -> Sequence[np.random.Generator]:
        """One random generator for each mission."""
        return self._generators

    @generators.setter
    def generators(self, generators: Sequence[np.random.Generator]) -> None:
        self._generators = list(generators)
        self._typed_generators = None

    @property
    def robots(self) -> NDArray[np.void]:
        """True robots, `ROBOT_DTYPE`, shape (count,): hidden from agents, for planners with full
        knowledge."""
        return self._robots

    @property
    def routes(self) -> NDArray[np.void]:
        """Routes, `ROUTE_DTYPE`, shape (count,); the constants give the number of used places."""
        return self._routes

    @property
    def constants(self) -> NDArray[np.void]:
        """Constants of the environment in the form of the kernels, `CONSTANTS_DTYPE`, shape (1,),
        hidden ones included."""
        return self._constants

    def reset(self, begin: NDArray[np.bool_], observations: NDArray[np.float32]) -> None:
        """Begin new missions where a mask of shape (count,) is true, and write their
        observations."""
        kernel.reset_missions(
            begin.nonzero()[0], self._numbas_generators(), self._constants, self.records, self._robots, self._routes,
            self._rows(observations),
        )  # fmt: skip
        self._add_docks(observations)

    def step(
        self,
        actions: Any,
        observations: NDArray[np.float32],
        rewards: NDArray[np.float64],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
        begin: NDArray[np.bool_] | None = None,
    ) -> int:
        """Step every mission that is not over; write the results and return how many ended.

        Where the mask `begin` of shape (count,) is true, a new mission begins instead; its action
        is not used. Flat actions are given by their three parts
        (`homeward.envs.actions.unflatten_actions`).

        Raises:
            OptionError: An action is not in the action space; no mission was stepped.
        """
        choices, levels = _NO_CHOICES, _NO_LEVELS
        if self._discrete:
            choices = self._as_actions(actions, np.int64)
        else:
            levels = self._as_actions(actions, np.float32)
        rows = self._rows(observations)
        threads = self.threads
        start_s = time.perf_counter() if threads else 0.0
        if threads and threads.number > 1 and not threads.forked:
            with threads.at_work():
                ended: int = kernel.step_in_parallel(
                    self._none if begin is None else begin, self._numbas_generators(), choices, levels,
                    self._constants, self.records, self._robots, self._routes, rows, rewards, terminated, truncated,
                )  # fmt: skip
        else:
            ended = kernel.step_in_turn(
                choices, levels, self._constants, self.records, self._robots, self._routes, rows, rewards, terminated,
                truncated,
            )  # fmt: skip
            if begin is not None and ended >= 0:
                self.reset(begin, observations)
        if threads:
            threads.record(time.perf_counter() - start_s)
        if ended < 0:
            self._refuse(actions, -1 - ended)
        self._add_docks(observations)
        return ended

    def _rows(self, observations: NDArray[np.float32]) -> NDArray[np.void]:
        written = observations if self._features is None else self._features
        return np.ndarray(self.count, OBSERVATION_DTYPE, written)

    def _add_docks(self, observations: NDArray[np.float32]) -> None:
        if self._features is not None:
            count = len(FEATURES)
            observations[:, :count] = self._features
            observe_docks(self.records, self._routes, self.known.shared[0], observations[:, count:])

    def _numbas_generators(self) -> Any:
        if self._typed_generators is None:
            with uninterrupted():
                self._typed_generators = numba.typed.List(self._generators)
        return self._typed_generators

    def _as_actions(self, actions: Any, dtype: Any) -> Any:
        array = np.asarray(actions)
        if array.shape != self._action_shape:
            if array.shape[:1] == (self.count,):
                raise OptionError(
                    f"an action has shape {array.shape[1:]}; give (3,): speed, sensing and mode"
                )
            raise OptionError(f"actions have shape {array.shape}; give {self._action_shape}")
        if array.dtype != dtype:
            if array.dtype.kind not in ("iu" if dtype is np.int64 else "iuf"):
                raise OptionError(f"actions have dtype {array.dtype}; give {np.dtype(dtype)}")
            # infinity is refused like any number beyond the bounds
            with np.errstate(over="ignore"):
                array = array.astype(dtype)
        return np.ascontiguousarray(array)

    def _refuse(self, actions: Any, index: int) -> None:
        action = np.asarray(actions)[index].tolist()
        allowed = allowed_actions(self._discrete)
        raise OptionError(f"action {action} of env {index} is not allowed; give {allowed}")
