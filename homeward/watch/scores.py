"""Proper scores of predictions, and the probability integral transform: more than how often an
interval is right.

A proper score is lowest on average for the true distribution, so that neither wide intervals nor
bold ones improve it (Gneiting & Raftery, Journal of the American Statistical Association 102,
2007). `scoringrules` has them, in the extra `scores`: its import compiles for some seconds, so that
only those who want the scores pay for them.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from homeward import installed
from homeward.estimation.tails import deviations
from homeward.estimation.thresholds import DEGREES
from homeward.watch.predictions import COVERED, Watched

Array = NDArray[np.float64]

# J, of a prediction that is certain; chosen: its score is its error all the same
_LEAST_SCALE = 1e-9


class Scores(NamedTuple):
    """Scores of predictions in the unit of what is predicted, lower is better; shape (moments,).

    Attributes:
        crps: Continuous ranked probability score: the absolute error of a single number, less for a
            good interval.
        interval: Score of the 90 % interval: its width, and 20 times the distance of a value
            outside.
    """

    crps: Array
    interval: Array


def missing() -> str | None:
    """What the scores need, a sentence; None if it is there."""
    if find_spec("scoringrules") is not None:
        return None
    return f"No CRPS and no interval score: they need scoringrules, {installed.advice('scores', 'scoringrules')}"


def scales_of(run: Watched) -> Array:
    """Scale of the Student's t of each prediction, as of `homeward.estimation.tails`, shape
    (moments,).

    By the upper end of the interval: the lower one may be held at 0.
    """
    return np.maximum((run.high_j - run.mean_j) / deviations(0.5 + 0.5 * COVERED), _LEAST_SCALE)


def scores_of(run: Watched) -> Scores:
    """Scores of a run's predictions.

    Raises:
        ModuleNotFoundError: See `missing`.
    """
    scoringrules = import_module("scoringrules")
    crps = scoringrules.crps_t(run.took_j, DEGREES, run.mean_j, scales_of(run), backend="numpy")
    interval = scoringrules.interval_score(
        run.took_j, run.low_j, run.high_j, 1.0 - COVERED, backend="numpy"
    )
    return Scores(np.asarray(crps), np.asarray(interval))


def transforms_of(run: Watched) -> Array:
    """Probability integral transform: probability, by its prediction, of a value below the measured
    one.

    If predictions are calibrated, it is uniform between 0 and 1 over the moments. Shape (moments,).
    """
    return np.asarray(stdtr(DEGREES, (run.took_j - run.mean_j) / scales_of(run)))
