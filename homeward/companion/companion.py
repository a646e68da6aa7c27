"""The companion: readings of a robot in, advice on its way home out.

It is `homeward.estimation`, the code by which planner and shield decide, fed with readings in SI units as they come.
"""

from __future__ import annotations

import base64
import dataclasses
import json
import math
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.companion.advice import Action, Advice, Spread
from homeward.companion.beforehand import Beforehand, known_of
from homeward.companion.checks import check_home, check_number, check_route, check_wind
from homeward.companion.cutoff import Cutoff
from homeward.companion.policy import OnboardPolicy
from homeward.companion.readings import POSITION_M, CompanionError, Position, Reading, Readings, checked_position
from homeward.companion.turning import chance, latest
from homeward.companion.way import RouteLike, Step, Way, along_route, back_over
from homeward.companion.window import Window
from homeward.companion.words import rests_on
from homeward.estimation import (
    PLAN_DTYPE,
    READING_DTYPE,
    WAY_DTYPE,
    Estimator,
    Margin,
    Prior,
    Vehicle,
    vehicle_of,
)
from homeward.estimation.drive import modelled_driving
from homeward.estimation.excitation import looks_back
from homeward.estimation.home import home_cost, modelled_power
from homeward.estimation.prior import PER_CAPACITY, USED, WEIGHT
from homeward.estimation.tails import normal_risk
from homeward.files import read_json, write_whole
from homeward.physics import Robot, d_max, load_robot, optimal_speed
from homeward.physics.jit import announce_first_compilation
from homeward.physics.kernel import full_charge
from homeward.physics.metered import at_terminals

_WINDOWS = 200.0
"""Readings that the estimator takes in while the battery lasts at cruise, as decisions of the environments."""
_LONGEST_PLACES, _PLACES = 160.0, 128
"""Places of a d_max, and how many are kept: the way home of a robot that is to come home is shorter than 0.8 d_max."""
_CRUMBS = 8.0
"""Crumbs of the trail per place."""
_OFTEN = 0.2
"""Of a place, for which a slope that is read stands at most, to be taken for that of the way since the reading before.
One reading a window may be of the other direction of travel, where the robot has just turned: taken for that of the
way, it turns 60 missions of benchmarks/on_the_robot/companion.py home at 82 % of the shield's distance, not 96 %."""
_NO_SLOPE_SD = 0.04
"""Standard deviation of a slope's sine where none is read: that of generated routes."""
_DETOUR = 1.3
"""Way by ground over the straight line, where a home that moved lies off the trail. Roads have 1.2 to 1.5 (Ballou and
others, Transportation Research A 36, 2002)."""
_RECKONING = 0.1
"""Standard deviation of a way that was reckoned from speed and heading, as a share."""
_MOST_CUTOFF = 1.2
"""Cut-off voltage over the nominal one beyond which no battery has it."""
_UNTOLD, _UNTOLD_WINDOWS = 0.1, 3
"""State of charge by which a gauge must differ from what was drawn, and windows in a row for which, to be another
battery, or stuck: monitors that go by voltage are off by some per cent."""
_SCHEMA = 1


class Companion:
    """Says how far home is, how sure that is, and when to turn.

    Readings may come at any times; what was read in a while is summed up and taken in by the estimator, 200 times while
    the battery lasts. In between, every update looks ahead from there. Kernels compile at construction.

    Args:
        robot: Preset name, path of a robot file, or a `Robot`. Where its file has `[uncertainty]`, that is used, else
            generic ranges.
        home: Where home is: `(east, north)` in metres in the frame of the positions, `"here"` for where the first
            reading is, or None where positions are metres from home along the way.
        route: The route, such as `homeward.envs.routes.load_route` reads: home is its start, and what lies ahead
            is known. Its coordinates begin at home.
        risk: Of not getting home that is accepted, within (0, 0.5].
        soc: State of charge at the start, a share; what the first reading says, or full, if left out.
        forecast_mps: Forecast of the wind, towards where it comes from, east and north; unknown if left out.
        cutoff_v: Voltage at which the battery is cut off.
        cruise_mps: Speed on the way home; that with the longest range if left out.
        window_s: Time over which readings are summed up.
        place_m: Length over which ground is taken to be alike.
        reaction_s: Time from advice to turn until the robot has turned; a window if left out.
        arrived_m: Way home within which the robot is at home, where `turn_now` ends.
        prior: What is known beforehand, instead of what follows from the robot's file.
        policy: To be asked for actions, such as `homeward.agents.onboard.load_onboard("ppo", "OutAndBack")` answers.

    Raises:
        RobotError: There is no such robot, or its file is wrong.
        CompanionError: Another argument cannot be used.

    >>> companion = Companion("husky", home="here")
    >>> for second in range(600):
    ...     advice = companion.update(
    ...         float(second), speed_mps=1.0, power_w=150.0, soc=1.0 - 150.0 * second / 1.73e6, heading_rad=0.0
    ...     )
    >>> round(advice.way_home_m), advice.turn_now, advice.chance_home > 0.999
    (599, False, True)
    """

    def __init__(
        self,
        robot: str | Path | Robot,
        *,
        home: Position | str | None = None,
        route: RouteLike | None = None,
        risk: float = 1e-3,
        soc: float | None = None,
        forecast_mps: tuple[float, float] | None = None,
        cutoff_v: float | None = None,
        cruise_mps: float | None = None,
        window_s: float | None = None,
        place_m: float | None = None,
        reaction_s: float | None = None,
        arrived_m: float = POSITION_M,
        prior: Prior | None = None,
        policy: OnboardPolicy | None = None,
    ) -> None:
        self.robot = load_robot(robot)
        range_m = self._range_m = float(d_max(self.robot))
        if not math.isfinite(range_m):
            raise CompanionError(f"robot {self.robot.name!r} never runs empty on the flat; check what its effects give")
        for name, value, low, high in (
            ("risk", risk, 1e-6, 0.5), ("soc", soc, 0.0, 1.0),
            ("cutoff_v", cutoff_v, 0.1, _MOST_CUTOFF * (self.robot.nominal_voltage_v or math.inf)),
            ("cruise_mps", cruise_mps, 1e-3, self.robot.max_speed_mps), ("window_s", window_s, 0.1, 3600.0),
            ("place_m", place_m, 1e-3 * range_m, range_m), ("reaction_s", reaction_s, 0.0, 3600.0),
            ("arrived_m", arrived_m, 0.0, 1000.0),
        ):  # fmt: skip
            if value is not None:
                check_number(name, value, low, high)
        check_home(home)
        check_wind(forecast_mps)
        check_route(route)
        if policy is not None and policy.robot != self.robot:
            raise CompanionError(
                f"the policy decides for robot {policy.robot.name!r}, which is not, number for number, the companion's "
                f"{self.robot.name!r}; give both the same"
            )
        self._policy = policy
        self.risk, self._normal_risk = risk, normal_risk(risk)
        cruise = float(optimal_speed(self.robot)) if cruise_mps is None else cruise_mps
        self._window_s = range_m / cruise / _WINDOWS if window_s is None else window_s
        self._reaction_s = self._window_s if reaction_s is None else reaction_s
        self._arrived_m = arrived_m
        places = _PLACES
        place_m = range_m / _LONGEST_PLACES if place_m is None else place_m
        if route is not None:
            places, place_m = len(route.grade_rad), float(route.place_m)
        announce_first_compilation()
        self._vehicle, self._at_terminals = vehicle_of(self.robot, place_m, cruise), False
        self._meter(self.robot)
        self._known: Beforehand = (
            known_of(self.robot, forecast_mps is not None) if prior is None else Beforehand(prior, ())
        )
        self._start_soc, self._forecast_mps = soc, forecast_mps
        self._route, self._places, self._crumb_m = route, places, max(place_m / _CRUMBS, 1.0)
        self._home, self._cutoff_v = home, cutoff_v
        self._begin()
        self._compile()

    def _meter(self, robot: Robot) -> float:
        """Reckon with the robot as the meter sees it; answers its power at cruise, W."""
        self._record, self._state = robot.record(), full_charge(robot)
        self._state["step_s"] = 1.0
        standing_w, cruising_w = (
            modelled_power(self._vehicle, self._record, self._state, speed, 0.0, 0.0, 0.0, 0.0, 1.0)[0]
            for speed in (0.0, self._vehicle.cruise_mps)
        )
        self._vehicle = self._vehicle._replace(idle_w=float(standing_w))
        return float(cruising_w)

    def _see_terminals(self) -> None:
        """From now on power is voltage times current: a battery that loses some inside gives less, and draws none."""
        inside, self._at_terminals = self._meter(self.robot), True
        share = self._meter(at_terminals(self.robot)) / inside
        prior = self._known.prior
        prior = prior._replace(capacity=share * prior.capacity, capacity_sd=share * prior.capacity_sd)
        self._known, self._estimator.vehicle, self._estimator.prior = (
            self._known._replace(prior=prior),
            self._vehicle,
            prior,
        )
        h = self._estimator.state["hypotheses"]
        h["mean"][..., PER_CAPACITY] /= share
        h["covariance"][..., PER_CAPACITY, :] /= share
        h["covariance"][..., :, PER_CAPACITY] /= share

    def _begin(self) -> None:
        self._estimator = Estimator(self._vehicle, self._known.prior, self._places, 1)
        forecast = np.array(self._forecast_mps or (0.0, 0.0))
        self._estimator.begin(_ONE, forecast[:1], forecast[1:])
        self._estimator.state["hypotheses"]["covariance"][..., WEIGHT, WEIGHT] += self._known.weight_sd**2
        self._readings = Readings(self.robot)
        self._way = Way(self._home, self._route, self._crumb_m)
        self._cutoff = None if self._cutoff_v is None else Cutoff(self._cutoff_v)
        self._window, self._windows, self._extra = Window(), 0, np.zeros(self._places)
        self._moved_home: Position | None = None
        self._other_way: tuple[RouteLike, float] | None = None
        self._turned, self._charged, self._untold = False, False, 0
        self._pace_mps, self._pace_w = self._vehicle.cruise_mps, self._vehicle.idle_w
        self._speed_mps, self._heading_rad = math.nan, math.nan
        self._has = dict.fromkeys(("power", "soc", "grade", "heading", "position"), False)
        self._advice: Advice | None = None
        self._action: Action | None = None
        if self._policy is not None:
            self._policy.begin()
        if self._route is not None:
            places = self._estimator.state["places"][0]
            places["sine"] = places["sine_driven"] = np.sin(self._route.grade_rad)
            places["east"], places["north"] = np.cos(self._route.heading_rad), np.sin(self._route.heading_rad)
            places["readings"] = 1.0

    def _compile(self) -> None:
        """Run every kernel once; nothing of it stays."""
        kept = self._estimator.state.copy()
        reading = np.zeros(1, READING_DTYPE)
        reading["time_s"], reading["position_m"], reading["east"] = 1.0, self._vehicle.place_m, 1.0
        self._estimator.update(reading, _ONE)
        self._estimator.relocate(0.5 * self._vehicle.place_m)
        home_cost(self._vehicle, self._estimator.state["places"][0], self._extra, 1.0)
        self._estimator.margin(self._plan(0.0, 0.0), self._normal_risk)
        self._estimator.state[:] = kept

    def update(
        self,
        time_s: float,
        *,
        speed_mps: float | None = None,
        power_w: float | None = None,
        voltage_v: float | None = None,
        current_a: float | None = None,
        soc: float | None = None,
        grade_rad: float | None = None,
        heading_rad: float | None = None,
        position: Position | None = None,
        sensing_hz: float | None = None,
        temperature_c: float | None = None,
        interest: float | None = None,
    ) -> Advice:
        """Take in what was read at a time, as much as there is, and advise.

        Args:
            time_s: When, s; any clock that goes on.
            speed_mps: Speed since the reading before, m/s, negative in reverse.
            power_w: Power drawn from the battery since the reading before, W.
            voltage_v: Voltage of the battery, V; with `current_a` instead of `power_w`.
            current_a: Current out of the battery, A, discharge positive.
            soc: State of charge, a share.
            grade_rad: Slope in the direction of travel, rad, uphill positive.
            heading_rad: Direction of travel, rad counter-clockwise from east.
            position: Metres from home along the way, or `(east, north)` in metres.
            sensing_hz: Sensing rate, Hz.
            temperature_c: Temperature of the air, C; for the policy alone, as the next.
            interest: Interest of the ground here, a weight.

        Raises:
            CompanionError: A value is not a number, home was never set, or there is no way to know where the robot is.
        """
        reading = self._readings.take(
            time_s,
            {
                "speed_mps": speed_mps, "power_w": power_w, "voltage_v": voltage_v, "current_a": current_a, "soc": soc,
                "grade_rad": grade_rad, "heading_rad": heading_rad, "position": position, "sensing_hz": sensing_hz,
                "temperature_c": temperature_c, "interest": interest,
            },
        )  # fmt: skip
        if power_w is None and not self._at_terminals and None not in (voltage_v, current_a):
            self._see_terminals()
        if reading is None:
            self._advice = self._advise() if self._advice is None else _with_warnings(self._advice, self._readings)
            return self._advice
        self._charge_first(reading.soc)
        if math.isnan(reading.speed_mps) and reading.position is None and math.isfinite(self._speed_mps):
            reading = reading._replace(speed_mps=self._speed_mps)  # it goes on as it did
        step = self._way.follow(reading)
        self._note(reading, step)
        self._ask_policy(reading, step)
        self._window.add(reading, step, *self._model(reading, step))
        if self._window.time_s >= self._window_s * (1.0 - 1e-6):
            self._flush()
        kept = self._estimator.state.copy()
        if self._window.time_s > 0.0:  # for this advice alone
            self._take_in(self._window)
        self._advice = self._advise()
        self._estimator.state[:] = kept
        return self._advice

    def _ask_policy(self, reading: Reading, step: Step) -> None:
        if self._policy is None:
            return
        asked = self._policy.update(
            self._readings.clock_s, self._way.position_m, speed_mps=abs(reading.speed_mps), power_w=reading.power_w,
            soc=reading.soc, grade_rad=reading.grade_rad, heading_rad=step.heading_rad,
            temperature_c=reading.temperature_c, interest=reading.interest,
        )  # fmt: skip
        self._action = None if asked is None else Action(*asked)

    def swap_battery(self, soc: float = 1.0) -> None:
        """Another battery is in, or the same was charged: what was learned of the old one is dropped.

        Args:
            soc: State of charge that it has, a share.

        Raises:
            CompanionError: It is none.
        """
        check_number("soc", soc, 0.0, 1.0)
        self._flush()
        self._estimator.recharge(soc, self._known.prior.soc_sd)
        self._cutoff = None if self._cutoff_v is None else Cutoff(self._cutoff_v)
        self._turned = False
        if self._policy is not None:
            self._policy.begin()

    def move_home(self, home: Position) -> None:
        """Home is elsewhere now: back along the trail as far as that helps, and then straight on.

        Args:
            home: `(east, north)` in metres, or metres along the way from where home was.

        Raises:
            CompanionError: It is none of these.
        """
        checked = checked_position("home", home)
        if checked is None:
            raise CompanionError(
                f"home = {home!r} is not allowed; give (east, north) in metres, or metres along the way"
            )
        self._moved_home, self._other_way, self._turned = checked, None, False

    def take_home(self, route: RouteLike | None) -> None:
        """From here home by another way than the one out; None: back over the way out again.

        Args:
            route: From here home, such as `homeward.envs.routes.load_route` reads.

        Raises:
            CompanionError: It is no route.
        """
        check_route(route)
        self._other_way = None if route is None else (route, 0.0)
        self._moved_home, self._turned = None, False

    def ahead(self, ways: NDArray[np.void], other_j: float = 0.0) -> Spread:
        """What a way from here takes that was not driven yet, as the robot is known now, metered J.

        Args:
            ways: Its stretches, `homeward.estimation.WAY_DTYPE`, shape (m,).
            other_j: What the robot's own model has for all but driving steadily on it, J: standing, turning.
        """
        total = self._over(ways, self._at_cruise_j(ways) + other_j)
        return Spread(float(total["cost_j"]), float(total["cost_sd_j"]))

    def after(self, ways: NDArray[np.void]) -> Spread:
        """Energy that a way from here leaves, see `ahead`, with nothing taken but standing and driving steadily, J."""
        total = self._over(ways, self._at_cruise_j(ways) + self._standing_j(float(ways["way_m"].sum())))
        return Spread(float(total["margin_j"]), float(total["margin_sd_j"]))

    def _over(self, ways: NDArray[np.void], cost_j: float) -> np.void:
        """What a way from here takes and leaves, `MARGIN_DTYPE`, where the robot's own model has its cost."""
        plan = self._plan(0.0, cost_j)
        plan["elsewhere"], plan["unsure_j"] = 1.0, 0.0
        total: np.void = self._leaves(plan, ways, float(ways["way_m"].sum())).total[0]
        return total

    def _at_cruise_j(self, ways: NDArray[np.void]) -> float:
        """Energy of driving steadily over a way, by the robot's own model."""
        v = self._vehicle
        return sum(modelled_driving(v, float(one["sine"]), v.cruise_mps) * float(one["way_m"]) for one in ways)

    def _standing_j(self, way_m: float) -> float:
        """Energy of standing for as long as a way takes at cruise."""
        return self._vehicle.idle_w / self._vehicle.cruise_mps * way_m

    def _leaves(self, plan: NDArray[np.void], ways: NDArray[np.void], way_m: float) -> Margin:
        """What a plan over some way leaves."""
        self._estimator.prior = self._known.with_unexplained(way_m)
        margin = self._estimator.margin(plan, self._normal_risk, ways)
        self._estimator.prior = self._known.prior
        return margin

    @property
    def vehicle(self) -> Vehicle:
        """Numbers of the robot's own model, as the estimator has them."""
        return self._vehicle

    def _flush(self) -> None:
        """Take in what was read so far."""
        if self._window.time_s > 0.0:
            self._take_in(self._window)
            self._close(self._window)
            self._check_charge(self._window.soc)
            self._window = Window()

    def _check_charge(self, soc: float) -> None:
        """Say where the gauge is far from what was drawn; one that reads less is believed, as is safe."""
        spent, per_capacity = self._estimator.mean()[0, [USED, PER_CAPACITY]]
        above = soc - (float(self._estimator.state["robot"]["soc_start"][0]) - spent * per_capacity)
        self._untold = self._untold + 1 if abs(above) > _UNTOLD else 0
        if self._untold < _UNTOLD_WINDOWS:
            return
        kind = "the state of charge reads"
        text = f"{kind} {abs(above):.0%} {'more' if above > 0.0 else 'less'} than was drawn from it"
        if above > 0.0:
            self._readings.say(f"{text}: stuck, or another battery without a call of swap_battery?", kind)
            return
        self._readings.say(f"{text}: another battery? what was learned of the old one is dropped", kind)
        self._estimator.recharge(soc, self._known.prior.soc_sd)
        self._untold = 0

    def _charge_first(self, soc: float) -> None:
        if self._charged:
            return
        self._charged = True
        start = self._start_soc if self._start_soc is not None else soc
        if math.isfinite(start) and start < 1.0 - 0.5 * self._known.prior.soc_step:
            self._estimator.recharge(start, self._known.prior.soc_sd)

    def _note(self, reading: Reading, step: Step) -> None:
        """Note what there is to go by."""
        for name, value in (
            ("power", reading.power_w), ("soc", reading.soc), ("grade", reading.grade_rad),
            ("heading", step.heading_rad), ("position", math.nan if reading.position is None else 0.0),
        ):  # fmt: skip
            self._has[name] |= math.isfinite(value)
        if self._other_way is not None:
            route, driven_m = self._other_way
            self._other_way = route, driven_m + step.way_m

    def _model(self, reading: Reading, step: Step) -> tuple[float, float, float]:
        """Power since the reading before by the robot's own model, see `modelled_power`, W."""
        if reading.dt_s <= 0.0:
            self._speed_mps, self._heading_rad = reading.speed_mps, step.heading_rad
            return 0.0, 0.0, 0.0
        by_way_mps = step.way_m / reading.dt_s
        speed = abs(reading.speed_mps) if math.isfinite(reading.speed_mps) else by_way_mps
        before = abs(self._speed_mps) if math.isfinite(self._speed_mps) else speed
        turn = math.remainder(step.heading_rad - self._heading_rad, math.tau) if self._has["heading"] else 0.0
        sine = math.sin(reading.grade_rad) if math.isfinite(reading.grade_rad) else 0.0
        self._state["speed_mps"], self._state["step_s"] = before, reading.dt_s
        powers: tuple[float, float, float] = modelled_power(
            self._vehicle,
            self._record, self._state, speed, reading.sensing_hz, (speed - before) / reading.dt_s, sine,
            turn / reading.dt_s if math.isfinite(turn) else 0.0, 1.0,
        )  # fmt: skip
        if math.isfinite(reading.speed_mps):
            self._speed_mps = reading.speed_mps
        if math.isfinite(step.heading_rad):
            self._heading_rad = step.heading_rad
        return powers

    def _take_in(self, window: Window) -> None:
        """Let the estimator take in a window."""
        robot = self._estimator.state["robot"][0]
        change_m = self._way.position_m - float(robot["position_m"])
        straight = window.straight(change_m)
        outwards = change_m >= 0.0 or not straight
        sign = 1.0 if outwards else -1.0
        reading = np.zeros(1, READING_DTYPE)
        r = reading[0]
        r["time_s"] = float(robot["time_s"]) + window.time_s
        r["position_m"] = self._way.position_m if straight else float(robot["position_m"]) + window.way_m
        r["power_w"], r["soc"] = window.power_w, window.soc
        # Slopes that are read often enough are known as they are within a place, and not only in the mean.
        often = window.slopes > 1 and window.way_m <= _OFTEN * self._vehicle.place_m * window.slopes
        r["modelled_j"] = window.modelled_j if often and math.isfinite(window.sine) else np.nan
        r["other_j"] = window.other_j - self._vehicle.idle_w * window.time_s
        r["speed_mps"] = window.speed_mps
        east, north = window.direction
        # Without a direction: straight out, so that a wind that helped on the way out hurts on the way home.
        r["east"], r["north"] = (sign * east, sign * north) if math.isfinite(east) else (1.0, 0.0)
        r["sine"] = sign * window.sine if math.isfinite(window.sine) else self._sine_noted(float(r["position_m"]))
        prior = self._known.with_unexplained(window.way_m)
        changes: dict[str, float] = {}
        if math.isnan(window.sine) and window.way_m > 0.0 and self._route is None:
            changes["slope_noise"] = _NO_SLOPE_SD
        changes["power_noise"] = math.hypot(prior.power_noise * window.of_the_mean, window.power_noise)
        self._estimator.prior = prior._replace(**changes)
        self._estimator.update(reading, _ONE)
        self._estimator.prior = self._known.prior
        if not straight:
            self._estimator.relocate(self._way.position_m)

    def _sine_noted(self, position_m: float) -> float:
        """Slope that the route has, 0 without one."""
        if self._route is None:
            return 0.0
        place = min(int(position_m / self._vehicle.place_m), self._places - 1)
        return float(np.sin(self._route.grade_rad[place]))

    def _close(self, window: Window) -> None:
        """Note what a window says of the ground, the pace and the voltage."""
        self._windows += 1
        v, here = self._vehicle, min(int(self._way.position_m / self._vehicle.place_m), self._places - 1)
        moving_mps = window.way_m / window.time_s
        self._pace_mps = 0.8 * self._pace_mps + 0.2 * moving_mps
        self._pace_w = 0.8 * self._pace_w + 0.2 * (window.other_j - window.extra_j) / window.time_s
        if window.way_m > 0.01 * v.place_m:
            extra = window.extra_j / window.way_m
            share = min(window.way_m / v.place_m, 1.0)
            self._extra[here] += (extra - self._extra[here]) * (share if self._extra[here] else 1.0)
        if self._cutoff is not None:
            self._cutoff.see(*window.electric, float(self._estimator.mean()[0, USED]))

    def _plan(self, onwards_m: float, home_cost_j: float) -> NDArray[np.void]:
        """Plan of driving on at the present pace, and then home."""
        plans = np.zeros(1, PLAN_DTYPE)
        plan, v = plans[0], self._vehicle
        pace_mps = max(self._pace_mps, self.robot.min_speed_mps)
        plan["onwards_m"], plan["onwards_s"] = onwards_m, onwards_m / pace_mps
        plan["speed_mps"] = min(max(pace_mps, 1e-3), self.robot.max_speed_mps)
        plan["onwards_j"] = max(self._pace_w, v.idle_w) * plan["onwards_s"]
        plan["home_mps"], plan["home_cost_j"], plan["sine"] = v.cruise_mps, home_cost_j, np.nan
        plan["knows_ahead"] = float(self._route is not None)
        plan["unsure_j"] = _RECKONING * self._way.reckoned_m * self._j_per_m(home_cost_j)
        return plans

    def _j_per_m(self, home_cost_j: float) -> float:
        return home_cost_j / max(self._way.position_m, self._vehicle.place_m)

    def _ways(self) -> NDArray[np.void]:
        """The way home where it is not the way out, `WAY_DTYPE`; empty where it is."""
        v = self._vehicle
        if self._other_way is not None:
            route, driven_m = self._other_way
            return along_route(route, driven_m, v.cruise_mps)
        if self._moved_home is None:
            return np.zeros(0, WAY_DTYPE)
        from_m, leg_m = self._way.beyond(self._moved_home)
        places = self._estimator.state["places"][0]
        return back_over(places, v.place_m, self._way.position_m, from_m, _DETOUR * leg_m, v.cruise_mps)

    def _advise(self) -> Advice:
        ways = self._ways()
        elsewhere = self._other_way is not None or self._moved_home is not None
        v, places = self._vehicle, self._estimator.state["places"][0]
        if elsewhere:
            home_m = float(ways["way_m"].sum())
            cost_j = self._at_cruise_j(ways) + self._standing_j(home_m)
        else:
            home_m = self._way.position_m
            cost_j = float(home_cost(v, places, self._extra, home_m))

        def leaves(onwards_m: float) -> Margin:
            plan = self._plan(onwards_m, cost_j)
            plan["elsewhere"] = float(elsewhere)
            return self._leaves(plan, ways, home_m + 2.0 * onwards_m)

        now = leaves(0.0)
        total = now.total[0]
        withheld_j = self._withheld_j(float(total["left_j"]))
        low_j = float(total["margin_low_j"]) - withheld_j

        def low_after_j(onwards_m: float) -> float:
            return float(leaves(onwards_m).total[0]["margin_low_j"]) - withheld_j

        turn_in_m = latest(low_after_j, low_j, self._range_m)
        standing_s = max(low_j, 0.0) / max(self._pace_w, v.idle_w, 1e-9)
        turn_in_s = min(turn_in_m / max(self._pace_mps, 1e-9), standing_s)
        needs_m = self._reaction_s * self._pace_mps
        self._turned |= turn_in_m <= needs_m or turn_in_s <= self._reaction_s
        # A way that was reckoned is known to a share of it: who may be elsewhere has not arrived.
        self._turned &= home_m + _RECKONING * self._way.reckoned_m > self._arrived_m
        chance_there = None
        if self._route is not None and not elsewhere:
            rest_m = max(len(self._route.grade_rad) * self._route.place_m - home_m, 0.0)
            chance_there = chance(leaves(rest_m), withheld_j)
        return Advice(
            time_s=self._readings.clock_s,
            way_home_m=home_m,
            energy_left_j=Spread(float(total["left_j"]) - withheld_j, float(total["left_sd_j"])),
            energy_home_j=Spread(float(total["cost_j"]), float(total["cost_sd_j"])),
            margin_j=Spread(float(total["margin_j"]) - withheld_j, float(total["margin_sd_j"])),
            chance_home=chance(now, withheld_j),
            risk=self.risk,
            turn_in_m=0.0 if self._turned else turn_in_m,
            turn_in_s=0.0 if self._turned else turn_in_s,
            turn_now=self._turned,
            chance_there_and_back=chance_there,
            looks_back=not self._turned and looks_back(self._windows, home_m, v.cruise_mps, self._window_s),
            rests_on=rests_on(self._has, self._known, self._what_home(), self._cutoff is not None),
            warnings=(*self._readings.warnings(), *self._off_route()),
            action=self._action,
        )

    def _withheld_j(self, left_j: float) -> float:
        """Energy that the cut-off voltage keeps in the battery."""
        if self._cutoff is None:
            return 0.0
        return max(left_j - self._cutoff.left() * self._vehicle.full_j, 0.0)

    def _off_route(self) -> tuple[str, ...]:
        off_m = self._way.off_route_m
        return (f"{off_m:.0f} m off the route",) if off_m > 50.0 else ()

    def _what_home(self) -> str:
        if self._other_way is not None:
            return "other way"
        if self._moved_home is not None:
            return "moved"
        return "route" if self._route is not None else "trail"

    def state(self) -> dict[str, Any]:
        """What a restart needs, for JSON; some tens of kilobytes."""
        self._flush()
        content = self._estimator.state.tobytes() + self._extra.tobytes()
        return {
            "schema": _SCHEMA, "robot": self.robot.name, "dtype": _digest(self._estimator.state.dtype),
            "estimator": base64.b85encode(zlib.compress(content, 9)).decode(), "way": self._way.state(),
            "cutoff": None if self._cutoff is None else self._cutoff.state(), "windows": self._windows,
            "turned": self._turned, "pace_mps": self._pace_mps, "pace_w": self._pace_w, "has": self._has,
            "moved_home": self._moved_home, "other_way_m": None if self._other_way is None else self._other_way[1],
            "at_terminals": self._at_terminals, "clock_s": self._readings.clock_s, "counts": self._readings.counts,
            **({} if self._policy is None else {"policy": self._policy.state()}),
        }  # fmt: skip

    def restore(self, state: dict[str, Any], other_way: RouteLike | None = None) -> None:
        """Go on from `state`, with a companion made with the same arguments.

        Args:
            state: As `state` gave it.
            other_way: The way home that `take_home` was given, if it was.

        Raises:
            CompanionError: The state is none, or of a companion made otherwise.
        """
        try:
            if state["schema"] != _SCHEMA or state["robot"] != self.robot.name:
                raise CompanionError(f"the state is of robot {state['robot']!r}, not of {self.robot.name!r}")
            if state["dtype"] != _digest(self._estimator.state.dtype):
                raise CompanionError("the state is of another version or of another route; begin anew")
            content = zlib.decompressobj().decompress(base64.b85decode(state["estimator"]), 10_000_000)
            size = self._estimator.state.nbytes
            self._begin()
            if state["at_terminals"] and not self._at_terminals:
                self._see_terminals()
            self._estimator.state[:] = np.frombuffer(content[:size], self._estimator.state.dtype)
            self._extra = np.frombuffer(content[size:], np.float64).copy()
            self._way.restore(state["way"])
            if self._cutoff is not None and state["cutoff"]:
                self._cutoff.restore(state["cutoff"])
            self._windows, self._turned = int(state["windows"]), bool(state["turned"])
            self._pace_mps, self._pace_w = float(state["pace_mps"]), float(state["pace_w"])
            self._has, self._charged = {name: bool(one) for name, one in state["has"].items()}, True
            moved = state["moved_home"]
            self._moved_home = tuple(moved) if isinstance(moved, list) else moved
            self._other_way = None if other_way is None else (other_way, float(state["other_way_m"] or 0.0))
            self._readings.clock_s = float(state["clock_s"])
            self._readings.counts.update(state["counts"])
            if self._policy is not None:
                self._policy.restore(state["policy"])
        except (KeyError, TypeError, ValueError, zlib.error) as error:
            raise CompanionError(f"the state cannot be used: {error}") from None

    def save(self, path: str | Path) -> None:
        """Write `state` to a file, whole or not at all.

        Raises:
            OSError: It cannot be written.
        """
        write_whole(Path(path), json.dumps(self.state()) + "\n")

    def load(self, path: str | Path, other_way: RouteLike | None = None) -> None:
        """Go on from a file that `save` wrote, see `restore`.

        Raises:
            CompanionError: It cannot be used.
            OSError: It cannot be read.
        """
        if Path(path).is_dir():
            raise CompanionError(f"{path}: is a folder; give the file that `save` wrote")
        try:
            state = read_json(Path(path))
        except ValueError as error:
            raise CompanionError(f"{path}: {error}") from None
        self.restore(state, other_way)


_ONE = np.ones(1, np.bool_)


def _with_warnings(advice: Advice, readings: Readings) -> Advice:
    return dataclasses.replace(advice, warnings=readings.warnings())


def _digest(dtype: np.dtype[np.void]) -> str:
    return f"{zlib.crc32(repr(dtype.descr).encode()):08x}"
