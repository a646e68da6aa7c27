"""What is known of a robot beforehand: what its file says of its own uncertainty, or generic ranges."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from homeward.estimation import Prior
from homeward.physics import Robot, ancillary_power, model, optimal_speed
from homeward.physics.uncertainty import Uncertainty

_GENERIC = Prior(
    missed=0.2,  # as the shield: a wind that no forecast tells of
    gain_sd=0.01 / 3.0**0.5,  # the instruments `meter` of the environments
    power_noise=0.005,
    soc_step=1e-3,
    slope_noise=1e-3,
    model_knows_slopes=0.0,
    model_error=0.006,  # as the environments' agents where the weather changes
)
"""The ranges of `uncertain` missions: capacity 0.8 to 1 of the file's, rolling resistance 0.8 to 1.3, payload up to a
fifth of the mass, wind of 1.5 m/s either way, and a battery monitor with a shunt."""


class Known(NamedTuple):
    """What is known beforehand.

    Attributes:
        prior: For the estimator.
        words: Where it comes from, a sentence each.
        uncertainty: What the robot's file says of its own, if it does.
    """

    prior: Prior
    words: tuple[str, ...]
    uncertainty: Uncertainty | None = None

    def with_unexplained(self, way_m: float) -> Prior:
        """The prior with the error that what nothing explains makes over a way."""
        if self.uncertainty is None:
            return self.prior
        error = math.hypot(self.prior.model_error, self.uncertainty.unexplained_over(way_m))
        return self.prior._replace(model_error=error)


_OLD_CELLS = "its file does not say how sure the battery's capacity is: 80 to 100 %"


def known_of(robot: Robot, has_forecast: bool) -> Known:
    """What is known of a robot beforehand.

    Args:
        robot: With the uncertainty that its file has, if it has one.
        has_forecast: Whether there is a forecast of the wind.
    """
    prior = _GENERIC if has_forecast else _GENERIC._replace(forecast_sd_mps=np.inf)
    wind = "a wind as forecast, within 1 m/s" if has_forecast else "an unknown wind, 1.5 m/s either way"
    given = robot.uncertainty
    if given is None:
        return Known(prior, (
            f"the file of {robot.name!r} does not say how sure it is: generic ranges (capacity 80 to 100 %, rolling "
            "resistance 80 to 130 %, payload up to 20 %)", wind,
        ))  # fmt: skip
    rolling, mass = given.variance("rolling"), given.variance("mass")
    if rolling is None and given.between_runs is not None:
        rolling = 0.0  # nothing was fitted, but it is known how far runs are from what the file says
    idle, capacity = given.variance("idle_power"), given.variance("capacity")
    mass_sd = prior.mass_sd if mass is None else math.sqrt(mass)
    if rolling is not None:
        # What was fitted is resistance times mass, of which the mass is a part.
        rolling += (given.between_runs or 0.0) ** 2 / _rolling_share(robot) ** 2
        rolling_sd = math.sqrt(max(rolling - mass_sd**2, 1e-6))
        prior = prior._replace(rolling=1.0, mass=1.0, mass_sd=mass_sd, rolling_sd=rolling_sd)
    if capacity is not None:
        prior = prior._replace(capacity=1.0, capacity_sd=max(math.sqrt(capacity), 1e-3))
    read = dict(given.instruments)
    gain = read.get("power_gain", 3.0**0.5 * prior.gain_sd) / 3.0**0.5
    prior = prior._replace(
        gain_sd=math.hypot(gain, math.sqrt(idle or 0.0) * (1.0 - _rolling_share(robot))),
        power_noise=read.get("power_noise", prior.power_noise), soc_step=read.get("soc_step", prior.soc_step),
        soc_noise=read.get("soc_noise", prior.soc_noise), soc_lag_s=read.get("soc_lag_s", prior.soc_lag_s),
        slope_noise=read.get("grade_noise", prior.slope_noise),
    )  # fmt: skip
    words = (f"the robot's file says how sure it is: {given.source or 'no source given'}", wind)
    return Known(prior, words if capacity is not None else (*words, _OLD_CELLS), given)


def _rolling_share(robot: Robot) -> float:
    """Share of rolling in the power at the speed with the longest range, on the flat."""
    speed = float(optimal_speed(robot))
    rolling_w = float(model.drive_power(robot, model.rolling_force(robot), speed))
    return rolling_w / (rolling_w + float(ancillary_power(robot, 0.0)))
