"""Wind and temperature of a mission: drawn at its start, and changing during it at `uncertain` and
`harsh`."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.envs.conditions.draws import GUST_EAST, GUST_NORTH, normal
from homeward.envs.routes.route import LIMITS, WIND_SCALE_MPS
from homeward.physics import model
from homeward.physics.jit import inline

GUSTINESS = 0.3
"""Standard deviation of either part of the wind about its mean, over the mean speed. Chosen between
the turbulence within ten minutes (0.12 to 0.16 by IEC 61400-1) and a wind that turns round:
direction wanders by 17 degrees."""
WANDERS_S = (300.0, 3600.0)
"""Range of its autocorrelation time, s: five minutes to an hour, log-uniform. Chosen: from a part
of a mission on to all of it."""
FORECAST_ERROR_MPS = 1.0
"""Standard deviation of the forecast's error of either component of the wind, m/s. Chosen: two
thirds of the 1.5 m/s by which winds of generated routes vary, so that a forecast is informative and
leaves something to estimate."""
WARMING_K_PER_H = 2.0
"""Largest change of the temperature in an hour, K, within the limits of a route. Chosen: 12 K from
dawn to noon, as on a clear day."""
_COLDEST_C, _HOTTEST_C, _ = LIMITS["temperature_c"]


@inline
def begin(mission: Any, rng: Any, shared: Any, hidden: Any) -> None:
    """Begin the weather of a mission whose mean wind and temperature are in its record.

    With any options the same random numbers are drawn, so that a seed gives the same conditions.
    """
    wanders = rng.random()
    warms = rng.random()
    gust_east = rng.standard_normal()
    gust_north = rng.standard_normal()
    error_east = rng.standard_normal()
    error_north = rng.standard_normal()
    mission.mean_east_mps = mission.wind_mps * np.cos(mission.wind_from_rad)
    mission.mean_north_mps = mission.wind_mps * np.sin(mission.wind_from_rad)
    mission.gust_keeps = 1.0
    mission.gust_kick = 0.0
    mission.gust_east_mps = 0.0
    mission.gust_north_mps = 0.0
    mission.warming_k = 0.0
    if hidden.weather_changes:
        gust_sd_mps = GUSTINESS * mission.wind_mps
        lasts_s = WANDERS_S[0] * (WANDERS_S[1] / WANDERS_S[0]) ** wanders
        mission.gust_keeps = np.exp(-shared.decision_s / lasts_s)
        mission.gust_kick = gust_sd_mps * np.sqrt(1.0 - mission.gust_keeps * mission.gust_keeps)
        mission.gust_east_mps = gust_sd_mps * gust_east
        mission.gust_north_mps = gust_sd_mps * gust_north
        mission.warming_k = WARMING_K_PER_H * (2.0 * warms - 1.0) * shared.decision_s / 3600.0
    mission.forecast_east_mps = mission.mean_east_mps + mission.gust_east_mps
    mission.forecast_north_mps = mission.mean_north_mps + mission.gust_north_mps
    if hidden.forecast_errs:
        mission.forecast_east_mps += FORECAST_ERROR_MPS * error_east
        mission.forecast_north_mps += FORECAST_ERROR_MPS * error_north
        if hidden.hidden_wind:  # the forecast is of another wind
            forecast_sd_mps = np.sqrt(WIND_SCALE_MPS**2 + FORECAST_ERROR_MPS**2)
            mission.forecast_east_mps = forecast_sd_mps * error_east
            mission.forecast_north_mps = forecast_sd_mps * error_north


@inline
def change(mission: Any) -> None:
    """Change the weather from one decision to the next."""
    if mission.gust_kick > 0.0:
        mission.gust_east_mps *= mission.gust_keeps
        mission.gust_north_mps *= mission.gust_keeps
        mission.gust_east_mps += mission.gust_kick * normal(
            mission.key, mission.decisions, GUST_EAST
        )
        mission.gust_north_mps += mission.gust_kick * normal(
            mission.key, mission.decisions, GUST_NORTH
        )
    mission.temperature_c = min(
        max(mission.temperature_c + mission.warming_k, _COLDEST_C), _HOTTEST_C
    )


@inline
def headwind(mission: Any, place: Any) -> Any:
    """Wind against the way out at a place, m/s."""
    east_mps = mission.mean_east_mps + mission.gust_east_mps
    north_mps = mission.mean_north_mps + mission.gust_north_mps
    return model.headwind(east_mps, north_mps, place.east, place.north)
