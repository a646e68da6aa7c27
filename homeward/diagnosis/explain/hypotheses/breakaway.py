"""The energy of each start, drawn at once or in any way over the first moments of the way."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from homeward.diagnosis.explain.hypothesis import TINY, Hypothesis, Setting, Term, level_name
from homeward.physics.effects.breakaway import EFFECT

_ENDS = (0, 1, 2, 3, 5, 8)  # windows after a start, in steps that grow: four seconds in all


def _starts(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    at_once = setting.response(one, TINY * EFFECT.switch.high, {})
    yield Term(one, at_once[:, None], *one.limits(1), fixed=True)
    run = setting.runs.run
    later = np.zeros((len(at_once), len(_ENDS) - 1))
    for step, (start, end) in enumerate(pairwise(_ENDS)):
        for windows in range(start, end):
            moved = np.roll(at_once, windows) * (np.roll(run, windows) == run)
            moved[:windows] = 0.0
            later[:, step] += moved / (end - start)
    yield Term(one, later, *one.limits(len(_ENDS) - 1, signed=False), fixed=True, flexible=True)


def _names(term: Term) -> list[tuple[str, str]]:
    sizes = term.columns.shape[1]
    return [(level_name(EFFECT.switch.name, size, sizes), EFFECT.switch.unit) for size in range(sizes)]


HYPOTHESIS = Hypothesis(
    EFFECT,
    steady=_starts,
    size_names=_names,
    shown_by=(),
    otherwise="at every start from standstill",
    check="pull the robot with a spring balance until it starts to roll",
)
