"""Computing while sensing, or while sensing on the move: the same at any sensing rate, or with the rate."""

from collections.abc import Iterator

import numpy as np

from homeward.diagnosis.explain.change_points import STANDS_MPS
from homeward.diagnosis.explain.hypothesis import TINY, Hypothesis, Setting, Term, responses
from homeward.physics.effects.compute import EFFECT


def _at_any_rate(setting: Setting) -> Iterator[dict[str, float]]:
    yield {"base_share": 1.0}


def _also_on_the_move(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    """Computing that rests while the robot stands, as mapping does, beside computing that does not."""
    yield from responses(one, setting)
    moving = np.abs(setting.runs.context["speed_mps"]) > STANDS_MPS
    for share in () if moving.all() else (1.0, 0.0):
        column = moving * setting.response(one, TINY * EFFECT.switch.high, {"base_share": share})
        yield Term(one, column[:, None], *one.limits(1), 1, {"base_share": share}, fixed=True)


HYPOTHESIS = Hypothesis(
    EFFECT, shapes=_at_any_rate, steady=_also_on_the_move, check="put a clamp meter on the lead of the computer"
)
