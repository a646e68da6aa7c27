"""A speed reading that a position fix contradicts, run by run: its scale follows from the fix, not the power."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from homeward.diagnosis.explain.drive import Drive
from homeward.diagnosis.explain.hypothesis import Hypothesis, Instrument, Setting, Term
from homeward.diagnosis.fit.parameter_groups import WithEffects
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.signals import Array, usual_step_s
from homeward.diagnosis.rules import SAME_ODOMETER
from homeward.physics.effects import Parameter

_FIX_S = 5.0

INSTRUMENT = Instrument(
    "odometry_scale",
    (Parameter("scale", "1", -0.5, 1.0, "relative error of the speed reading"),),
    "The odometer reads too much or too little: an instrument, not physics.",
    "speed reading = (1 + scale) speed",
    "worn or swapped wheels",
    ("speed_mps", "base_distance_m"),
    ("viscous",),
)


def _by_run(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    ratios = _ratios(setting.runs)
    if min(ratios) <= 0.0:
        return  # it moves without driving
    scale = np.array(ratios) / min(ratios, key=lambda ratio: abs(ratio - 1.0)) - 1.0
    scale[np.abs(scale) < SAME_ODOMETER] = 0.0
    if not scale.any() or (scale <= -1.0).any():
        return
    off = replace(setting.present, speed_factors=(1.0 / (1.0 + scale)).tolist())
    change = setting.parameters.predict(setting.runs, setting.theta, off) - setting.predicted
    usual = float(np.mean(scale[scale != 0.0]))
    low, high = sorted((0.7 * usual, 1.3 * usual))
    yield Term(one, change[:, None] / usual, np.array([low]), np.array([high]), fixed=True)


def _ratios(runs: Runs) -> list[float]:
    """Path by the odometer over path by the fix, a number per run."""
    ratios = []
    for run in runs.signals:
        # Over some seconds: the noise of a position would add up to a way of its own.
        every = max(1, round(_FIX_S / usual_step_s(run.time_s)))
        path_m = np.concatenate(([0.0], np.cumsum(np.abs(run.speed_mps[:-1]) * np.diff(run.time_s))))[::every]
        straight = np.abs(np.diff(run.base_distance_m[::every]))
        away = straight > 0.5 * np.diff(path_m)  # not round a bend, where the distance from base says little
        covered_m = float(straight[away].sum())
        ratios.append(float(np.diff(path_m)[away].sum()) / covered_m if covered_m > 0.0 else 1.0)
    return ratios


def _on_drive(one: Hypothesis, drive: Drive, size: float, shape: Mapping[str, float]) -> Array:
    return drive.predict(drive.fit.theta, WithEffects(speed_factors=[1.0 / (1.0 + size)])) - drive.plain


HYPOTHESIS = Hypothesis(
    INSTRUMENT,
    steady=_by_run,
    shown_by=(),
    check="drive along a tape measure and compare the distance with the log",
    on_drive=_on_drive,
)
