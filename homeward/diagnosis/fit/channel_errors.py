"""Errors in variables: the prediction error that noise of the channels causes, and whether a residual exceeds it."""

import dataclasses
from typing import NamedTuple

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.parameter_groups import MASS, ROLLING
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.noise import white_noise
from homeward.logs.channels import Array
from homeward.logs.times import median_step_s

SMOOTHED = ("speed_mps", "yaw_rate_radps", "grade_rad")
"""Channels whose standard error is known, from smoothing."""

_OWN = {"accel_mps2": ("speed_mps",), "base_distance_m": SMOOTHED, "heading_rad": SMOOTHED, "time_s": SMOOTHED}


def channel_error(fit: Fitted, runs: Runs, channel: str = "time_s") -> float:
    """Expected squared prediction error, summed over windows, from channel errors that are confounded with an effect of
    `channel`.

    The error of a smoothed channel is correlated with its value, over the length of smoothing, and repeats where the
    same ground is driven again. Where place predicts a slope better than its own noisy channel does, a hidden grade
    would be confounded with that slope.
    """
    total = 0.0
    for name in _OWN.get(channel, (channel,)):
        if name in SMOOTHED and any(name in run.error for run in runs.signals):
            sides = [fit.parameters.predict(_moved(runs, name, sign), fit.theta) for sign in (1.0, -1.0)]
            total += float(np.sum((sides[0] - sides[1]) ** 2)) / 4.0
    return total


def _moved(runs: Runs, name: str, sign: float) -> Runs:
    """The runs with a channel shifted by its error, slopes by the largest of all runs: an elevation without a step
    seems exact. At rest the speed is exact."""
    moved, largest = [], max(run.error.get(name, 0.0) for run in runs.signals)
    for run in runs.signals:
        values: Array = getattr(run, name)
        error = largest if name == "grade_rad" and name in run.context else run.error.get(name, 0.0)
        size = sign * thresholds.SMOOTHING_ERROR * error * (values != 0.0 if name == "speed_mps" else 1.0)
        moved.append(dataclasses.replace(run, **{name: values + size}))  # type: ignore[arg-type]
    return dataclasses.replace(runs, signals=moved)


def tilt_error(fit: Fitted, runs: Runs) -> float:
    """Rms error of the prediction from one standard error of the slope sensor's tilt, which acts as rolling resistance
    does."""
    per_kg = fit.groups.jacobian[:, ROLLING] / fit.parameters.scale[ROLLING]
    return runs.tilt_error_rad * float(fit.theta[MASS]) * float(np.sqrt(np.mean(per_kg**2)))


def meter_error(runs: Runs) -> float:
    """Squared scale error of a power meter, summed over windows, W^2 or A^2."""
    return thresholds.GAIN_ERROR**2 * float(runs.observed @ runs.observed)


def reliability(name: str, runs: Runs) -> float:
    """Share of the variance of a channel over windows that is signal, 1 where it was not smoothed."""
    if name not in runs.context:
        return 1.0
    values = runs.context[name]
    signal = float(np.nanvar(values))
    wrong = float(np.mean([run.error.get(name, 0.0) ** 2 for run in runs.signals]))
    return signal / (signal + wrong) if wrong > 0.0 else 1.0


class Influence(NamedTuple):
    """What power depends on beside speed, the channels that measure it, and what to record."""

    what: str
    channels: tuple[str, ...]
    record: str


_INFLUENCES = (
    Influence("slopes", ("grade_rad",), "grade_rad or elevation_m"),
    Influence("turns", ("yaw_rate_radps", "wheel_difference_mps"), "yaw_rate_radps"),
    Influence("the sensing rate", ("sensing_hz",), "sensing_hz"),
)


def unrecorded(runs: Runs) -> list[Influence]:
    """Dependencies of power that no channel measures in some run; current does not depend on the sensing rate."""
    missing = [one for one in _INFLUENCES if not any(map(runs.has, one.channels))]
    return missing if runs.unit == "W" else [one for one in missing if "sensing_hz" not in one.channels]


def is_autocorrelated(residual: Array, runs: Runs) -> bool:
    """Whether a residual, (windows,), has a lag-one autocorrelation of `NEARLY_ALL` or more, unlike noise of power."""
    together = runs.run[1:] == runs.run[:-1]
    return float((residual[1:] * residual[:-1])[together].sum()) >= thresholds.NEARLY_ALL * float(residual @ residual)


def unexplained(fit: Fitted, runs: Runs) -> bool:
    """Whether a fit has a material, autocorrelated residual above the noise though all dependencies were recorded."""
    persistent = is_material(fit, runs) and is_autocorrelated(runs.observed - fit.predicted, runs)
    return persistent and not unrecorded(runs) and times_noise(fit, runs) > thresholds.TWICE


def is_material(fit: Fitted, runs: Runs) -> bool:
    """Whether the residual of a fit exceeds `MATERIAL_SHARE` of what was recorded."""
    residual = runs.observed - fit.predicted
    return float(residual @ residual) >= thresholds.MATERIAL_SHARE**2 * float(runs.observed @ runs.observed)


def power_noise(runs: Runs) -> float:
    """Squared white noise of power, summed over windows."""
    of_a_second = np.array([white_noise(run.observed) ** 2 * median_step_s(run.time_s) for run in runs.signals])
    return float((of_a_second[runs.run] / runs.duration_s).sum())


def times_noise(fit: Fitted, runs: Runs) -> float:
    """Squared error of a fit over the largest that noise of power and of the other channels explains."""
    residual = runs.observed - fit.predicted
    return float(residual @ residual) / max(channel_error(fit, runs) + power_noise(runs), 1e-300)
