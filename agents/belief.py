"""The belief: a posterior of robot, wind and way home, by `homeward.estimation` from an
environment's observations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward import estimation
from homeward.agents.base import Observations, feature
from homeward.envs.actions import encode_actions
from homeward.envs.conditions.gauges import LOST, lowest_believed
from homeward.envs.conditions.weather import FORECAST_ERROR_MPS, GUSTINESS, WANDERS_S
from homeward.envs.features import SINE_UNIT, WIND_UNIT_MPS
from homeward.envs.options import Known
from homeward.envs.routes.route import HIDDEN_WIND_MPS, KNOTS, NEW_PATCH, WIND_SCALE_MPS
from homeward.envs.state import RETURN
from homeward.estimation import READING_DTYPE, Estimator, Margin, Prior, StateEstimate, Vehicle
from homeward.estimation import thresholds as estimation_thresholds
from homeward.estimation.excitation import looks_back

_SQRT_3 = 3.0**0.5  # from half the width of a uniform number to its standard deviation
_ON_BORDER = 1e-4
"""Share of a place within which a robot counts as being on its border. Chosen: above the rounding
of the observed distance, in single precision (6e-8 of up to 64 places)."""
_AHEAD = 1e-6
"""Share of a place by which it is then moved into the next one. Chosen: above rounding, and no
distance."""


def prior_of(known: Known, missed: float) -> Prior:
    """Prior of the missions of an environment, from the table of its difficulty and the sizes of
    its instruments.

    Args:
        known: Constants of the environment.
        missed: Probability that the forecast is of another wind.
    """
    d = known.difficulty
    i = known.instruments
    s = known.shared[0]
    hides = not d.route_is_known
    conditions = 0  # row of the model's errors: known, uncertain, or with weather that changes
    if d.weather_changes:
        conditions = 2
    elif hides:
        conditions = 1
    surface = d.surface
    # Roughness after a change is 0 in one of two cases and otherwise U(0, 1), times the gain of the
    # surface.
    gain_square = surface.mean**2 + surface.deviation**2
    mean = surface.mean / 4.0
    patch_sd = (2.0 * (gain_square / 6.0 - mean**2)) ** 0.5
    patch_m = np.inf
    if patch_sd > 0.0:
        patch_m = float(s["length_m"]) / (KNOTS * NEW_PATCH)
    return Prior(
        capacity=d.health.mean,
        capacity_sd=d.health.deviation,
        rolling=d.rolling.mean,
        rolling_sd=d.rolling.deviation,
        mass=1.0 + d.payload.mean,
        mass_sd=d.payload.deviation,
        wind_sd_mps=WIND_SCALE_MPS if hides else 0.0,
        forecast_sd_mps=FORECAST_ERROR_MPS if hides else 0.0,
        gust_share=GUSTINESS if d.weather_changes else 0.0,
        gust_s=(WANDERS_S[0] * WANDERS_S[1]) ** 0.5,
        shortest_gust_s=WANDERS_S[0],
        longest_gust_s=WANDERS_S[1],
        missed=missed if hides else 0.0,
        missed_mps=sum(HIDDEN_WIND_MPS) / 2.0,
        patch_m=patch_m,
        patch_sd=patch_sd,
        gain_sd=i.power_gain / _SQRT_3,
        offset_sd_w=float(s["power_offset_w"]) / _SQRT_3,
        power_noise=i.power_noise,
        soc_step=i.soc_step,
        soc_noise=i.soc_noise,
        soc_error=float(s["soc_error"]),
        soc_lag_s=i.soc_lag_s,
        slope_noise=i.grade_noise,
        slope_within_place=0.0,
        model_knows_slopes=0.0,
        model_error=estimation_thresholds.MODEL_ERRORS[conditions],
    )


def vehicle_of(known: Known) -> Vehicle:
    """The robot's own model, from the constants of an environment."""
    s = known.shared[0]
    return estimation.vehicle_of(known.robot, float(s["place_m"]), float(s["cruise_mps"]))


class Belief:
    """Estimates the hidden variables of missions from their observations.

    Args:
        known: Constants of the environment.
        missed: Probability that the forecast is of another wind.

    Attributes:
        estimator: The estimator.
        back_action: Action of an excitation step.
    """

    def __init__(self, known: Known, missed: float) -> None:
        s = known.shared[0]
        self._known = known
        self._prior = prior_of(known, missed)
        self._vehicle = vehicle_of(known)
        self.back_action = encode_actions(known, s["min_speed_mps"], 0.0, RETURN)[0]
        # In shorter pit stops, turns can be missed: the distance driven is then unknown, and there
        # is no update.
        self._sees_turns = bool(s["pit_stop_s"] == 0.0 or s["pit_stop_s"] >= s["decision_s"])
        self._forget(0)

    def _forget(self, count: int) -> None:
        self.estimator = Estimator(
            self._vehicle, self._prior, int(self._known.shared["places"][0]), count
        )
        self._modelled, self._position_m, self._supplied_j = np.zeros((3, count))
        self._place = np.full(count, -1)
        self._decisions = np.zeros(count, np.int64)
        self._soc_lowest = np.ones(count)

    def learn(
        self,
        observations: Observations,
        begun: NDArray[np.bool_],
        asked: NDArray[np.bool_] | None = None,
    ) -> None:
        """Update with observations of missions; a repeated one counts once.

        Args:
            observations: Shape (n, features).
            begun: Missions that have just begun, shape (n,).
            asked: Missions to update, shape (n,); by default all.
        """
        s = self._known.shared[0]
        if len(begun) != len(self._place):
            self._forget(len(begun))
        if begun.any():
            self._begin(observations, begun)
        outwards = feature(observations, "outbound")
        places_from_home = feature(observations, "distance") * s["reach_m"] / s["place_m"]
        on_border = np.abs(places_from_home - np.rint(places_from_home)) < _ON_BORDER
        # On a border the place ahead is observed: on the way out the next one.
        places_from_home = np.where(
            on_border & (outwards > 0.0), np.rint(places_from_home) + _AHEAD, places_from_home
        )
        position_m = places_from_home * s["place_m"]
        modelled = feature(observations, "modelled")
        readings = np.zeros(len(begun), READING_DTYPE)
        decisions = np.rint(feature(observations, "time") * s["max_decisions"]).astype(np.int64)
        later = decisions > self._decisions
        self._decisions = decisions
        readings["time_s"] = self._decisions * s["decision_s"]
        readings["position_m"] = position_m
        readings["charged_j"] = self._charged_j(observations)
        readings["power_w"] = np.nan
        if self._sees_turns:
            readings["power_w"] = feature(observations, "power") * s["cruise_w"]
        # Beside a charger's power, that of the robot is not read well.
        charging = readings["charged_j"] > 0.0
        readings["power_w"][charging] = np.nan
        readings["soc"] = self._soc(observations, charging)
        readings["modelled_j"] = (modelled - self._modelled) * s["usable_j"]
        # It is 0 where a robot has come to an end of the route: the estimator then takes the way
        # over the time.
        readings["speed_mps"] = feature(observations, "speed") * s["max_speed_mps"]
        readings["east"] = outwards * feature(observations, "east")
        readings["north"] = outwards * feature(observations, "north")
        place = places_from_home.astype(np.int64)
        # The slope read on the way out belongs to the place: reading it twice gives no information.
        outbound = (outwards > 0.0) & (position_m >= self._position_m)
        new = (place != self._place) & outbound & later
        readings["sine"] = np.where(
            new, SINE_UNIT * outwards * feature(observations, "grade"), np.nan
        )
        self._place = np.where(new, place, self._place)
        updated = ~begun
        if asked is not None:
            updated &= asked
        self.estimator.update(readings, updated)
        self._modelled = modelled
        self._position_m = position_m

    def _begin(self, observations: Observations, begun: NDArray[np.bool_]) -> None:
        """Begin missions anew, those where `begun`, with the forecast that they observe."""
        east_mps = WIND_UNIT_MPS * feature(observations, "forecast_east")
        north_mps = WIND_UNIT_MPS * feature(observations, "forecast_north")
        self.estimator.begin(begun, east_mps, north_mps)
        self._modelled[begun] = 0.0
        self._position_m[begun] = 0.0
        self._supplied_j[begun] = 0.0
        self._place[begun] = -1
        self._decisions[begun] = 0
        self._soc_lowest[begun] = 1.0

    def _soc(self, observations: Observations, charging: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Readings of the gauge, shape (n,): NaN once it was reset, which shows in a rise without a
        charger."""
        soc = feature(observations, "energy")
        self._soc_lowest[charging & (self._soc_lowest != LOST)] = 1.0
        self._soc_lowest = lowest_believed(self._soc_lowest, soc)
        return np.where(self._soc_lowest == LOST, np.nan, soc)

    def _charged_j(self, observations: Observations) -> Any:
        """Energy that a charger supplied since the last observation, J, shape (n,); 0 without
        docks."""
        if not self._known.shared["dock_count"][0]:
            return 0.0
        charged_j = feature(observations, "supplied") * self._known.shared["usable_j"][0]
        since_last_j = charged_j - self._supplied_j
        self._supplied_j = charged_j
        return since_last_j

    def forget_forecast(self) -> None:
        """Ignore the forecast of the wind, whatever missions observe; to be called before they
        begin."""
        self._prior = self._prior._replace(forecast_sd_mps=np.inf)
        self._forget(0)

    def recharge(self, soc: float) -> None:
        """Set another state of charge at the start of missions, 0 to 1."""
        self.estimator.recharge(soc, self._prior.soc_sd)

    def looks_back(self, observations: Observations) -> NDArray[np.bool_]:
        """Whether the next decision should be an excitation step: towards home, and then out again,
        shape (n,).

        This reverses the relative wind and nothing else. It is never used where one decision makes
        a return final.
        """
        decision_s = float(self._known.shared["decision_s"][0])
        changes = self._known.difficulty.weather_changes
        due = looks_back(
            self._decisions, self._position_m, self._vehicle.cruise_mps, decision_s, changes
        )
        out = feature(observations, "outbound") > 0.0
        may = (
            not self._known.difficulty.route_is_known
            and self._known.shared["return_decisions"][0] > 1
        )
        return np.asarray(due & out & may)

    def plans(self, observations: Observations, home_mps: float | None = None) -> NDArray[np.void]:
        """Plans of heading home now, see `homeward.estimation.Estimator.plans`; with the slope
        ahead."""
        home_cost_j = feature(observations, "home_cost") * self._known.shared["usable_j"][0]
        plans = self.estimator.plans(home_cost_j, home_mps)
        plans["sine"] = SINE_UNIT * feature(observations, "grade_1")
        return plans

    def margin(self, plans: NDArray[np.void], risk: float) -> Margin:
        """Margins of plans, see `homeward.estimation.Estimator.margin`; without the quantile if the
        risk is 0."""
        return self.estimator.margin(plans, risk)

    def estimate(self) -> StateEstimate:
        """Parameters and wind, see `homeward.estimation.Estimator.estimate`."""
        return self.estimator.estimate()
