"""Whether recorded motion is a confounder: whether it explains a residual, so that no unrecorded
cause is needed.

A schedule of levels in time fits any intermittent cause, also one that a channel shows in a form
outside the catalogue. Boosted trees on the motion, now and in the minutes before, have no feature
of a load or of the ground. If they predict held-out runs about as well as the schedule does, its
cause was recorded, and the effect must not be named. Nor may effects that channels identify, where
the trees explain clearly more than they do.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from scipy.signal import lfilter

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.folds import cut_folds
from homeward.diagnosis.fit.held_out import black_box, held_out
from homeward.diagnosis.fit.replay import Runs
from homeward.logs.channels import Array, Index, Mask

MOTION = (
    "speed_mps",
    "accel_mps2",
    "yaw_rate_radps",
    "wheel_difference_mps",
    "grade_rad",
    "sensing_hz",
)
"""Channels of the robot's motion; place and time are left out, as they may be confounded with any
change."""

# from a converter to a gearbox; chosen: about threefold each
_TIME_CONSTANTS_S = (10.0, 30.0, 100.0, 300.0)


def explained(fit: Fitted, corrected: Fitted, runs: Runs, fold: Index) -> float:
    """Share of the refit's held-out squared error that a fitted model explains."""
    return _gain(fit, runs, fold, _held_out_error(corrected, runs, fold))


def _held_out_error(model: Fitted, runs: Runs, fold: Index) -> float:
    """Squared error of a model, held out by fold and summed over windows."""
    residual = runs.observed - held_out(
        lambda training: model.fitted_to(training, runs.observed).predicted, fold
    )
    return float(residual @ residual)


def motion_gain(fit: Fitted, runs: Runs, fold: Index, rng: Generator) -> float:
    """Share of a model's squared error, held out by fold, that trees on the motion and its history
    explain."""
    error = _error_of_trees(fit, runs, fold, rng, channels=MOTION, features=_history(fit, runs))
    return _gain(fit, runs, fold, error)


def _gain(fit: Fitted, runs: Runs, fold: Index, remaining_error: float) -> float:
    """Share of a fit's squared held-out error that is gone where `remaining_error` remains."""
    return 1.0 - remaining_error / max(_held_out_error(fit, runs, fold), 1e-300)


@dataclass(frozen=True)
class ByMotion:
    """Held-out gain of an effect up to which motion accounts for it, so that no unrecorded cause is
    needed."""

    in_time: float  # of an effect that changes in time
    by_place: float  # of one that changes with place


def largest_by_motion(fit: Fitted, runs: Runs, block: Index, rng: Generator) -> ByMotion:
    """How much of what a fit leaves counts as caused by motion.

    Motion that causes a load does so in every run: where there are enough runs, whole ones are held
    out. Its history also tells the time since the start of a run. Motion is the cause of what
    changes in time if it explains half as much of what this clock leaves; also, if it explains more
    than the clock and half as much as the effect, unless it leaves twice as much unexplained. In
    fewer runs, stretches are held out, cut from each `block`, of shape (windows,), and motion must
    explain nearly as much. So it must beside what changes with place, which slopes and bends tell.
    """
    fold, held_out_by = cut_folds(runs, block)
    by_motion = motion_gain(fit, runs, fold, rng)
    nearly_as_much = by_motion / thresholds.NEARLY_ALL
    if held_out_by == "block":
        return ByMotion(in_time=nearly_as_much, by_place=nearly_as_much)
    error_by_clock = _error_of_trees(fit, runs, fold, rng, channels=(), features=[runs.elapsed_s])
    by_clock = max(_gain(fit, runs, fold, error_by_clock), 0.0)
    if by_motion <= by_clock:
        return ByMotion(in_time=0.0, by_place=nearly_as_much)
    of_what_clock_leaves = (by_motion - by_clock) / (1.0 - by_clock)
    half_unexplained = 1.0 - thresholds.HALF * (1.0 - by_motion)
    twice_explained = by_motion / thresholds.HALF
    in_time = max(of_what_clock_leaves / thresholds.HALF, min(half_unexplained, twice_explained))
    return ByMotion(in_time=in_time, by_place=nearly_as_much)


def place_gain(fit: Fitted, runs: Runs, rng: Generator) -> float:
    """The same by the place on the way and the height climbed since the start, with whole runs held
    out.

    What changes in the same places on other days does not depend on time. 0 of fewer than three
    runs.
    """
    if "place_m" not in runs.context or len(runs.signals) < thresholds.FEWEST_RUNS:
        return 0.0
    fold = runs.run
    features = [_climbed_m(runs)]
    error = _error_of_trees(fit, runs, fold, rng, channels=("place_m",), features=features)
    return _gain(fit, runs, fold, error)


def _climbed_m(runs: Runs) -> Array:
    """Height climbed since the start of each run, m, shape (windows,); level where the grade is
    unknown."""
    grade_rad = runs.context.get("grade_rad", np.zeros(len(runs.run)))
    # Per metre driven a slope climbs its sine.
    rate_of_climb = np.nan_to_num(np.sin(grade_rad)) * runs.context["speed_mps"]
    climbed_m = rate_of_climb * runs.duration_s
    for run in range(len(runs.signals)):
        in_run = runs.run == run
        climbed_m[in_run] = np.cumsum(climbed_m[in_run])
    return climbed_m


def trees_beat(named: Fitted, fit: Fitted, runs: Runs, fold: Index, rng: Generator) -> bool:
    """Whether trees on the present motion, beside a fit, leave less than half of the squared error
    of a model with effects, held out by fold, shape (windows,): by run, where there are enough."""
    error = _error_of_trees(fit, runs, fold, rng, channels=MOTION)
    return error < thresholds.HALF * _held_out_error(named, runs, fold)


def _error_of_trees(
    fit: Fitted,
    runs: Runs,
    fold: Index,
    rng: Generator,
    channels: Sequence[str],
    features: Sequence[Array] = (),
) -> float:
    """Held-out squared error of boosted trees on channels and further features, (windows,) each,
    beside a fit."""

    def predict(training: Mask) -> Array:
        by_fit = fit.fitted_to(training, runs.observed).predicted
        return black_box(runs, by_fit, training, rng, channels, features)

    residual = runs.observed - held_out(predict, fold)
    return float((residual**2).sum())


def _history(fit: Fitted, runs: Runs) -> list[Array]:
    """Load and speed after first-order low-pass filters of several time constants: heat, wetness,
    stirred-up ground."""
    speed_mps = np.abs(runs.context["speed_mps"])
    return [
        _low_pass(values, time_constant_s, runs)
        for values in (fit.predicted, speed_mps)
        for time_constant_s in _TIME_CONSTANTS_S
    ]


def _low_pass(values: Array, time_constant_s: float, runs: Runs) -> Array:
    """First-order low-pass of values, shape (windows,), that starts at zero in each run."""
    filtered = []
    for run in np.unique(runs.run):
        in_run = runs.run == run
        window_s = float(np.median(runs.duration_s[in_run]))
        # Discrete form of dy/dt = (x - y) / time constant, exact for a constant load within a
        # window.
        pole = float(np.exp(-window_s / time_constant_s))
        filtered.append(lfilter([1.0 - pole], [1.0, -pole], values[in_run]))
    return np.concatenate(filtered)
