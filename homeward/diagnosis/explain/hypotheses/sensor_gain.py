"""A power reading that is scaled from some moment on."""

from collections.abc import Mapping

import numpy as np

from homeward.diagnosis.explain.drive import Drive
from homeward.diagnosis.explain.hypothesis import Hypothesis, Instrument, Setting
from homeward.diagnosis.read.signals import Array
from homeward.physics.effects import Parameter

INSTRUMENT = Instrument(
    "sensor_gain",
    (Parameter("gain", "1", -0.9, 10.0, "relative error of every reading"),),
    "The power reading is scaled by a constant factor from some moment on: an instrument, not physics.",
    "reading = (1 + gain) power",
    "scale error of a current or voltage sensor",
    ("power_w",),
    ("ageing",),
)


def _power(one: Hypothesis, setting: Setting) -> Array:
    return setting.predicted


def _on_drive(one: Hypothesis, drive: Drive, size: float, shape: Mapping[str, float]) -> Array:
    return size * np.maximum(drive.plain, 0.0)


HYPOTHESIS = Hypothesis(
    INSTRUMENT,
    steady=None,
    changes="once",
    signed=True,
    load=_power,
    check="read a clamp meter on the battery lead, standing and at top speed, beside the log",
    on_drive=_on_drive,
)
