"""Motors that warm up: over several time constants."""

from collections.abc import Iterator

import numpy as np

from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting
from homeward.physics.effects.motor_heating import EFFECT

_CONSTANTS_S = (60.0, 200.0, 600.0, 1800.0)
_USUAL_RISE_K = 40.0  # of a winding at mean load
_MOST_RISE = next(one for one in EFFECT.parameters if one.name == "rise_k_per_w")


def _time_constants(setting: Setting) -> Iterator[dict[str, float]]:
    work_w = float(np.mean(np.maximum(setting.runs.observed, 0.0)))
    if work_w <= _USUAL_RISE_K / _MOST_RISE.high:
        return  # hardly any power: wrong signs, or nothing at work
    longest_s = max(float(np.ptp(run.time_s)) for run in setting.runs.signals)
    for constant_s in _CONSTANTS_S:
        if constant_s <= 2.0 * longest_s:
            # Rise and change per kelvin enter as a product, so that one of them can be as usual.
            yield {"time_constant_s": constant_s, "rise_k_per_w": _USUAL_RISE_K / work_w}


HYPOTHESIS = Hypothesis(
    EFFECT,
    shapes=_time_constants,
    searched=tuple(one for one in EFFECT.parameters if one.name == "time_constant_s"),
    shown_by=(),
    otherwise="as the motors warm up",
    check="put a thermometer on a motor for the length of a drive",
)
