"""Prior: the spread of robots, winds and ground, and the errors of instruments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Prior(NamedTuple):
    """Means and standard deviations (`sd`) of a mission's hidden variables, and of the instruments' errors.

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
    soc_error: float = 0.0  # of the same, of an error that lasts, as of a lag or of a curve that is not the battery's
    soc_error_lasts: float = 0.1  # energy used until it fades to 1/e, over the file's usable. Chosen: a tenth
    soc_lag_s: float = 0.0  # time constant by which the state of charge lags
    slope_noise: float = 0.0  # of a reading of a slope's sine
    slope_offset: float = 0.0  # of all those readings, as of a sensor that is mounted at a tilt; 0: none are read
    slope_within_place: float = 0.003  # of the sine along a place about its mean: ground is less even than its map
    model_knows_slopes: float = 1.0  # whether modelled energies use the true slopes (1) or the slopes as read (0)
    model_error: float = 0.001  # of a decision's energy, a share: what the model omits

    @property
    def soc_sd(self) -> float:
        """Standard deviation of a reading of the state of charge: its noise, and that of rounding."""
        return float(np.hypot(self.soc_step / 12.0**0.5, self.soc_noise))


STATES = 14
"""Number of states of a hypothesis, named in the next lines."""
GAIN, ROLLING, WEIGHT, EAST, NORTH, GUST_EAST, GUST_NORTH = range(7)
OFFSET, ROLLED, CLIMB, USED, PER_CAPACITY, SOC_ERROR, TILT = range(7, STATES)
"""States of a hypothesis. Energies are as metered, without the meter's offset, over the file's usable energy.

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
"""Hypotheses of a wind that the forecast lacks, in all directions. Chosen: neighbours are 3.4 m/s apart (chord of a
circle of `missed_mps`), about three of their standard deviations."""
_AROUND, _SHARE, _APART = 6, 0.6, 1.6
"""Hypotheses of the forecast: number around the central one, its probability, and their distance in standard
deviations, so that winds with equal readings are not all in one. Chosen: each has 23 % of the variance,
so that all together have that of the forecast."""
_FORECASTS = _APART * np.array(
    [(0.0, 0.0)] + [(np.cos(a), np.sin(a)) for a in 2.0 * np.pi * np.arange(_AROUND) / _AROUND]
)
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
    n, f = len(forecast_mps), len(_FORECASTS)
    mean, covariance = np.zeros((n, HYPOTHESES, STATES)), np.zeros((n, HYPOTHESES, STATES, STATES))
    mean[..., GAIN], mean[..., ROLLING], mean[..., WEIGHT] = 1.0, prior.rolling * prior.mass, prior.mass
    mean[..., PER_CAPACITY] = (1.0 + (prior.capacity_sd / prior.capacity) ** 2) / prior.capacity
    # To first order in gain, resistance and mass.
    slopes = np.array(
        [[1.0, 0.0, 0.0], [prior.rolling * prior.mass, prior.mass, prior.rolling], [prior.mass, 0.0, 1.0]]
    )
    covariance[..., :3, :3] = slopes @ np.diag(np.square([prior.gain_sd, prior.rolling_sd, prior.mass_sd])) @ slopes.T
    covariance[..., OFFSET, OFFSET] = (prior.offset_sd_w / full_j) ** 2
    capacity_sd = np.hypot(prior.capacity_sd, prior.capacity * prior.gain_sd)
    covariance[..., PER_CAPACITY, PER_CAPACITY] = (capacity_sd / prior.capacity**2) ** 2
    covariance[..., SOC_ERROR, SOC_ERROR] = prior.soc_error**2
    covariance[..., TILT, TILT] = prior.slope_offset**2

    # The forecast is of mean wind and gust together.
    wind, gust = prior.wind_sd_mps**2, 2.0 * (prior.gust_share * prior.wind_sd_mps) ** 2
    per_total = 1.0 / (wind + gust + prior.forecast_sd_mps**2) if wind else 0.0
    wind_left = wind - wind * wind * per_total
    own = wind_left * (1.0 - 0.5 * _SHARE * _APART**2)
    for axis in range(2):
        given = forecast_mps[:, None, axis]
        moved = np.sqrt(wind_left) * _FORECASTS[:, axis]
        # If the mean wind differs, so does the gust that is compatible with the forecast.
        regression = -gust * per_total * wind / wind_left if wind else 0.0
        mean[:, :f, EAST + axis] = wind * per_total * given + moved
        mean[:, :f, GUST_EAST + axis] = gust * per_total * given + regression * moved
        gust_left = gust - gust * gust * per_total - regression**2 * wind_left
        covariance[:, :f, EAST + axis, EAST + axis] = own
        covariance[:, :f, GUST_EAST + axis, GUST_EAST + axis] = gust_left + regression**2 * own
        covariance[:, :f, EAST + axis, GUST_EAST + axis] = regression * own
        covariance[:, :f, GUST_EAST + axis, EAST + axis] = regression * own
    around = 2.0 * np.pi * np.arange(_RING) / _RING
    mean[:, f:, EAST], mean[:, f:, NORTH] = prior.missed_mps * np.cos(around), prior.missed_mps * np.sin(around)
    for axis in range(2):
        covariance[:, f:, EAST + axis, EAST + axis] = prior.missed_sd_mps**2
        covariance[:, f:, GUST_EAST + axis, GUST_EAST + axis] = (prior.gust_share * prior.missed_mps) ** 2
    probability = np.empty((n, HYPOTHESES))
    probability[:, 0] = (1.0 - prior.missed) * (1.0 - _SHARE)
    probability[:, 1:f] = (1.0 - prior.missed) * _SHARE / _AROUND
    probability[:, f:] = prior.missed / _RING
    return mean, covariance, probability
