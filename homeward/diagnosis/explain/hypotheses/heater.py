"""A heater: proportional to the cold, with it in any way, or switched by a thermostat while it is cold."""

import numpy as np

from homeward.diagnosis.explain.hypotheses.temperatures import temperatures
from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting
from homeward.diagnosis.read.signals import Array
from homeward.physics.effects.heater import EFFECT

_ON_BELOW_C = EFFECT.parameters[1]
_OFF_ABOVE_C = 15.0  # thermostats of outdoor enclosures switch on at 5 and off at 15 degC (Stego KTO 011, data sheet)


def _while_cold(one: Hypothesis, setting: Setting) -> Array | None:
    """Full power while it may be on, of the same mean power as a proportional one."""
    temperature_c = setting.runs.context.get("temperature_c")
    if temperature_c is None or not (temperature_c < _OFF_ABOVE_C).any():
        return None
    cold = temperature_c < _OFF_ABOVE_C
    return np.asarray(cold * float(np.mean(_OFF_ABOVE_C - temperature_c[cold])))


HYPOTHESIS = Hypothesis(
    EFFECT,
    shapes=temperatures(_ON_BELOW_C),
    rises_with="-temperature_c",
    changes="repeatedly",
    load=_while_cold,
    searched=(_ON_BELOW_C,),
)
