"""The energy of each start, drawn at once or over the first moments of the way."""

from collections.abc import Iterator

import numpy as np
from scipy.signal import lfilter

from homeward.diagnosis.explain.hypothesis import TINY, Hypothesis, Setting, Term
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import Array
from homeward.physics.effects.breakaway import EFFECT

_WINDOWS = (0.01, 1.0, 2.0, 4.0)


def _starts(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    at_once = setting.response(one, TINY * EFFECT.switch.high, {})
    for windows in _WINDOWS:
        column = _worn_off(at_once, windows, setting.runs)
        yield Term(one, column[:, None], *one.limits(1), int(windows > 1.0), fixed=True)


def _worn_off(column: Array, windows: float, runs: Runs) -> Array:
    """The energy of each start spread over the windows after it."""
    kept = float(np.exp(-1.0 / windows))
    spread = np.empty_like(column)
    for run in np.unique(runs.run):
        here = runs.run == run
        spread[here] = lfilter([1.0 - kept], [1.0, -kept], column[here])
    return spread


HYPOTHESIS = Hypothesis(
    EFFECT,
    steady=_starts,
    shown_by=(),
    otherwise="at every start from standstill",
    check="pull the robot with a spring balance until it starts to roll",
)
