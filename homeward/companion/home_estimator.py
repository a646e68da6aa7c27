"""The companion's use of the estimator: windows of readings, and the energy that the way home consumes and leaves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.companion import rules
from homeward.companion.advice import UncertainValue
from homeward.companion.gauge import EXPLANATIONS, FOLLOWS, JUMPED, OWN, GaugeTrust, Predicted, prediction
from homeward.companion.prior_knowledge import PriorKnowledge
from homeward.companion.readings import Reading
from homeward.companion.way import RouteLike, Step
from homeward.companion.window import Window
from homeward.estimation import PLAN_DTYPE, READING_DTYPE, Estimator, Margin, vehicle_of
from homeward.estimation.drive import modelled_driving
from homeward.estimation.estimator import NO_WAYS
from homeward.estimation.filter import place_of
from homeward.estimation.home import home_cost, modelled_power
from homeward.estimation.prior import PER_CAPACITY, USED, WEIGHT
from homeward.estimation.tails import normal_risk
from homeward.physics import Robot
from homeward.physics.jit import announce_compilation
from homeward.physics.kernel import full_charge
from homeward.physics.plain import plain
from homeward.physics.terminal_power import at_terminals

_PACE = 0.2
"""Weight of the last window in the present pace. Chosen: some five windows count."""
_EVERY = np.ones(EXPLANATIONS, np.bool_)


class WayHome(NamedTuple):
    """The way home from here.

    Attributes:
        way_m: Its length, m.
        cost_j: Its energy by the robot's own model, J.
        unsure_j: Standard deviation of that without positions, J.
        ways: Its stretches if it is not the way out, `WAY_DTYPE`; otherwise None.
    """

    way_m: float
    cost_j: float
    unsure_j: float
    ways: NDArray[np.void] | None


class HomeEstimator:
    """The estimated robot, and the energy that a way consumes and leaves.

    Args:
        robot: The robot of the file.
        known: Its prior.
        places: Number of places that are kept.
        place_m: Length of a place, m.
        cruise_mps: Speed on the way home, m/s.
        risk: Accepted probability of not getting home.
        route: The route, if there is one.
        forecast_mps: Forecast of the wind: components towards where it comes from, east and north, if there is one.

    Attributes:
        known: The prior, as its meter measures.
        vehicle: Parameters of the robot's own model in the form that the estimator takes.
        windows: Number of windows processed.
        pace_mps: Recent mean speed, including stops.
        pace_w: Recent mean power by the robot's own model, beyond steady driving.
        speed_mps: Last speed reading.
    """

    SAVED: ClassVar = (
        "at_terminals", "estimates", "_extra", "_state", "windows", "pace_mps", "pace_w", "speed_mps", "_heading_rad",
        "gauge", "_explanations",
    )  # fmt: skip

    def __init__(
        self,
        robot: Robot,
        known: PriorKnowledge,
        *,
        places: int,
        place_m: float,
        cruise_mps: float,
        risk: float,
        route: RouteLike | None,
        forecast_mps: tuple[float, float] | None,
    ) -> None:
        announce_compilation()
        self._robot, self._route, self._normal_risk = robot, route, normal_risk(risk)
        self._places, self._forecast_mps = places, forecast_mps or (0.0, 0.0)
        self._known, self._at_terminals = known, False
        self.vehicle = vehicle_of(robot, place_m, cruise_mps)
        self._estimator = Estimator(self.vehicle, known.prior, places, EXPLANATIONS)
        self.at_terminals = False
        self.begin()
        self._compile()

    def _modelled_w(self, robot: Robot, speed_mps: float) -> float:
        """Power by the model of a robot with a full battery at a steady speed on level ground, W."""
        record, state = plain(robot.record()), plain(full_charge(robot))
        state["step_s"] = 1.0
        return float(modelled_power(self.vehicle, record, state, speed_mps, 0.0, 0.0, 0.0, 0.0, 1.0)[0])

    @property
    def at_terminals(self) -> bool:
        """Whether power is voltage times current, which excludes losses inside the battery."""
        return self._at_terminals

    @at_terminals.setter
    def at_terminals(self, measured_so: bool) -> None:
        self._at_terminals = measured_so
        robot = at_terminals(self._robot) if measured_so else self._robot
        self._record = plain(robot.record())
        self.vehicle = self.vehicle._replace(idle_w=self._modelled_w(robot, 0.0))
        prior, share = self._known.prior, self._metered_share
        prior = prior._replace(capacity=share * prior.capacity, capacity_sd=share * prior.capacity_sd)
        self.known = self._known._replace(prior=prior)
        self._estimator.vehicle, self._estimator.prior = self.vehicle, prior

    @property
    def _metered_share(self) -> float:
        """Share of the energy out of the cells that the meter measures at cruise."""
        if not self.at_terminals:
            return 1.0
        cruise_mps = self.vehicle.cruise_mps
        return self._modelled_w(at_terminals(self._robot), cruise_mps) / self._modelled_w(self._robot, cruise_mps)

    def see_terminals(self) -> None:
        """From now on power is voltage times current."""
        if self.at_terminals:
            return
        self.at_terminals = True
        h, share = self._estimator.state["hypotheses"], self._metered_share
        h["mean"][..., PER_CAPACITY] /= share
        h["covariance"][..., PER_CAPACITY, :] /= share
        h["covariance"][..., :, PER_CAPACITY] /= share

    @property
    def estimates(self) -> NDArray[np.void]:
        """States of the estimator, shape (EXPLANATIONS,): that of the believed explanation of the gauge first."""
        return self._estimator.state

    @estimates.setter
    def estimates(self, estimates: NDArray[np.void]) -> None:
        self._estimator.state[:] = estimates

    def begin(self) -> None:
        """Restart from the prior."""
        self._state = plain(full_charge(self._robot))
        self.gauge, self._explanations = GaugeTrust(), np.arange(EXPLANATIONS)
        east_mps, north_mps = np.repeat(np.array(self._forecast_mps)[:, None], EXPLANATIONS, axis=1)
        self._estimator.begin(_EVERY, east_mps, north_mps)
        self._estimator.state["hypotheses"]["covariance"][..., WEIGHT, WEIGHT] += self.known.weight_sd**2
        self._extra, self.windows = np.zeros(self._places), 0
        self.pace_mps, self.pace_w = self.vehicle.cruise_mps, self.vehicle.idle_w
        self.speed_mps = self._heading_rad = math.nan
        if self._route is not None:
            places = self.places
            places["sine"] = places["sine_driven"] = np.sin(self._route.grade_rad)
            places["east"], places["north"] = np.cos(self._route.heading_rad), np.sin(self._route.heading_rad)
            places["readings"] = 1.0

    def _compile(self) -> None:
        """Run every kernel once, without a lasting effect."""
        kept = self._estimator.state.copy()
        reading = np.zeros(1, READING_DTYPE)
        reading["time_s"], reading["position_m"], reading["east"] = 1.0, self.vehicle.place_m, 1.0
        self._estimator.update(reading, _EVERY[:1])
        self._estimator.relocate(0.5 * self.vehicle.place_m)
        self.leaves(self.way_home(1.0, 0.0))
        self._estimator.state[:] = kept

    @property
    def places(self) -> NDArray[np.void]:
        """Notes on the places of the way out, shape (places,)."""
        places: NDArray[np.void] = self._estimator.state["places"][0]
        return places

    @property
    def soc(self) -> float:
        """State of charge by the energy drawn, 0 to 1."""
        spent, per_capacity = self._estimator.mean()[0, [USED, PER_CAPACITY]]
        return float(self._estimator.state["robot"]["soc_start"][0] - spent * per_capacity)

    @property
    def used(self) -> float:
        """Energy drawn, over that of a full battery by the robot's file."""
        return float(self._estimator.mean()[0, USED])

    @property
    def driving_w(self) -> float:
        """Power half way between standing and driving at cruise on level ground, by the robot's own model."""
        return self.vehicle.idle_w + rules.DRIVES * modelled_driving(self.vehicle, 0.0, self.vehicle.cruise_mps) * (
            self.vehicle.cruise_mps
        )

    def recharge(self, soc: float, *, as_read: bool) -> None:
        """Replace the battery by one of a given state of charge, with the prior of its capacity.

        Args:
            soc: State of charge, as a share of the energy.
            as_read: Whether the gauge shows that, and nobody else says so.
        """
        self._estimator.recharge(soc, self.known.prior.soc_sd)
        self.gauge, self._explanations = GaugeTrust(), np.arange(EXPLANATIONS)
        if as_read:
            h = self._estimator.state["hypotheses"][OWN]
            h["covariance"][:, USED, USED] += (rules.OWN_START_SD / h["mean"][:, PER_CAPACITY]) ** 2

    def model(self, reading: Reading, step: Step) -> tuple[float, float, float]:
        """Power since the last reading by the robot's own model, see `modelled_power`, W."""
        if reading.dt_s <= 0.0:
            self.speed_mps, self._heading_rad = reading.speed_mps, step.heading_rad
            return 0.0, 0.0, 0.0
        speed = abs(reading.speed_mps) if math.isfinite(reading.speed_mps) else step.way_m / reading.dt_s
        before = abs(self.speed_mps) if math.isfinite(self.speed_mps) else speed
        turn = math.remainder(step.heading_rad - self._heading_rad, math.tau)
        sine = math.sin(reading.grade_rad) if math.isfinite(reading.grade_rad) else 0.0
        self._state["speed_mps"], self._state["step_s"] = before, reading.dt_s
        powers: tuple[float, float, float] = modelled_power(
            self.vehicle, self._record, self._state, speed, reading.sensing_hz, (speed - before) / reading.dt_s, sine,
            turn / reading.dt_s if math.isfinite(turn) else 0.0, 1.0,
        )  # fmt: skip
        if math.isfinite(reading.speed_mps):
            self.speed_mps = reading.speed_mps
        if math.isfinite(step.heading_rad):
            self._heading_rad = step.heading_rad
        return powers

    @contextmanager
    def with_open(self, window: Window, position_m: float) -> Iterator[None]:
        """Temporarily include a window that is not over yet."""
        kept = self._estimator.state.copy()
        try:
            if window.time_s > 0.0:
                self._update(window, position_m)
            yield
        finally:
            self._estimator.state[:] = kept

    def add_window(self, window: Window, position_m: float) -> None:
        """Process a finished window, and note its ground and pace.

        Args:
            window: A window of positive length.
            position_m: Way home at its end, m.
        """
        predicted, used_before = self._predicted_soc(), self._used_without_gauge()
        self._update(window, position_m, every=True)
        self._weigh_gauge(window.soc, predicted, used_before)
        self.windows += 1
        place_m, here = self.vehicle.place_m, place_of(self.vehicle, position_m, self._extra)
        self.pace_mps = (1.0 - _PACE) * self.pace_mps + _PACE * (window.way_m / window.time_s)
        self.pace_w = (1.0 - _PACE) * self.pace_w + _PACE * ((window.other_j - window.extra_j) / window.time_s)
        if window.way_m > rules.DRIVEN_SHARE * place_m:
            extra = window.extra_j / window.way_m
            share = min(window.way_m / place_m, 1.0)
            self._extra[here] += (extra - self._extra[here]) * (share if self._extra[here] else 1.0)

    def _weigh_gauge(self, soc: float, before: Predicted, used_before: UncertainValue) -> None:
        """Weigh the explanations of the gauge by a window's reading, and put the believed one first.

        Args:
            soc: The reading, as a share of the energy; NaN: none.
            before: Prediction at the start of the window, if the gauge follows the charge.
            used_before: Energy used by then, without the gauge, over that of a full battery by the robot's file.
        """
        used = self._used_without_gauge()
        self.gauge.see(soc, before.after(used.mean - used_before.mean, used.sd**2 - used_before.sd**2))
        states = self._estimator.state
        if self.gauge.surely_follows:
            states[self._place_of(JUMPED)] = states[self._place_of(FOLLOWS)]
        elif self.gauge.surely_not:
            states[self._place_of(FOLLOWS)] = states[self._place_of(self.gauge.believed)]
        swapped = [0, self._place_of(self.gauge.believed)]
        states[swapped] = states[swapped[::-1]]
        self._explanations[swapped] = self._explanations[swapped[::-1]]

    def _place_of(self, explanation: int) -> int:
        """Where the estimate by an explanation of the gauge is."""
        return int(np.flatnonzero(self._explanations == explanation)[0])

    def _predicted_soc(self) -> Predicted:
        """Prediction of a gauge that follows the charge."""
        state = self._estimator.state[self._place_of(FOLLOWS)]
        return prediction(state["hypotheses"], state["robot"], self.known.prior)

    def _used_without_gauge(self) -> UncertainValue:
        """Energy used by power alone, over that of a full battery by the robot's file."""
        estimate, place = self._estimator.estimate(), self._place_of(OWN)
        return UncertainValue(
            float(estimate.mean[place, USED]), math.sqrt(max(float(estimate.covariance[place, USED, USED]), 0.0))
        )

    def _update(self, window: Window, position_m: float, *, every: bool = False) -> None:
        """Update the estimator with a window: by the believed explanation of the gauge, or by every one."""
        robot = self._estimator.state["robot"][0]
        change_m = position_m - float(robot["position_m"])
        straight = window.straight(change_m)
        outwards = change_m >= 0.0 or not straight
        sign = 1.0 if outwards else -1.0
        reading = np.zeros(1, READING_DTYPE)
        r = reading[0]
        r["time_s"] = float(robot["time_s"]) + window.time_s
        r["position_m"] = position_m if straight else float(robot["position_m"]) + window.way_m
        r["power_w"], r["soc"] = window.power_w, window.soc
        # If slopes are read often enough, they are known within a place, and not only on average.
        often = window.slopes > 1 and window.way_m <= rules.OFTEN * self.vehicle.place_m * window.slopes
        r["modelled_j"] = window.modelled_j if often and math.isfinite(window.sine) else np.nan
        r["other_j"] = window.other_j - self.vehicle.idle_w * window.time_s
        r["speed_mps"] = window.speed_mps
        east, north = window.direction
        # Without a direction: straight out, so that a wind that helped on the way out is against the robot on the way
        # home.
        r["east"], r["north"] = (sign * east, sign * north) if math.isfinite(east) else (1.0, 0.0)
        r["sine"] = sign * window.sine if math.isfinite(window.sine) else self._sine_noted(float(r["position_m"]))
        prior = self.known.with_unexplained(window.way_m)
        changes: dict[str, float] = {}
        if math.isnan(window.sine) and window.way_m > 0.0 and self._route is None:
            changes["slope_noise"] = rules.NO_SLOPE_SD
        changes["power_noise"] = math.hypot(prior.power_noise * window.of_the_mean, window.power_noise)
        self._estimator.prior = prior._replace(**changes)
        readings = np.repeat(reading, EXPLANATIONS if every else 1)
        readings["soc"][self._explanations[: len(readings)] != FOLLOWS] = np.nan
        self._estimator.update(readings, _EVERY[: len(readings)])
        self._estimator.prior = self.known.prior
        if not straight:
            self._estimator.relocate(position_m)

    def _sine_noted(self, position_m: float) -> float:
        """Slope that the route has, 0 without one."""
        if self._route is None:
            return 0.0
        return math.sin(self._route.grade_rad[place_of(self.vehicle, position_m, self._route.grade_rad)])

    def way_home(self, way_m: float, unsure_m: float, ways: NDArray[np.void] | None = None) -> WayHome:
        """The way home and its energy by the robot's own model.

        Args:
            way_m: Its length; of `ways`, their total length.
            unsure_m: Standard deviation of that without positions.
            ways: Its stretches if it is not the way out, `WAY_DTYPE`.
        """
        if ways is None:
            cost_j = float(home_cost(self.vehicle, self.places, self._extra, way_m))
        else:
            cost_j = self._at_cruise_j(ways) + self._standing_j(way_m)
        return WayHome(way_m, cost_j, unsure_m * (cost_j / max(way_m, self.vehicle.place_m)), ways)

    def leaves(self, home: WayHome, onwards_m: float = 0.0) -> Margin:
        """Energy left at home after driving on at the present pace, and then home."""
        plan = self._plan(onwards_m, home.cost_j)
        plan["elsewhere"], plan["unsure_j"] = float(home.ways is not None), home.unsure_j
        return self._margin(plan, home.ways, home.way_m + 2.0 * onwards_m)

    def ahead(self, ways: NDArray[np.void], other_j: float = 0.0) -> UncertainValue:
        """Energy that a way from here consumes, by the present estimates, J as metered.

        Args:
            ways: Its stretches, `homeward.estimation.WAY_DTYPE`, shape (m,).
            other_j: Energy by the robot's own model for all but steady driving on it, J: standing, turning.
        """
        total = self._over(ways, self._at_cruise_j(ways) + other_j)
        return UncertainValue(float(total["cost_j"]), float(total["cost_sd_j"]))

    def after(self, ways: NDArray[np.void]) -> UncertainValue:
        """Energy left after a way from here, see `ahead`, if only standing and steady driving consume energy, J."""
        total = self._over(ways, self._at_cruise_j(ways) + self._standing_j(float(ways["way_m"].sum())))
        return UncertainValue(float(total["margin_j"]), float(total["margin_sd_j"]))

    def _over(self, ways: NDArray[np.void], cost_j: float) -> np.void:
        """Energy that a way from here consumes and leaves, `MARGIN_DTYPE`, given its energy by the robot's own
        model."""
        plan = self._plan(0.0, cost_j)
        plan["elsewhere"] = 1.0
        total: np.void = self._margin(plan, ways, float(ways["way_m"].sum())).total[0]
        return total

    def _plan(self, onwards_m: float, home_cost_j: float) -> NDArray[np.void]:
        """Plan of driving on at the present pace, and then home."""
        plans = np.zeros(1, PLAN_DTYPE)
        plan, v = plans[0], self.vehicle
        pace_mps = max(self.pace_mps, self._robot.min_speed_mps)
        plan["onwards_m"], plan["onwards_s"] = onwards_m, onwards_m / pace_mps
        plan["speed_mps"] = min(max(pace_mps, rules.SLOWEST_MPS), self._robot.max_speed_mps)
        plan["onwards_j"] = max(self.pace_w, v.idle_w) * plan["onwards_s"]
        plan["home_mps"], plan["home_cost_j"], plan["sine"] = v.cruise_mps, home_cost_j, np.nan
        plan["knows_ahead"] = float(self._route is not None)
        return plans

    def _margin(self, plan: NDArray[np.void], ways: NDArray[np.void] | None, way_m: float) -> Margin:
        """Energy that a plan leaves."""
        self._estimator.prior = self.known.with_unexplained(way_m)
        margin = self._estimator.margin(plan, self._normal_risk, NO_WAYS if ways is None else ways)
        self._estimator.prior = self.known.prior
        return margin

    def _at_cruise_j(self, ways: NDArray[np.void]) -> float:
        """Energy of steady driving over a way, by the robot's own model."""
        v = self.vehicle
        return sum(modelled_driving(v, float(one["sine"]), v.cruise_mps) * float(one["way_m"]) for one in ways)

    def _standing_j(self, way_m: float) -> float:
        """Energy of standing for as long as a way takes at cruise."""
        return self.vehicle.idle_w / self.vehicle.cruise_mps * way_m
