"""A power clock that is late, by each of a few lags."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from homeward.diagnosis.explain.hypothesis import Hypothesis, Instrument, Setting, Term
from homeward.diagnosis.fit.parameter_groups import WithEffects
from homeward.diagnosis.fit.replay import Runs
from homeward.physics.effects import Parameter

_LAGS_S = tuple(sign * lag for lag in (0.2, 0.4, 0.6, 0.8, 1.0, 1.25, 1.5, 2.0) for sign in (1.0, -1.0))

INSTRUMENT = Instrument(
    "clock_lag",
    (Parameter("lag_s", "s", -5.0, 5.0, "time by which the power reading is late"),),
    "The clocks of power and motion disagree: an instrument, not physics.",
    "reading(t) = power(t - lag)",
    "unsynchronised loggers",
    ("time_s",),
    ("inertia",),
)


def _lags(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    for lag_s in _LAGS_S:
        shape = {"lag_s": lag_s}
        late = one.within(one, setting.present, shape, setting.runs)
        change = setting.parameters.predict(setting.runs, setting.theta, late) - setting.predicted
        low, high = sorted((0.5 * lag_s, 1.5 * lag_s))
        yield Term(one, change[:, None] / lag_s, np.array([low]), np.array([high]), 1, shape)


def _late(one: Hypothesis, so_far: WithEffects, numbers: Mapping[str, float], runs: Runs) -> WithEffects:
    return replace(so_far, lag_s=numbers["lag_s"])


HYPOTHESIS = Hypothesis(
    INSTRUMENT,
    steady=_lags,
    within=_late,
    otherwise="wherever the power changes",
    check="start sharply a few times and compare when wheels and power move in the logs with one clock for both",
    at_wheels=True,
)
