"""A heater: proportional to the cold, or on at full power below a temperature."""

from collections.abc import Iterator

import numpy as np

from homeward.diagnosis.explain.hypotheses.temperatures import temperatures
from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting, Term, responses
from homeward.physics.effects.heater import EFFECT

_ON_BELOW_C = EFFECT.parameters[1]


def _also_on_and_off(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    """One that is on at full power below a temperature, of the same mean power as the proportional one."""
    yield from responses(one, setting)
    temperature_c = setting.runs.context["temperature_c"]
    known = temperature_c[np.isfinite(temperature_c)]
    for below_c in np.unique(np.round(np.quantile(known, np.linspace(0.1, 0.9, 17)), 1)):
        on = temperature_c < below_c
        if 0 < on.sum() < len(on):
            column = on * float(np.mean(below_c - temperature_c[on]))
            yield Term(one, column[:, None], *one.limits(1), 2, {_ON_BELOW_C.name: float(below_c)}, fixed=True)


HYPOTHESIS = Hypothesis(EFFECT, shapes=temperatures(_ON_BELOW_C), steady=_also_on_and_off, searched=(_ON_BELOW_C,))
