"""Effects on battery energy: resistance, capacity lost at high power, by age and in the cold, and
starts."""

from collections.abc import Iterator

import numpy as np

from homeward.diagnosis.explain.hypothesis import Hypothesis, Numbers, Setting, temperatures
from homeward.diagnosis.explain.menu import Drive
from homeward.logs.channels import Array
from homeward.physics.effects import (
    ageing,
    breakaway,
    cold_battery,
    internal_resistance,
    rate_capacity,
)

CONFOUNDED_WITH_LOAD = rate_capacity.EFFECT.id
CONFOUNDED_WITH_COLD = cold_battery.EFFECT.id
"""Effects confounded with ageing where the load rises or the air gets colder from run to run."""

WARM_C, COLD_W = cold_battery.EFFECT.parameters[1:]
_OVER_M = breakaway.EFFECT.parameters[1]
# at top speed, over which a start is tried; chosen: threefold each, refined afterwards
_SECONDS = (0.3, 1.0, 3.0)


def _references(setting: Setting) -> Iterator[Numbers]:
    """Reference powers that are tried: a low and the median quantile of the power drawn."""
    drawn_w = setting.runs.observed[setting.runs.observed > 0.0]
    if len(drawn_w) == 0:
        return
    for reference_w in np.unique(np.quantile(drawn_w, [0.02, 0.5])):
        yield {"reference_w": float(reference_w)}


def _colds(setting: Setting) -> Iterator[Numbers]:
    """Capacity lost below a temperature, and a resistance that grows below it: a share at the
    median power drawn."""
    median_power = list(_references(setting))[-1:]  # none where nothing is drawn
    for shape in temperatures(WARM_C)(setting):
        yield shape
        for power in median_power:
            yield {**shape, **power}


def _ways(setting: Setting) -> Iterator[Numbers]:
    """Ways over which the energy of a start is spent: at once, and what the robot drives in some
    seconds."""
    yield {}
    for seconds in _SECONDS:
        yield {_OVER_M.name: seconds * setting.parameters.nominal.max_speed_mps}


def share_of_the_drive(hypothesis: Hypothesis, drive: Drive, size: float, shape: Numbers) -> Array:
    """Contribution to a test drive of an effect that is a share of the power drawn, shape
    (samples,)."""
    return size * np.maximum(drive.plain, 0.0)


INTERNAL_RESISTANCE = Hypothesis(  # rarely changes, except when a connector works loose
    internal_resistance.EFFECT,
    changes="once",
    seldom=True,
    shown_by=(),
    otherwise="at high power",
    check="read the battery voltage at rest and under a known load",
)

# between runs: in power, and in a recorded state of charge, which alone identifies it
AGEING = Hypothesis(
    ageing.EFFECT,
    needs=(),
    steady=None,
    changes="between runs",
    load=lambda hypothesis, setting: np.maximum(setting.predicted, 0.0),
    shown_by=(),
    check="discharge the battery from full to empty at its typical load and at room temperature, and measure "
    "the energy: the loss is then due to age",
    on_drive=share_of_the_drive,
)

COLD_BATTERY = Hypothesis(
    cold_battery.EFFECT,
    shapes=_colds,
    searched=(WARM_C,),
    check="discharge the battery once cold and once warm through a known load",
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
        shapes=_ways,
        searched=(_OVER_M,),
        shown_by=(),
        otherwise="at every start from standstill",
        check="pull the robot with a spring balance until it starts to roll",
    ),
    AGEING,
    COLD_BATTERY,
)
