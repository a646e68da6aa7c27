"""Physical commands as actions: the way back from metres per second and hertz to what `env.step` takes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from homeward.envs.kernel import LEVELS
from homeward.envs.options import Setting


def encode_actions(setting: Setting, speed_mps: ArrayLike, sensing_hz: ArrayLike, mode: ArrayLike) -> NDArray[Any]:
    """Actions that carry out commands: exactly in a continuous space, at the nearest levels in a discrete one.

    Commands beyond the robot's limits become the limits.

    Args:
        setting: Constants of the environment; its action type is the one encoded for.
        speed_mps: Speed, m/s, shape (n,) or a number for all.
        sensing_hz: Sensing rate, Hz, shape (n,) or a number for all.
        mode: `STOP`, `GO` or `RETURN` of `homeward.envs.state`, shape (n,) or one for all.

    Returns:
        Actions, shape (n, 3): int64 for a discrete space, float32 for a continuous one.

    >>> from homeward.envs.options import Options, settle
    >>> from homeward.envs.state import GO
    >>> encode_actions(settle(Options("Survey")), [0.1, 0.6, 1.0], 50.0, GO).tolist()
    [[0, 2, 1], [2, 2, 1], [4, 2, 1]]
    """
    s = setting.shared[0]
    speed = _share(speed_mps, s["min_speed_mps"], s["max_speed_mps"])
    sensing = _share(sensing_hz, 0.0, s["max_sensing_hz"])
    columns = np.broadcast_arrays(np.atleast_1d(speed), sensing, np.asarray(mode))
    if s["discrete"]:
        speed, sensing = (np.rint((LEVELS - 1) * share) for share in columns[:2])
        return np.stack((speed, sensing, columns[2]), axis=-1).astype(np.int64)
    speed, sensing = (2.0 * share - 1.0 for share in columns[:2])
    # Each mode has a third of [-1, 1]; its middle stands for it.
    return np.stack((speed, sensing, (columns[2] - 1.0) * 2.0 / 3.0), axis=-1).astype(np.float32)


def _share(value: ArrayLike, low: float, high: float) -> NDArray[np.float64]:
    """Where a value lies between two limits, from 0 to 1; 1 where the limits are one."""
    value = np.asarray(value, dtype=np.float64)
    return np.clip((value - low) / (high - low), 0.0, 1.0) if high > low else np.ones(value.shape)
