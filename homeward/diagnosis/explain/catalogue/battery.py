"""Effects on battery energy: resistance, capacity lost at high power, by age and in the cold, and starts."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from homeward.diagnosis.explain.hypothesis import TINY, Hypothesis, Numbers, Setting, Term, temperatures
from homeward.diagnosis.explain.menu import Drive
from homeward.logs.channels import Array
from homeward.physics.effects import ageing, breakaway, cold_battery, internal_resistance, rate_capacity

CONFOUNDED_WITH_LOAD, CONFOUNDED_WITH_COLD = rate_capacity.EFFECT.id, cold_battery.EFFECT.id
"""Effects confounded with ageing where the load rises or the air gets colder from run to run."""

_WARM_C = cold_battery.EFFECT.parameters[1]
_START_J = breakaway.EFFECT.switch
_ENDS = (0, 1, 2, 3, 5, 8)  # windows after a start, chosen: in steps that grow, four seconds in all


def _references(setting: Setting) -> Iterator[Numbers]:
    """Reference powers that are tried: a low and the median quantile of the power drawn."""
    drawn = setting.runs.observed[setting.runs.observed > 0.0]
    for value in np.unique(np.quantile(drawn, [0.02, 0.5])) if len(drawn) else []:
        yield {"reference_w": float(value)}


def _starts(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    """The energy of each start, drawn at once or with any time course over the first four seconds."""
    at_once = setting.response(one, TINY * _START_J.high, {})
    yield Term(one, at_once[:, None], *one.limits(1), fixed=True)
    run = setting.runs.run
    later = np.zeros((len(at_once), len(_ENDS) - 1))
    for step, (start, end) in enumerate(pairwise(_ENDS)):
        for windows in range(start, end):
            moved = np.roll(at_once, windows) * (np.roll(run, windows) == run)
            moved[:windows] = 0.0
            later[:, step] += moved / (end - start)
    yield Term(one, later, *one.limits(len(_ENDS) - 1, signed=False), fixed=True, flexible=True)


def share_of_the_drive(one: Hypothesis, drive: Drive, size: float, shape: Numbers) -> Array:
    """Contribution to a test drive of an effect that is a share of the power drawn, shape (samples,)."""
    return size * np.maximum(drive.plain, 0.0)


INTERNAL_RESISTANCE = Hypothesis(  # rarely changes, except when a connector works loose
    internal_resistance.EFFECT,
    changes="once",
    seldom=True,
    shown_by=(),
    otherwise="at high power",
    check="read the battery voltage at rest and under a known load",
)

AGEING = Hypothesis(  # between runs: in power, and in a recorded state of charge, which alone identifies it
    ageing.EFFECT,
    needs=(),
    steady=None,
    changes="between runs",
    load=lambda one, setting: np.maximum(setting.predicted, 0.0),
    shown_by=(),
    check="discharge the battery from full to empty at its typical load and at room temperature, and measure "
    "the energy: the loss is then due to age",
    on_drive=share_of_the_drive,
)

HYPOTHESES = (
    INTERNAL_RESISTANCE,
    Hypothesis(
        rate_capacity.EFFECT,
        needs=(),
        shapes=_references,
        otherwise="at high power",
        check="discharge a full battery once slowly and once fast through known loads",
    ),
    Hypothesis(
        breakaway.EFFECT,
        steady=_starts,
        shown_by=(),
        otherwise="at every start from standstill",
        check="pull the robot with a spring balance until it starts to roll",
    ),
    AGEING,
    Hypothesis(
        cold_battery.EFFECT,
        shapes=temperatures(_WARM_C),
        searched=(_WARM_C,),
        check="discharge the battery once cold and once warm through a known load",
    ),
)
