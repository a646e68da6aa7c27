"""Errors in variables: the prediction error that noise of the channels causes, and whether a
residual exceeds it."""

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

# Channels whose errors may be confounded with an effect of the channel; of any other, its own.
_SOURCES = {
    "accel_mps2": ("speed_mps",),
    "base_distance_m": SMOOTHED,
    "heading_rad": SMOOTHED,
    "time_s": SMOOTHED,
}


def channel_error(fit: Fitted, runs: Runs, channel: str = "time_s") -> float:
    """Expected squared prediction error, summed over windows, from channel errors that are
    confounded with an effect of `channel`.

    The error of a smoothed channel is correlated with its value, over the length of smoothing, and
    repeats where the same ground is driven again. Where place predicts a slope better than its own
    noisy channel does, a hidden grade would be confounded with that slope.
    """
    total = 0.0
    for name in _SOURCES.get(channel, (channel,)):
        has_error = any(name in run.error for run in runs.signals)
        if name in SMOOTHED and has_error:
            above = fit.parameters.predict(_shifted(runs, name, 1.0), fit.theta)
            below = fit.parameters.predict(_shifted(runs, name, -1.0), fit.theta)
            # a central difference over two errors
            total += float(np.sum((above - below) ** 2)) / 4.0
    return total


def _shifted(runs: Runs, name: str, sign: float) -> Runs:
    """The runs with a channel shifted by its error, slopes by the largest of all runs: an elevation
    without a step seems exact. At rest the speed is exact."""
    errors = [run.error.get(name, 0.0) for run in runs.signals]
    largest = max(errors)
    shifted = []
    for run, run_error in zip(runs.signals, errors, strict=True):
        values: Array = getattr(run, name)
        is_slope = name == "grade_rad" and name in run.context
        error = largest if is_slope else run_error
        shift: float | Array = sign * thresholds.SMOOTHING_ERROR * error
        if name == "speed_mps":
            shift = shift * (values != 0.0)
        shifted.append(dataclasses.replace(run, **{name: values + shift}))  # type: ignore[arg-type]
    return dataclasses.replace(runs, signals=shifted)


def tilt_error(fit: Fitted, runs: Runs) -> float:
    """Rms error of the prediction from one standard error of the slope sensor's tilt, which acts as
    rolling resistance does."""
    per_kg = fit.groups.jacobian[:, ROLLING] / fit.parameters.scale[ROLLING]
    rms_per_kg = float(np.sqrt(np.mean(per_kg**2)))
    # A small slope adds its angle to the coefficient of rolling resistance.
    resistance_kg = runs.tilt_error_rad * float(fit.theta[MASS])
    return resistance_kg * rms_per_kg


def meter_error(runs: Runs) -> float:
    """Squared scale error of a power meter, summed over windows, W^2 or A^2."""
    return thresholds.GAIN_ERROR**2 * float(runs.observed @ runs.observed)


def reliability(name: str, runs: Runs) -> float:
    """Share of the variance of a channel over windows that is signal, 1 where it was not
    smoothed."""
    if name not in runs.context:
        return 1.0
    errors = np.array([run.error.get(name, 0.0) for run in runs.signals])
    error_variance = float(np.mean((thresholds.SMOOTHING_ERROR * errors) ** 2))
    if error_variance <= 0.0:
        return 1.0
    variance = float(np.nanvar(runs.context[name]))
    return variance / (variance + error_variance)


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
    """Dependencies of power that no channel measures in some run; current does not depend on the
    sensing rate."""
    missing = [influence for influence in _INFLUENCES if not any(map(runs.has, influence.channels))]
    if runs.unit == "A":
        return [influence for influence in missing if "sensing_hz" not in influence.channels]
    return missing


def is_autocorrelated(residual: Array, runs: Runs) -> bool:
    """Whether a residual, (windows,), has a lag-one autocorrelation of `NEARLY_ALL` or more, unlike
    noise of power."""
    same_run = runs.run[1:] == runs.run[:-1]
    products = residual[1:] * residual[:-1]
    lag_one = float(products[same_run].sum())
    return lag_one >= thresholds.NEARLY_ALL * float(residual @ residual)


def unexplained(fit: Fitted, runs: Runs) -> bool:
    """Whether a fit has a material, autocorrelated residual above the noise though all dependencies
    were recorded."""
    if not is_material(fit, runs) or not is_autocorrelated(runs.observed - fit.predicted, runs):
        return False
    return not unrecorded(runs) and times_noise(fit, runs) > thresholds.TWICE


def is_material(fit: Fitted, runs: Runs) -> bool:
    """Whether the residual of a fit exceeds `MATERIAL_SHARE` of what was recorded."""
    residual = runs.observed - fit.predicted
    squared_share = thresholds.MATERIAL_SHARE**2
    return float(residual @ residual) >= squared_share * float(runs.observed @ runs.observed)


def power_noise(runs: Runs) -> float:
    """Squared white noise of power, summed over windows."""
    # The variance of a mean falls with its length: that of a second is the variance of a sample
    # times its length.
    of_a_second = np.array(
        [white_noise(run.observed) ** 2 * median_step_s(run.time_s) for run in runs.signals]
    )
    of_window = of_a_second[runs.run] / runs.duration_s
    return float(of_window.sum())


def times_noise(fit: Fitted, runs: Runs) -> float:
    """Squared error of a fit over the largest that noise of power and of the other channels
    explains."""
    residual = runs.observed - fit.predicted
    largest = channel_error(fit, runs) + power_noise(runs)
    return float(residual @ residual) / max(largest, 1e-300)
