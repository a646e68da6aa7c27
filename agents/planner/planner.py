"""Planner on the belief: decides when to turn back, and chooses speed, sensing and stops by
Lagrange multipliers."""

from __future__ import annotations

from statistics import NormalDist
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, Policy, feature
from homeward.agents.belief import Belief, vehicle_of
from homeward.agents.planner import kernel
from homeward.agents.rules.dmax_adaptive import AdaptiveDmaxRule
from homeward.agents.rules.dmax_belief import BeliefDmaxRule
from homeward.agents.rules.dmax_lap import LapRule
from homeward.agents.rules.pace import Pace
from homeward.agents.rules.turn_back import BelievingRule, sees_posts
from homeward.envs.actions import LEVELS, at_level, encode_actions, limits
from homeward.envs.features import INTEREST_UNIT, SINE_UNIT
from homeward.envs.options import Known
from homeward.envs.routes import thresholds as routes_thresholds
from homeward.envs.routes.route import GENERATED_PLACES, INTEREST_DEVIATION, INTEREST_LENGTH
from homeward.envs.sensing import information
from homeward.envs.state import AHEAD, GO, RETURN, STOP
from homeward.estimation.prior import (
    EAST,
    GAIN,
    GUST_EAST,
    GUST_NORTH,
    NORTH,
    PER_CAPACITY,
    ROLLING,
    WEIGHT,
)
from homeward.physics import ancillary_power, d_max

_TYPICAL_SHARE = 2.0 / 3.0
"""Share of a metre's information that half of the fastest sensing rate yields at cruise, see
`envs/options.py`."""


@final
class Planner(Policy):
    """Plans at every decision, up to the turn, with the estimated robot and wind.

    `BeliefDmaxRule` decides when to turn back: a score never falls on the way out, so the best plan
    continues until the energy, less a reserve, is down to that of the way home. A patrol uses
    `LapRule` or, if its pit stops are too short to be observed, `AdaptiveDmaxRule`.

    In a survey, energy and memory have Lagrange multipliers. That of energy is the information
    gained per joule by driving on. That of memory is the cost of sending a sample from the farthest
    useful stop. At every decision, pairs of multipliers are tried. For each the survey is simulated
    to its turn, over the ground in sight and then over the known or forecast ground. The pair with
    the most information determines speed, sensing rate and stops. The oracle uses the same
    multipliers, with full knowledge. At docks it charges as the rule does.

    Args:
        known: Constants of the environment.
        deviations: Reserve in standard deviations of the way home, 0 or above.

    Attributes:
        rule: The rule that decides when to turn back, with its belief.
    """

    def __init__(self, known: Known, deviations: float) -> None:
        self._known = known
        s = known.shared[0]
        robot = known.robot
        self._senses = bool(s["senses"])
        pace = Pace(float(self._senses), 0.0, 1.0)
        self.rule: BelievingRule
        self._belief: Belief | None = None
        self._vehicle = vehicle_of(known)
        if not s["shuttles"]:
            rule = BeliefDmaxRule(known, pace, deviations, float(s["min_speed_mps"]))
            self.rule = rule
            self._belief = rule.belief
        elif sees_posts(known):
            self.rule = LapRule(known, pace, deviations)
        else:
            self.rule = AdaptiveDmaxRule(known, pace, deviations)
        self._model = np.zeros(1, kernel.MODEL_DTYPE)
        model = self._model[0]
        speed_limits, rate_limits = limits(known)
        model["speeds_mps"] = at_level(np.arange(LEVELS), *speed_limits)
        model["rates_hz"] = at_level(np.arange(LEVELS), *rate_limits)
        idle_w = ancillary_power(robot, 0.0)
        model["sensing"] = (ancillary_power(robot, model["rates_hz"]) - idle_w) / s["usable_j"]
        model["standing"] = idle_w / s["usable_j"]
        model["steepest"] = routes_thresholds.STEEPEST_SINE
        sines = np.linspace(
            -routes_thresholds.STEEPEST_SINE,
            routes_thresholds.STEEPEST_SINE,
            model["per_m"].shape[1],
        )
        for level, speed_mps in enumerate(model["speeds_mps"]):
            model["per_m"][level] = 1.0 / np.asarray(
                d_max(robot.without_cutoff(), float(speed_mps), np.arcsin(sines))
            )
        model["interest"] = s["information_per_m"] / _TYPICAL_SHARE
        for speed_level, speed_mps in enumerate(model["speeds_mps"]):
            for rate_level, rate_hz in enumerate(model["rates_hz"]):
                per_m = information(1.0, 1.0, rate_hz / speed_mps, 1.0, s["saturation_per_m"])
                model["found"][speed_level, rate_level] = per_m
        model["spread"] = [_spread(end - start) for start, end in AHEAD]

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission, see `Policy.act`."""
        return self.drive(observations, self.rule.turns(observations, begun))

    def drive(self, observations: Observations, homebound: NDArray[np.bool_]) -> NDArray[Any]:
        """Planned actions of missions that go on or, where `homebound` of shape (n,), head home,
        shape (n, 3).

        `rule.turns` must have been called with the same observations before: it updates the belief.
        """
        s = self._known.shared[0]
        count = len(observations)
        beliefs = self._beliefs(observations)
        outwards = np.ones(count)
        if s["shuttles"]:
            outwards = feature(observations, "outbound")
        ahead = np.where(homebound, -1.0, outwards)
        speed_mps = np.zeros(count)
        sensing_hz = np.zeros(count)
        stops = np.zeros(count)
        kernel.efficient_speeds(
            beliefs, self._vehicle, self._model, self._known.shared, ahead, speed_mps
        )
        if self._senses:
            goes_on = ~homebound
            commands = np.empty((goes_on.sum(), 3))
            kernel.plan(beliefs[goes_on], self._vehicle, self._model, self._known.shared, commands)
            speed_mps[goes_on] = commands[:, 0]
            sensing_hz[goes_on] = commands[:, 1]
            stops[goes_on] = commands[:, 2]
        charges = self.rule.charges
        speed_mps = np.where(charges, s["cruise_mps"], speed_mps)
        sensing_hz = np.where(charges, 0.0, sensing_hz)
        mode = np.where(charges | (stops > 0.0), STOP, np.where(homebound, RETURN, GO))
        actions = encode_actions(self._known, speed_mps, sensing_hz, mode)
        if self._belief:
            looks_back = self._belief.looks_back(observations) & ~homebound & ~charges
            actions[looks_back] = self._belief.back_action
        return actions

    def _beliefs(self, observations: Observations) -> NDArray[np.void]:
        s = self._known.shared[0]
        outlook = self.rule.outlook
        beliefs = np.zeros(len(observations), kernel.BELIEF_DTYPE)
        if self._belief:
            # As shares of the estimated battery, which is smaller than the file's.
            mean = self._belief.estimator.mean()
            beliefs["gain"] = mean[:, GAIN] * mean[:, PER_CAPACITY]
            beliefs["rolling"] = mean[:, ROLLING] * mean[:, PER_CAPACITY]
            beliefs["weight"] = mean[:, WEIGHT] * mean[:, PER_CAPACITY]
            beliefs["wind_east_mps"] = mean[:, EAST] + mean[:, GUST_EAST]
            beliefs["wind_north_mps"] = mean[:, NORTH] + mean[:, GUST_NORTH]
        else:
            beliefs["gain"] = 1.0
            beliefs["rolling"] = 1.0
            beliefs["weight"] = 1.0
        reserve = self.rule.deviations * outlook.deviation
        beliefs["reserve"] = reserve / np.maximum(outlook.home + outlook.onwards, 1e-9)
        # On patrols the rule plans whole laps.
        beliefs["margin"] = np.inf
        if self._belief:
            beliefs["margin"] = self.rule.margin
        beliefs["left_s"] = (
            (1.0 - feature(observations, "time")) * s["max_decisions"] * s["decision_s"]
        )
        beliefs["position_m"] = feature(observations, "distance") * s["reach_m"]
        beliefs["backlog"] = feature(observations, "backlog") * s["backlog_limit"]
        outwards = feature(observations, "outbound")
        for name in ("east", "north"):
            beliefs[name] = outwards * feature(observations, name)
        beliefs["sine_here"] = SINE_UNIT * outwards * feature(observations, "grade")
        beliefs["interest_here"] = INTEREST_UNIT * feature(observations, "interest")
        for stretch, (start, _) in enumerate(AHEAD):
            beliefs["sine_ahead"][:, stretch] = SINE_UNIT * feature(observations, f"grade_{start}")
            beliefs["interest_ahead"][:, stretch] = INTEREST_UNIT * feature(
                observations, f"interest_{start}"
            )
        return beliefs


def _spread(places: int) -> NDArray[np.float64]:
    """Interest of equally frequent kinds of ground in a stretch of generated routes, over its mean,
    shape (kinds,).

    The logarithm of the interest is a Gaussian process (`homeward.envs.routes.route.generate`). Its
    variance within the stretch determines a log-normal distribution, of which each kind is the mean
    between two quantiles.
    """
    count = kernel.MODEL_DTYPE["spread"].shape[-1]
    lags = np.abs(np.subtract.outer(np.arange(places), np.arange(places)))
    correlation = float(np.exp(-lags / (INTEREST_LENGTH * GENERATED_PLACES)).mean())
    deviation = INTEREST_DEVIATION * (1.0 - correlation) ** 0.5
    normal = NormalDist()
    quantiles = [normal.inv_cdf(k / count) for k in range(1, count)]
    # Share of a log-normal variable's mean that its part below a quantile contributes: the
    # probability of a normal variable below that quantile less a deviation.
    shares_below = [0.0, *(normal.cdf(z - deviation) for z in quantiles), 1.0]
    return np.asarray(count * np.diff(shares_below))
