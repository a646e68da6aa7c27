"""Actions: from the numbers of `env.step` to commands, and back.

An action is a speed, a sensing rate, and one of stop, go and return. A return heads home at once.
It is final once it has been chosen in several decisions in a row
(`homeward.envs.options.RETURN_SHARE`), so that a policy that explores does not end its mission by
the first return that it tries.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from homeward.envs.options import Known, OptionError
from homeward.envs.state import RETURN, STOP
from homeward.physics.jit import inline

LEVELS = 5
"""Number of levels of speed and of sensing rate in the discrete action space. Chosen: steps of a
quarter, and 75 actions."""
MODES = ("stop", "go", "return")
FLAT_ACTIONS = LEVELS * LEVELS * len(MODES)
"""Number of actions of the flat action space: all combinations of the discrete one."""
_PARTS = [LEVELS, LEVELS, len(MODES)]


@dataclass(frozen=True)
class Commands:
    """Commands of actions, arrays of shape (n,).

    Attributes:
        speed_mps: Speed, m/s; that of the action also when it stops.
        sensing_hz: Sensing rate, Hz.
        mode: `STOP`, `GO` or `RETURN` of `homeward.envs.state`.
    """

    speed_mps: NDArray[np.float64]
    sensing_hz: NDArray[np.float64]
    mode: NDArray[np.int64]

    @property
    def driven_mps(self) -> NDArray[np.float64]:
        """Speed driven, m/s: 0 when stopping."""
        return np.where(self.mode == STOP, 0.0, self.speed_mps)

    @property
    def returns(self) -> NDArray[np.bool_]:
        """Which commands are returns."""
        return np.asarray(self.mode == RETURN)


def action_space(discrete: bool) -> spaces.Space[Any]:
    """Space of one action: speed, sensing rate, and stop / go / return."""
    return spaces.MultiDiscrete(_PARTS) if discrete else spaces.Box(-1.0, 1.0, (3,), np.float32)


def space_of(action_type: str) -> spaces.Space[Any]:
    """Space of one action, by `homeward.envs.options.Options.action_type`."""
    return (
        spaces.Discrete(FLAT_ACTIONS)
        if action_type == "flat"
        else action_space(action_type == "discrete")
    )


def flatten_actions(actions: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers in the flat action space of discrete actions, shape (n, 3); shape (n,).

    >>> flatten_actions(np.array([[0, 0, 1], [4, 4, 2]])).tolist()
    [1, 74]
    """
    numbers: NDArray[np.int64] = np.ravel_multi_index(tuple(actions.T), _PARTS)
    return numbers


def unflatten_actions(numbers: Any, count: int | None = None) -> NDArray[np.int64]:
    """Discrete actions, shape (n, 3), of numbers in the flat action space, shape (n,).

    Args:
        numbers: The numbers.
        count: How many there should be; any number of them if None.

    Raises:
        OptionError: They are no whole numbers of one dimension, too few or many, or one is not in
            the space.

    >>> unflatten_actions(np.array([1, 74])).tolist()
    [[0, 0, 1], [4, 4, 2]]
    """
    array = np.asarray(numbers)
    if array.ndim != 1 or array.dtype.kind not in "iu" or count not in (None, len(array)):
        raise OptionError(
            f"flat actions have shape {array.shape} and dtype {array.dtype}; give one whole number for each mission, "
            f"from 0 to {FLAT_ACTIONS - 1}"
        )
    outside = np.flatnonzero((array < 0) | (array >= FLAT_ACTIONS))
    if outside.size:
        index = int(outside[0])
        raise OptionError(
            f"action {array[index]} of env {index} is not allowed; give a whole number from 0 to {FLAT_ACTIONS - 1}"
        )
    speed, sensing, mode = np.unravel_index(array, _PARTS)
    return np.stack((speed, sensing, mode), axis=-1)


def allowed_actions(discrete: bool) -> str:
    """Allowed actions, in words."""
    if discrete:
        return f"speed and sensing levels 0 to {LEVELS - 1} and 0 (stop), 1 (go) or 2 (return)"
    return "three numbers within [-1, 1]"


def limits(known: Known) -> tuple[tuple[float, float], tuple[float, float]]:
    """Lowest and highest speed (m/s) and sensing rate (Hz) that can be commanded."""
    shared = known.shared[0]
    return (float(shared["min_speed_mps"]), float(shared["max_speed_mps"])), (
        0.0,
        float(shared["max_sensing_hz"]),
    )


def encode_actions(
    known: Known, speed_mps: ArrayLike, sensing_hz: ArrayLike, mode: ArrayLike
) -> NDArray[Any]:
    """Actions for commands: exact in a continuous space, at the nearest levels in a discrete one.

    Commands beyond the robot's limits become the limits.

    Args:
        known: Constants of the environment; actions are of its type.
        speed_mps: Speed, m/s, shape (n,) or a number for all.
        sensing_hz: Sensing rate, Hz, shape (n,) or a number for all.
        mode: `STOP`, `GO` or `RETURN` of `homeward.envs.state`, shape (n,) or one for all.

    Returns:
        Actions, shape (n, 3): int64 for a discrete space, float32 for a continuous one.

    >>> from homeward.envs.options import Options, known_of
    >>> from homeward.envs.state import GO
    >>> encode_actions(known_of(Options("Survey")), [0.1, 0.6, 1.0], 50.0, GO).tolist()
    [[0, 2, 1], [2, 2, 1], [4, 2, 1]]
    """
    speeds, rates = limits(known)
    speed_share, sensing_share, modes = np.broadcast_arrays(
        np.atleast_1d(_share(speed_mps, *speeds)), _share(sensing_hz, *rates), np.asarray(mode)
    )
    if known.shared["discrete"][0]:
        speed_level = np.rint((LEVELS - 1) * speed_share)
        sensing_level = np.rint((LEVELS - 1) * sensing_share)
        return np.stack((speed_level, sensing_level, modes), axis=-1).astype(np.int64)
    # Each mode has a third of [-1, 1]; the middle of it is used.
    middles = (modes - 1.0) * 2.0 / 3.0
    return np.stack((2.0 * speed_share - 1.0, 2.0 * sensing_share - 1.0, middles), axis=-1).astype(
        np.float32
    )


def decode_actions(known: Known, actions: NDArray[Any]) -> Commands:
    """Commands of actions, shape (n, 3).

    >>> from homeward.envs.options import Options, known_of
    >>> decode_actions(known_of(Options("Survey")), np.array([[2, 4, 2]])).speed_mps.tolist()
    [0.55]
    """
    (slowest_mps, fastest_mps), (_, most_hz) = limits(known)
    if known.shared["discrete"][0]:
        speed_share = actions[:, 0] / (LEVELS - 1)
        sensing_share = actions[:, 1] / (LEVELS - 1)
        mode = actions[:, 2].astype(np.int64)
    else:
        shares = 0.5 * (actions[:, :2].astype(np.float64) + 1.0)
        speed_share = shares[:, 0]
        sensing_share = shares[:, 1]
        mode = modes(actions)
    return Commands(
        speed_mps=slowest_mps + speed_share * (fastest_mps - slowest_mps),
        sensing_hz=sensing_share * most_hz,
        mode=mode,
    )


def modes(actions: NDArray[Any]) -> NDArray[np.int64]:
    """Modes of actions, shape (n, 3), of either space: `STOP`, `GO` or `RETURN`, shape (n,)."""
    if actions.dtype.kind != "f":
        return actions[:, 2].astype(np.int64)
    return np.minimum(thirds(actions).astype(np.int64), RETURN)


def thirds(actions: NDArray[Any]) -> NDArray[np.float64]:
    """Position of the last number of continuous actions, shape (n, 3), in thirds of [-1, 1], one
    per mode; shape (n,)."""
    return 0.5 * len(MODES) * (actions[:, 2].astype(np.float64) + 1.0)


def silenced(actions: NDArray[Any], which: NDArray[np.bool_]) -> NDArray[Any]:
    """Actions, shape (n, 3) of either space, of which some, shape (n,), get a sensing rate of 0."""
    filled: NDArray[Any] = actions.copy()
    is_continuous = actions.dtype.kind == "f"
    filled[which, 1] = -1 if is_continuous else 0  # the lowest
    return filled


def _share(value: ArrayLike, low: float, high: float) -> NDArray[np.float64]:
    """Position of a value between two limits, from 0 to 1; 1 if the limits are equal."""
    value = np.asarray(value, dtype=np.float64)
    if high <= low:
        return np.ones(value.shape)
    return np.clip((value - low) / (high - low), 0.0, 1.0)


@inline
def at_level(level: Any, low: float, high: float) -> Any:
    """Value of a level of the discrete action space, between the lowest and the highest; also for
    compiled code.

    >>> at_level(np.arange(LEVELS), 0.1, 0.9).round(2).tolist()
    [0.1, 0.3, 0.5, 0.7, 0.9]
    """
    return low + (high - low) * level / (LEVELS - 1)


@inline
def first_bad_action(choices: Any, levels: Any, shared: Any) -> int:
    """Index of the first action that is not in the action space, or -1."""
    if shared.discrete:
        for i in range(len(choices)):
            if not (
                0 <= choices[i, 0] < LEVELS
                and 0 <= choices[i, 1] < LEVELS
                and 0 <= choices[i, 2] < 3
            ):
                return i
    else:
        for i in range(len(levels)):
            if not (
                abs(levels[i, 0]) <= 1.0 and abs(levels[i, 1]) <= 1.0 and abs(levels[i, 2]) <= 1.0
            ):
                return i
    return -1


@inline
def command(choices: Any, levels: Any, i: int, shared: Any) -> Any:
    """Speed (m/s), sensing rate (Hz) and mode of an action, in compiled code."""
    if shared.discrete:
        return (
            at_level(choices[i, 0], shared.min_speed_mps, shared.max_speed_mps),
            at_level(choices[i, 1], 0.0, shared.max_sensing_hz),
            choices[i, 2],
        )
    return (
        at_level(2.0 * (levels[i, 0] + 1.0), shared.min_speed_mps, shared.max_speed_mps),
        at_level(2.0 * (levels[i, 1] + 1.0), 0.0, shared.max_sensing_hz),
        min(int(1.5 * (levels[i, 2] + 1.0)), 2),
    )
