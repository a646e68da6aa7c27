"""Everything that can be named: each effect of the physics and each fault of an instrument, as a
hypothesis.

The modules beside this one, one for each place where effects enter, hold what is specific to an
effect; one that they do not list has the defaults.
"""

from collections.abc import Mapping

import numpy as np

from homeward.diagnosis.explain.catalogue import (
    ancillaries,
    battery,
    drivetrain,
    forces,
    instruments,
)
from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting, Term
from homeward.physics.effects import EFFECTS

_HYPOTHESES = (
    *forces.HYPOTHESES,
    *drivetrain.HYPOTHESES,
    *ancillaries.HYPOTHESES,
    *battery.HYPOTHESES,
)
_OF_EFFECTS = {hypothesis.id: hypothesis for hypothesis in _HYPOTHESES}

CATALOGUE: Mapping[str, Hypothesis] = {
    **{effect.id: _OF_EFFECTS.get(effect.id, Hypothesis(effect)) for effect in EFFECTS},
    **{hypothesis.id: hypothesis for hypothesis in instruments.HYPOTHESES},
}
"""Every hypothesis, by id."""


def terms(setting: Setting, leave_out: tuple[str, ...] = (), varying: bool = True) -> list[Term]:
    """Every form of every hypothesis that the channels of these runs allow, without effects that
    are in the model.

    Those whose size changes for no recorded reason are included only if `varying`.
    """
    allowed: list[Term] = []
    for effect, hypothesis in CATALOGUE.items():
        shows = setting.runs.unit == "W" or hypothesis.of_current
        if effect in leave_out or not shows:
            continue
        for term in hypothesis.forms(setting, varying):
            if np.isfinite(term.columns).all() and term.columns.any():
                allowed.append(term)
    return allowed
