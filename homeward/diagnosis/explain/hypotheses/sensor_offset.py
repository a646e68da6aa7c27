"""A power reading with a zero that is off from some moment on, or creeps."""

from collections.abc import Iterator, Mapping

import numpy as np

from homeward.diagnosis.explain.drive import Drive
from homeward.diagnosis.explain.hypothesis import Hypothesis, Instrument, Setting, Term, everywhere, levels
from homeward.diagnosis.read.signals import Array
from homeward.physics.effects import Parameter

INSTRUMENT = Instrument(
    "sensor_offset",
    (Parameter("offset", "W", -10000.0, 10000.0, "added to every reading"),),
    "The power reading is shifted by a constant from some moment on: an instrument, not physics.",
    "reading = power + offset",
    "zero drift of a current sensor",
    ("power_w",),
    ("standby", "intermittent_load"),
)


def _also_creeping(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    """Through all runs, taken in their order: per unit of what it comes to in the end."""
    yield from levels(one, setting)
    passed = np.cumsum(setting.runs.duration_s)
    yield Term(one, (passed / passed[-1])[:, None], *one.limits(1), axis="time")


def _on_drive(one: Hypothesis, drive: Drive, size: float, shape: Mapping[str, float]) -> Array:
    return np.full(len(drive.plain), size)  # also when everything is off


HYPOTHESIS = Hypothesis(
    INSTRUMENT,
    steady=None,
    changes="once",
    signed=True,
    load=everywhere,
    scheduled=_also_creeping,
    check="read a clamp meter on the battery lead with the robot switched off: the log must show the same",
    on_drive=_on_drive,
)
