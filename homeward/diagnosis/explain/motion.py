"""Whether recorded motion is a confounder: whether it explains a residual, so that no unrecorded cause is needed.

A schedule of levels in time fits any intermittent cause, also one that a channel shows in a form outside the catalogue.
Boosted trees on the motion, now and in the minutes before, have no feature of a load or of the ground. If they predict
held-out runs about as well as the schedule does, its cause was recorded, and the effect must not be named. Nor may
effects that channels identify, where the trees explain clearly more than they do.
"""

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator
from scipy.signal import lfilter

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.folds import cut_folds
from homeward.diagnosis.fit.held_out import black_box, held_out
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array, Index, Mask

MOTION = ("speed_mps", "accel_mps2", "yaw_rate_radps", "wheel_difference_mps", "grade_rad", "sensing_hz")
"""Channels of the robot's motion; place and time are left out, as they may be confounded with any change."""

_REMEMBERS_S = (10.0, 30.0, 100.0, 300.0)  # time constants, from a converter to a gearbox; chosen: about threefold each


def explained(fit: Fitted, corrected: Fitted, runs: Runs, fold: Index) -> float:
    """Share of the refit's held-out squared error that a fitted model explains."""
    return _gain(fit, runs, fold, _held_out_error(corrected, runs, fold))


def _held_out_error(model: Fitted, runs: Runs, fold: Index) -> float:
    residual = runs.observed - held_out(lambda chosen: model.fitted_to(chosen, runs.observed).predicted, fold)
    return float(residual @ residual)


def motion_gain(fit: Fitted, runs: Runs, fold: Index, rng: Generator) -> float:
    """Share of a model's squared error, held out by fold, that trees on the motion and its history explain."""
    return _gain(fit, runs, fold, _by_trees(fit, runs, fold, rng, MOTION, _history(fit, runs)))


def _gain(fit: Fitted, runs: Runs, fold: Index, after: float) -> float:
    """Share of a fit's squared held-out error that is gone where `after` is left."""
    return 1.0 - after / max(_held_out_error(fit, runs, fold), 1e-300)


def largest_by_motion(fit: Fitted, runs: Runs, block: Index, rng: Generator) -> float:
    """Held-out gain of a schedule up to which motion accounts for it, so that no unrecorded cause is needed.

    Motion that causes a load does so in every run: where there are enough runs, whole ones are held out. Motion that
    explains half as much there is the cause, unless the time since the start of a run explains more. Within a run the
    history of the motion is confounded with time: in fewer runs, stretches are held out, cut from each `block`, of
    shape (windows,), and motion must explain nearly as much.
    """
    fold, by = cut_folds(runs, block)
    by_motion = motion_gain(fit, runs, fold, rng)
    if by == "block":
        return by_motion / thresholds.NEARLY_ALL
    by_clock = _gain(fit, runs, fold, _by_trees(fit, runs, fold, rng, (), [runs.elapsed_s]))
    return by_motion / thresholds.HALF if by_motion > by_clock else 0.0


def place_gain(fit: Fitted, runs: Runs, rng: Generator) -> float:
    """The same by the place on the way and the height climbed since the start, with whole runs held out.

    What changes in the same places on other days does not depend on time. 0 of fewer than three runs.
    """
    place_m, sine = runs.context.get("place_m"), np.sin(runs.context.get("grade_rad", np.zeros(len(runs.run))))
    if place_m is None or len(runs.signals) < thresholds.FEWEST_RUNS:
        return 0.0
    climbed_m = np.nan_to_num(sine) * runs.context["speed_mps"] * runs.duration_s
    for run in range(len(runs.signals)):
        climbed_m[runs.run == run] = np.cumsum(climbed_m[runs.run == run])
    return _gain(fit, runs, runs.run, _by_trees(fit, runs, runs.run, rng, ("place_m",), [climbed_m]))


def trees_beat(named: Fitted, fit: Fitted, runs: Runs, fold: Index, rng: Generator) -> bool:
    """Whether trees on the present motion, beside a fit, leave less than half of the squared error of a model with
    effects, held out by fold, shape (windows,): by run, where there are enough."""
    return _by_trees(fit, runs, fold, rng, MOTION) < thresholds.HALF * _held_out_error(named, runs, fold)


def _by_trees(
    fit: Fitted, runs: Runs, fold: Index, rng: Generator, channels: Sequence[str], beside: Sequence[Array] = ()
) -> float:
    """Held-out squared error of boosted trees on channels and further features, beside a fit."""

    def predicted(chosen: Mask) -> Array:
        return black_box(runs, fit.fitted_to(chosen, runs.observed).predicted, chosen, rng, channels, beside)

    return float(((runs.observed - held_out(predicted, fold)) ** 2).sum())


def _history(fit: Fitted, runs: Runs) -> list[Array]:
    """Load and speed after first-order low-pass filters of several time constants: heat, wetness, stirred-up ground."""
    each = [np.flatnonzero(runs.run == run) for run in np.unique(runs.run)]

    def remembered(values: Array, constant_s: float) -> Array:
        kept = [float(np.exp(-float(np.median(runs.duration_s[own])) / constant_s)) for own in each]
        parts = (lfilter([1.0 - keep], [1.0, -keep], values[own]) for own, keep in zip(each, kept, strict=True))
        return np.concatenate(list(parts))

    loads = fit.predicted, np.abs(runs.context["speed_mps"])
    return [remembered(values, constant_s) for values in loads for constant_s in _REMEMBERS_S]
