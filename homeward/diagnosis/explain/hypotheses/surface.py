"""Ground that rolls harder or easier from some place or moment on: of the rolling resistance a share."""

from collections.abc import Mapping

from homeward.diagnosis.explain.drive import Drive
from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting
from homeward.diagnosis.fit.parameter_groups import ROLLING
from homeward.diagnosis.read.signals import Array
from homeward.physics.effects.surface import EFFECT

_CHANGE = 1e-3


def _rougher(one: Hypothesis, setting: Setting) -> Array:
    theta = setting.theta.copy()
    theta[ROLLING] += _CHANGE * setting.rolling_kg
    return (setting.parameters.predict(setting.runs, theta, setting.present) - setting.predicted) / _CHANGE


def _on_drive(one: Hypothesis, drive: Drive, size: float, shape: Mapping[str, float]) -> Array:
    rougher = drive.fit.theta.copy()
    rougher[ROLLING] *= 1.0 + max(size, -0.9)
    return drive.there(one.lies_in) * (drive.predict(rougher) - drive.plain)


HYPOTHESIS = Hypothesis(
    EFFECT,
    steady=None,
    changes="moving",
    signed=True,
    by_place=True,
    map_channel="grade_rad",
    of_rolling=True,
    load=_rougher,
    shown_by=("base_distance_m",),
    lies_in="ground",
    on_drive=_on_drive,
)
