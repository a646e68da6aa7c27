"""The prior of a robot: from the uncertainty in its file, or from generic ranges."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from homeward.companion import thresholds
from homeward.estimation import Prior
from homeward.estimation import thresholds as estimation_thresholds
from homeward.estimation.tails import scale_of
from homeward.physics import Robot, ancillary_power, model, optimal_speed
from homeward.physics.uncertainty import Uncertainty

_GENERIC = Prior(
    missed=estimation_thresholds.MISSED,
    gain_sd=0.01 / 3.0**0.5,  # the instruments `meter` of the environments
    power_noise=0.005,
    soc_step=1e-3,
    slope_noise=1e-3,
    slope_offset=thresholds.SLOPE_OFFSET,
    model_knows_slopes=0.0,
    model_error=thresholds.OMITTED,
)
"""The ranges of `uncertain` missions: capacity 0.8 to 1 of the file's, rolling resistance 0.8 to
1.3, payload up to a fifth of the mass, wind within 1.5 m/s. The errors of a gauge that counts are
COUNTER_SD and those that follow it."""


class PriorKnowledge(NamedTuple):
    """The prior and its origin.

    Attributes:
        prior: Prior of the estimator.
        words: Its origin, a sentence each.
        uncertainty: The table of the robot's file, if it has one.
        weight_sd: Relative standard deviation of the energy of climbing, beyond that of the prior.
        idle_sd: Relative standard deviation of the power at rest, beyond that of the prior.
        meter_sd: Relative standard deviation of the meter's gain alone, by which what the battery
            holds is read.
        capacity_is_fitted: Whether the capacity was measured; otherwise it is within the range of
            ageing batteries.
    """

    prior: Prior
    words: tuple[str, ...]
    uncertainty: Uncertainty | None = None
    weight_sd: float = 0.0
    idle_sd: float = 0.0
    meter_sd: float = _GENERIC.gain_sd
    capacity_is_fitted: bool = False

    def with_unexplained(self, way_m: float) -> Prior:
        """The prior with the error that unexplained power makes over a way."""
        if self.uncertainty is None:
            return self.prior
        error = math.hypot(
            self.prior.model_error, scale_of(self.uncertainty.unexplained_over(way_m))
        )
        return self.prior._replace(model_error=error)

    def with_capacity(self, capacity: float) -> PriorKnowledge:
        """The same with a capacity that was measured, over that of the robot's file."""
        sd = thresholds.MEASURED_CAPACITY_SD * capacity
        words = f"a measured capacity of {capacity:.0%} of the file's, within {thresholds.MEASURED_CAPACITY_SD:.1%}"
        return self._replace(
            prior=self.prior._replace(capacity=capacity, capacity_sd=sd),
            words=(*(text for text in self.words if text != _OLD_CELLS), words),
            capacity_is_fitted=True,
        )


_OLD_CELLS = "the robot's file states no uncertainty of the battery's capacity: 80 to 100 %"


def known_of(robot: Robot, has_forecast: bool) -> PriorKnowledge:
    """The prior of a robot.

    Args:
        robot: The robot, with the uncertainty of its file, if it has one.
        has_forecast: Whether there is a forecast of the wind.
    """
    if has_forecast:
        prior = _GENERIC
        wind = "a wind as forecast, within 1 m/s"
    else:
        prior = _GENERIC._replace(forecast_sd_mps=np.inf)
        wind = "an unknown wind, 1.5 m/s either way"
    uncertainty = robot.uncertainty
    if uncertainty is not None and uncertainty.of == "force":
        return _as_measured(uncertainty, prior, wind)
    if uncertainty is None or uncertainty.of != "energy":
        generic = (
            f"the file of {robot.name!r} states no uncertainty: generic ranges (capacity 80 to 100 %, rolling "
            f"resistance 80 to 130 %, payload up to 20 %, power at rest within {thresholds.IDLE_SD:.0%}, "
            f"{thresholds.OMITTED:.0%} of a way's energy that the model omits)"
        )
        return PriorKnowledge(prior, words=(generic, wind), idle_sd=thresholds.IDLE_SD)
    prior, weight_sd = _as_sure_as(uncertainty, prior, robot)
    words: tuple[str, ...] = (
        f"uncertainty from the robot's file: {uncertainty.source or 'no source given'}",
        wind,
    )
    # A capacity that was fitted is one by the robot's own meter, so that it includes the meter's
    # gain.
    capacity_is_fitted = "capacity" in uncertainty.fitted
    own_meter_sd = 0.0
    if not capacity_is_fitted:
        words = (*words, _OLD_CELLS)
        own_meter_sd = _GENERIC.gain_sd
    meter_sd = math.hypot(
        own_meter_sd, dict(uncertainty.instruments).get("power_gain", 0.0) / 3.0**0.5
    )
    return PriorKnowledge(
        prior=prior,
        words=words,
        uncertainty=uncertainty,
        weight_sd=weight_sd,
        meter_sd=meter_sd,
        capacity_is_fitted=capacity_is_fitted,
    )


def _as_measured(uncertainty: Uncertainty, prior: Prior, wind: str) -> PriorKnowledge:
    """The generic prior with what a coast-down test and a scale measured; the rest stays as wide as
    it was."""
    rolling_variance = uncertainty.variance("rolling")
    mass_variance = uncertainty.variance("mass")
    weight_sd = 0.0
    if rolling_variance is not None:
        # The test measured resistance times mass; mass alone matters on climbs.
        weight_sd = prior.mass_sd
        if mass_variance is not None:
            weight_sd = math.sqrt(mass_variance)
        prior = prior._replace(
            rolling=1.0, rolling_sd=math.sqrt(rolling_variance), mass=1.0, mass_sd=0.0
        )
    elif mass_variance is not None:
        prior = prior._replace(mass=1.0, mass_sd=math.sqrt(mass_variance))
    idle_variance = uncertainty.variance("idle_power")
    idle_sd = thresholds.IDLE_SD
    if idle_variance is not None:
        idle_sd = math.sqrt(idle_variance)
    ranges = ["capacity 80 to 100 %"]
    if "rolling" not in uncertainty.fitted:
        ranges.append("rolling resistance 80 to 130 %")
    if "mass" not in uncertainty.fitted:
        ranges.append("payload up to 20 %")
    if "idle_power" not in uncertainty.fitted:
        ranges.append(f"power at rest within {thresholds.IDLE_SD:.0%}")
    ranges.append(f"{thresholds.OMITTED:.0%} of a way's energy that the model omits")
    words = (
        f"measured at the wheels: {uncertainty.source}, of {', '.join(uncertainty.fitted)}",
        f"generic ranges of the rest ({', '.join(ranges)})",
        wind,
    )
    return PriorKnowledge(prior, words, weight_sd=weight_sd, idle_sd=idle_sd)


def _as_sure_as(uncertainty: Uncertainty, prior: Prior, robot: Robot) -> tuple[Prior, float]:
    """The generic prior changed by a file's table, and the relative standard deviation of the
    energy of climbing.

    The file was fitted with the robot's own meter, so it includes the meter's gain. Parameters that
    were held fixed agree with the recordings as they are.
    """
    rolling_share = _rolling_share(robot)
    mass_variance = uncertainty.variance("mass")
    capacity_variance = uncertainty.variance("capacity")
    # Variances as shares of the total power.
    rolling_variance = (uncertainty.variance("rolling") or 0.0) * rolling_share**2
    idle_variance = (uncertainty.variance("idle_power") or 0.0) * (1.0 - rolling_share) ** 2
    if uncertainty.between_runs is None:
        rolling_variance = prior.rolling_sd**2 * rolling_share**2
        between_variance = thresholds.BETWEEN_RUNS**2
    else:
        # What differs between runs includes the file's own error.
        all_variance = scale_of(uncertainty.between_runs) ** 2
        between_variance = max(all_variance - (rolling_variance + idle_variance), 0.0)
    # Differences between runs may be due to the ground or anything else: one half each.
    prior = prior._replace(
        rolling=1.0,
        rolling_sd=math.sqrt(rolling_variance + 0.5 * between_variance) / rolling_share,
        # The fit is of rolling resistance times mass; mass alone matters on climbs.
        mass=1.0,
        mass_sd=0.0,
        gain_sd=math.sqrt(idle_variance + 0.5 * between_variance),
        model_error=thresholds.LEAST_MODEL_ERROR,
    )
    if "drag" in uncertainty.fitted:
        # Power that grows with the square of the speed need not be air drag: the wind acts at most
        # on the frontal area.
        most_drag_ns2_per_m2 = thresholds.MOST_AIR * robot.mass_kg ** (2.0 / 3.0)
        wind_share = min(most_drag_ns2_per_m2 / max(robot.drag_ns2_per_m2, 1e-9), 1.0)
        prior = prior._replace(
            wind_sd_mps=wind_share * prior.wind_sd_mps,
            missed_mps=wind_share * prior.missed_mps,
            missed_sd_mps=wind_share * prior.missed_sd_mps,
        )
    if capacity_variance is not None:
        capacity_sd = max(math.sqrt(capacity_variance), thresholds.LEAST_CAPACITY_SD)
        prior = prior._replace(capacity=1.0, capacity_sd=capacity_sd)
    instruments = dict(uncertainty.instruments)
    if "power_gain" in instruments:
        prior = prior._replace(
            gain_sd=math.hypot(prior.gain_sd, instruments["power_gain"] / 3.0**0.5)
        )
    prior = prior._replace(
        power_noise=instruments.get("power_noise", prior.power_noise),
        soc_step=instruments.get("soc_step", prior.soc_step),
        soc_noise=instruments.get("soc_noise", prior.soc_noise),
        soc_lag_s=instruments.get("soc_lag_s", prior.soc_lag_s),
        slope_noise=instruments.get("grade_noise", prior.slope_noise),
    )
    weight_sd = _GENERIC.mass_sd
    if mass_variance is not None:
        weight_sd = math.sqrt(mass_variance)
    return prior, weight_sd


def _rolling_share(robot: Robot) -> float:
    """Share of rolling in the power at the speed with the longest range, on level ground."""
    speed = float(optimal_speed(robot))
    rolling_w = float(model.drive_power(robot, model.rolling_force(robot), speed))
    return rolling_w / (rolling_w + float(ancillary_power(robot, 0.0)))
