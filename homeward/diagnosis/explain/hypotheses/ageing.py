"""A battery that fades between runs: in power, and in a recorded state of charge, which alone can prove it."""

from collections.abc import Mapping

import numpy as np

from homeward.diagnosis.explain.drive import Drive
from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting
from homeward.diagnosis.read.signals import Array
from homeward.physics.effects import cold_battery, rate_capacity
from homeward.physics.effects.ageing import EFFECT

IN_STEP_WITH_LOAD, IN_STEP_WITH_COLD = rate_capacity.EFFECT.id, cold_battery.EFFECT.id
"""What else makes a gauge fall faster, where the load rises or the air gets colder from run to run."""


def _drawn(one: Hypothesis, setting: Setting) -> Array:
    return np.maximum(setting.predicted, 0.0)


def _on_drive(one: Hypothesis, drive: Drive, size: float, shape: Mapping[str, float]) -> Array:
    return size * np.maximum(drive.plain, 0.0)


HYPOTHESIS = Hypothesis(
    EFFECT,
    needs=(),
    steady=None,
    changes="between runs",
    load=_drawn,
    shown_by=(),
    check="discharge the battery from full to empty at its usual load and at room temperature, and count the energy: "
    "what is gone then is gone by age",
    on_drive=_on_drive,
)
