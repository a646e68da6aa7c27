"""Whether a schedule is needed at all: what recorded motion predicts, no unrecorded cause has to explain.

A schedule of levels in time follows anything that comes and goes, also what a channel tells in a way that no effect of
the catalogue has. Boosted trees on the motion alone cannot know of a load or of the ground. If they predict stretches
that they have not seen as well as the schedule does, its cause was recorded, and the effect must not be named.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.held_out import black_box, held_out
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.rules import AS_WELL

MOTION = ("speed_mps", "accel_mps2", "yaw_rate_radps", "wheel_difference_mps", "grade_rad", "sensing_hz")
"""Channels of what the robot does; those of where and when could stand for anything that changes."""


def explained(fit: Fitted, corrected: Fitted, runs: Runs, fold: NDArray[np.intp]) -> float:
    """Share of the refit's held-out squared error that a fitted model explains."""
    return 1.0 - _held_out_error(corrected, runs, fold) / max(_held_out_error(fit, runs, fold), 1e-300)


def _held_out_error(model: Fitted, runs: Runs, fold: NDArray[np.intp]) -> float:
    left = runs.observed - held_out(lambda chosen: model.on(chosen, runs.observed), fold)
    return float(left @ left)


def follows_motion(fit: Fitted, runs: Runs, fold: NDArray[np.intp], gain: float, seed: int) -> bool:
    """Whether motion alone explains as much of a model's held-out squared error as a schedule does.

    Args:
        fit: The refit, or a model with effects.
        runs: The runs.
        fold: What is held out together, shape (windows,).
        gain: Share of the squared error that the schedule explains.
        seed: Seed of the trees.
    """
    rng = np.random.default_rng(seed)
    trees = held_out(lambda chosen: black_box(runs, fit.on(chosen, runs.observed), chosen, rng, MOTION), fold)
    after = float(((runs.observed - trees) ** 2).sum())
    return after <= _held_out_error(fit, runs, fold) * (1.0 - AS_WELL * gain)
