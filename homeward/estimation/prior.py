"""Prior: the spread of robots, winds and ground, and the errors of instruments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Prior(NamedTuple):
    """Means and standard deviations (`sd`) of a mission's hidden variables, and of the instruments'
    errors.

    The defaults are those of `uncertain` missions with exact instruments.
    """

    capacity: float = 0.9  # of the battery, over the file's usable energy: U(0.8, 1)
    capacity_sd: float = 0.058
    rolling: float = 1.05  # resistance over the file's: U(0.8, 1.3)
    rolling_sd: float = 0.144
    mass: float = 1.1  # over the file's: 1 + U(0, 0.2)
    mass_sd: float = 0.058
    wind_sd_mps: float = 1.5  # of each component of the mean wind
    forecast_sd_mps: float = 1.0  # of each component of a forecast, about the wind at the start
    gust_share: float = 0.3  # standard deviation of each component of the gusts over the mean wind
    gust_s: float = 1040.0  # their correlation time, log-uniform between the next two
    shortest_gust_s: float = 300.0
    longest_gust_s: float = 3600.0
    missed: float = 0.05  # probability that the forecast is of another wind
    missed_mps: float = 4.5  # strength of the mean wind then, U(3, 6), from any direction
    missed_sd_mps: float = 1.2
    patch_m: float = np.inf  # mean distance between changes of the ground
    patch_sd: float = 0.0  # of such a change, over the file's rolling resistance
    gain_sd: float = 0.0  # of the power meter, a share
    offset_sd_w: float = 0.0  # of the power meter
    power_noise: float = 0.0  # of a reading of power, a share of it
    soc_step: float = 0.0  # of the state of charge, a share
    soc_noise: float = 0.0  # of the same, before rounding
    # of the same, of an error that lasts, as of a lag or of a curve that is not the battery's
    soc_error: float = 0.0
    # energy used until it fades to 1/e, over the file's usable. Chosen: a tenth
    soc_error_lasts: float = 0.1
    soc_lag_s: float = 0.0  # time constant by which the state of charge lags
    slope_noise: float = 0.0  # of a reading of a slope's sine
    # of all those readings, as of a sensor that is mounted at a tilt; 0: none are read
    slope_offset: float = 0.0
    # of the sine along a place about its mean: ground is less even than its map
    slope_within_place: float = 0.003
    # whether modelled energies use the true slopes (1) or the slopes as read (0)
    model_knows_slopes: float = 1.0
    model_error: float = 0.001  # of a decision's energy, a share: what the model omits

    @property
    def soc_sd(self) -> float:
        """Standard deviation of a reading of the state of charge: its noise, and that of
        rounding."""
        return float(np.hypot(self.soc_step / 12.0**0.5, self.soc_noise))


STATES = 14
"""Number of states of a hypothesis, named in the next lines."""
GAIN, ROLLING, WEIGHT, EAST, NORTH, GUST_EAST, GUST_NORTH = range(7)
OFFSET, ROLLED, CLIMB, USED, PER_CAPACITY, SOC_ERROR, TILT = range(7, STATES)
"""States of a hypothesis. Energies are as metered, without the meter's offset, over the file's
usable energy.

GAIN        metered over modelled energy of all but rolling and climbing
ROLLING     metered rolling energy over the file's, where the robot is
WEIGHT      metered climbing energy over the file's
EAST, NORTH             mean wind, towards where it comes from, m/s
GUST_EAST, GUST_NORTH   present deviation from the mean wind, m/s
OFFSET      of the power meter, per second
ROLLED      rolling energy between home and here
CLIMB       the file's climbing energy between home and here beyond that of the slopes as read
USED        energy used so far
PER_CAPACITY            1 over the battery's capacity
SOC_ERROR               of the state of charge as read, a share: the part that lasts
TILT        true sine of the slopes less that of the readings on the way out
"""
_RING = 8
"""Hypotheses of a wind that the forecast lacks, in all directions. Chosen: neighbours are 3.4 m/s
apart (chord of a circle of `missed_mps`), about three of their standard deviations."""
_AROUND = 6
_AROUND_SHARE = 0.6
_APART = 1.6
"""Hypotheses of the forecast: number around the central one, their probability together, and their
distance from it in standard deviations, so that winds with equal readings are not all in one.
Chosen: each has 23 % of the variance, so that all together have that of the forecast."""


def _directions(count: int) -> NDArray[np.float64]:
    """Unit vectors in all directions, east and north, shape (count, 2)."""
    angles_rad = 2.0 * np.pi * np.arange(count) / count
    return np.stack((np.cos(angles_rad), np.sin(angles_rad)), axis=-1)


_FORECASTS = _APART * np.concatenate((np.zeros((1, 2)), _directions(_AROUND)))
HYPOTHESES = len(_FORECASTS) + _RING


def first_hypotheses(
    prior: Prior, full_j: float, forecast_mps: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Means, covariances and probabilities of the hypotheses of missions that begin.

    Args:
        prior: The prior.
        full_j: Usable energy of a full battery by the file.
        forecast_mps: East and north component of the forecast wind, shape (n, 2).

    Returns:
        Shapes (n, HYPOTHESES, STATES), (n, HYPOTHESES, STATES, STATES) and (n, HYPOTHESES).
    """
    count = len(forecast_mps)
    mean = np.zeros((count, HYPOTHESES, STATES))
    covariance = np.zeros((count, HYPOTHESES, STATES, STATES))
    _write_robot(prior, full_j, mean, covariance)
    forecasts = slice(None, len(_FORECASTS))
    ring = slice(len(_FORECASTS), None)
    _write_forecasts(prior, forecast_mps, mean[:, forecasts], covariance[:, forecasts])
    _write_missed(prior, mean[:, ring], covariance[:, ring])
    probability = np.empty((count, HYPOTHESES))
    probability[:, 0] = (1.0 - prior.missed) * (1.0 - _AROUND_SHARE)
    probability[:, 1 : len(_FORECASTS)] = (1.0 - prior.missed) * _AROUND_SHARE / _AROUND
    probability[:, ring] = prior.missed / _RING
    return mean, covariance, probability


def _write_robot(
    prior: Prior, full_j: float, mean: NDArray[np.float64], covariance: NDArray[np.float64]
) -> None:
    """Write what is known of the robot, which all hypotheses share."""
    mean[..., GAIN] = 1.0
    mean[..., ROLLING] = prior.rolling * prior.mass
    mean[..., WEIGHT] = prior.mass
    mean[..., PER_CAPACITY] = (1.0 + (prior.capacity_sd / prior.capacity) ** 2) / prior.capacity
    # To first order: derivatives of gain, rolling and weight (rows) by the meter's gain, resistance
    # and mass (columns).
    jacobian = np.array(
        [
            [1.0, 0.0, 0.0],
            [prior.rolling * prior.mass, prior.mass, prior.rolling],
            [prior.mass, 0.0, 1.0],
        ]
    )
    variances = np.square([prior.gain_sd, prior.rolling_sd, prior.mass_sd])
    covariance[..., :3, :3] = jacobian @ np.diag(variances) @ jacobian.T
    covariance[..., OFFSET, OFFSET] = (prior.offset_sd_w / full_j) ** 2
    capacity_sd = np.hypot(prior.capacity_sd, prior.capacity * prior.gain_sd)
    covariance[..., PER_CAPACITY, PER_CAPACITY] = (capacity_sd / prior.capacity**2) ** 2
    covariance[..., SOC_ERROR, SOC_ERROR] = prior.soc_error**2
    covariance[..., TILT, TILT] = prior.slope_offset**2


def _write_forecasts(
    prior: Prior,
    forecast_mps: NDArray[np.float64],
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
) -> None:
    """Write the winds about the forecast, which is of mean wind and gust together.

    The mean wind given the forecast is the regression on it; what that leaves is shared between the
    distances of the hypotheses and the variance of each. If the mean wind differs, so does the gust
    that is compatible with the forecast.
    """
    wind_variance = prior.wind_sd_mps**2
    gust_variance = 2.0 * (prior.gust_share * prior.wind_sd_mps) ** 2
    per_total = 0.0
    wind_left = wind_variance
    gust_by_wind = 0.0  # regression of the gust on the mean wind, given the forecast
    if wind_variance:
        per_total = 1.0 / (wind_variance + gust_variance + prior.forecast_sd_mps**2)
        wind_left = wind_variance - wind_variance * wind_variance * per_total
        gust_by_wind = -gust_variance * per_total * wind_variance / wind_left
    of_each = wind_left * (1.0 - 0.5 * _AROUND_SHARE * _APART**2)
    gust_left = (
        gust_variance - gust_variance * gust_variance * per_total - gust_by_wind**2 * wind_left
    )
    for axis in range(2):
        wind = EAST + axis
        gust = GUST_EAST + axis
        forecast = forecast_mps[:, None, axis]
        moved = np.sqrt(wind_left) * _FORECASTS[:, axis]
        mean[..., wind] = wind_variance * per_total * forecast + moved
        mean[..., gust] = gust_variance * per_total * forecast + gust_by_wind * moved
        covariance[..., wind, wind] = of_each
        covariance[..., gust, gust] = gust_left + gust_by_wind**2 * of_each
        covariance[..., wind, gust] = gust_by_wind * of_each
        covariance[..., gust, wind] = gust_by_wind * of_each


def _write_missed(prior: Prior, mean: NDArray[np.float64], covariance: NDArray[np.float64]) -> None:
    """Write the winds that the forecast lacks: a ring of strong ones."""
    directions = _directions(_RING)
    for axis in range(2):
        wind = EAST + axis
        gust = GUST_EAST + axis
        mean[..., wind] = prior.missed_mps * directions[:, axis]
        covariance[..., wind, wind] = prior.missed_sd_mps**2
        covariance[..., gust, gust] = (prior.gust_share * prior.missed_mps) ** 2
