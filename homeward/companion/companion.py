"""The companion: from a robot's readings to advice on its way home.

Readings in SI units go to `homeward.estimation`, the estimator that the planner and the shield use
too.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from homeward import thresholds as shared
from homeward.companion import thresholds
from homeward.companion.advice import HOME, Action, Advice, UncertainValue
from homeward.companion.battery import Start
from homeward.companion.checks import (
    check_route,
    checked_docks,
    checked_home,
    checked_if_given,
    checked_number,
    checked_wind,
)
from homeward.companion.gauge import FOLLOWS, OWN
from homeward.companion.home_estimator import HomeEstimator, Outcome, WayHome, best_first
from homeward.companion.limits import limits_of
from homeward.companion.policy import OnboardPolicy
from homeward.companion.prior_knowledge import PriorKnowledge, known_of
from homeward.companion.readings import (
    CompanionError,
    Position,
    Reading,
    Readings,
    checked_position,
)
from homeward.companion.saved import (
    DAMAGE,
    check_form,
    check_sealed,
    digest,
    form_of,
    put_values,
    sealed,
    values_of,
)
from homeward.companion.turn_advice import when_to_turn
from homeward.companion.way import RouteLike, Step, Way, along_and_off, along_route
from homeward.companion.window import Window
from homeward.companion.words import rests_on
from homeward.estimation import Prior, Vehicle
from homeward.estimation.excitation import looks_back
from homeward.files import read_json, write_whole
from homeward.physics import Robot, d_max, load_robot, optimal_speed
from homeward.physics.range import why_no_mission

WINDOWS = 200.0
"""Number of updates of the estimator while the battery lasts at cruise, as of decisions in the
environments (`homeward.envs.options`). About as long last the errors of the gauge, of the voltage and
of what the model omits, so that shorter windows are no independent evidence of them."""
_LONGEST_PLACES = 160.0
_PLACES = 128
"""Places per d_max, and how many are kept: the way home of a robot that can come home is shorter
than 0.8 d_max. Chosen: a place is then 0.6 % of d_max."""
_CRUMBS = 8.0
"""Points of the trail per place. Chosen: a bend is cut by an eighth of a place at most."""


class Companion:
    """Estimates the energy left and the way home with their uncertainty, and says when to turn.

    Readings may arrive at any times. They are averaged over windows, and the estimator is updated
    200 times while the battery lasts. In between, every update predicts from the last one. Kernels
    compile at construction.

    Args:
        robot: Preset name, path of a robot file, or a `Robot`. The file's table `[uncertainty]` is
            used if it has one, otherwise generic ranges.
        home: `(east, north)` in metres in the frame of the positions, `"here"` for the place of the
            first reading, or None if positions are metres from home along the way.
        route: The route, such as `homeward.envs.routes.load_route` returns. It starts at home, with
            coordinates relative to home, and its slopes and directions are known.
        risk: Accepted probability of not getting home, within (0, 0.5].
        soc: State of charge at the start, 0 to 1; by default that of the first reading, or 1.
        forecast_mps: Forecast of the wind: components towards where it comes from, east and north;
            None: unknown.
        cutoff_v: Voltage at which the battery is cut off; by default that of the robot's file, or
            what is usual for its cells.
        capacity_j: Energy that this battery gave when it was last discharged from full to the
            cut-off, warm and in some hours, J; by default within the range of ageing batteries.
            What cold and rate take is allowed for beside it.
        cruise_mps: Speed on the way home; by default that at which its ground was driven on the way
            out, and until then the speed with the longest range.
        window_s: Time over which power and motion are averaged. Voltage and gauge are averaged over a
            200th of the time that the battery lasts, or `window_s` if that is longer.
        place_m: Length over which the ground is taken as uniform.
        reaction_s: Time from the advice to turn until the robot has turned; by default a window.
        arrived_m: Length of the way home below which the robot is at home: `turn_now` ends when it
            comes back, and before it leaves says whether it must stay.
        prior: Prior of the estimator, instead of the one that follows from the robot's file.
        policy: A policy for `Advice.action`, such as
            `homeward.agents.onboard.load_onboard("ppo", "OutAndBack")`.
        docks: Other homes and charging docks by name: `(east, north)` in metres in the frame of
            `home`, or metres from home along the way if there is a route or no `home`. The way to
            one leads along the trail or the route as far as that helps, then straight on, times
            1.3.

    Raises:
        RobotError: The robot does not exist, or its file is invalid.
        CompanionError: Another argument is invalid.

    >>> companion = Companion("husky", home="here")
    >>> for second in range(600):
    ...     advice = companion.update(
    ...         float(second), speed_mps=1.0, power_w=150.0, soc=1.0 - 150.0 * second / 1.73e6, heading_rad=0.0
    ...     )
    >>> round(advice.way_home_m), advice.turn_now, advice.chance_home > 0.999
    (599, False, True)
    """

    SAVED: ClassVar = (
        "_readings", "_way", "_window", "_evidence", "_estimator", "_other_way_m", "_turned", "_has_left", "_charged",
        "_mismatched", "_since_stop", "_may_be_swapped", "_lowest_j", "_used_j", "_stands", "_has", "_action",
    )  # fmt: skip
    MAY_BE: ClassVar = {"_other_way_m": (0.0,), "_action": ((0.0, 0.0, "go"),)}

    def __init__(
        self,
        robot: str | Path | Robot,
        *,
        home: Position | str | None = None,
        route: RouteLike | None = None,
        risk: float = thresholds.RISK,
        soc: float | None = None,
        forecast_mps: tuple[float, float] | None = None,
        cutoff_v: float | None = None,
        capacity_j: float | None = None,
        cruise_mps: float | None = None,
        window_s: float | None = None,
        place_m: float | None = None,
        reaction_s: float | None = None,
        arrived_m: float = shared.POSITION_M,
        prior: Prior | None = None,
        policy: OnboardPolicy | None = None,
        docks: Mapping[str, Position] | None = None,
    ) -> None:
        self.robot = load_robot(robot)
        range_m = _checked_range(self.robot)
        self._range_m = range_m
        full_j = self.robot.usable_energy_j
        self._cutoff_source = "given"
        if cutoff_v is None:
            cutoff_v = self.robot.cutoff_v or None  # 0: the file states none
            self._cutoff_source = "the robot file's"
        most_v = thresholds.MOST_CUTOFF * (self.robot.nominal_voltage_v or math.inf)
        risk = checked_number("risk", risk, *thresholds.RISKS)
        arrived_m = checked_number("arrived_m", arrived_m, 0.0, thresholds.LARGEST_HOME_M)
        soc = checked_if_given("soc", soc, 0.0, 1.0)
        cutoff_v = checked_if_given("cutoff_v", cutoff_v, thresholds.LEAST_VOLTAGE_V, most_v)
        least_j = thresholds.LEAST_CAPACITY * full_j
        capacity_j = checked_if_given("capacity_j", capacity_j, least_j, full_j)
        fastest_mps = self.robot.max_speed_mps
        cruise_mps = checked_if_given("cruise_mps", cruise_mps, thresholds.SLOWEST_MPS, fastest_mps)
        window_s = checked_if_given("window_s", window_s, *thresholds.WINDOWS_S)
        shortest_m = thresholds.SHORTEST_PLACE * range_m
        place_m = checked_if_given("place_m", place_m, shortest_m, range_m)
        longest_s = thresholds.LONGEST_REACTION_S
        reaction_s = checked_if_given("reaction_s", reaction_s, 0.0, longest_s)
        self._limits = limits_of(self.robot, range_m)
        home = checked_home(home)
        forecast_mps = checked_wind(forecast_mps)
        check_route(route, self._limits.way_m)
        route_m = None
        if route is not None:
            route_m = float(route.place_m) * len(route.grade_rad)
        self._docks = checked_docks(docks, home, route_m, self._limits.way_m)
        if policy is not None and policy.robot != self.robot:
            raise CompanionError(
                f"the policy is for robot {policy.robot.name!r}, whose parameters differ from those of the companion's "
                f"{self.robot.name!r}; give both the same robot"
            )
        self._policy = policy
        self.risk = risk
        keeps_cruise = cruise_mps is not None
        if cruise_mps is None:
            cruise_mps = float(optimal_speed(self.robot))
        self._evidence_s = range_m / cruise_mps / WINDOWS
        if window_s is None:
            window_s = self._evidence_s
        if reaction_s is None:
            reaction_s = window_s
        self._window_s = window_s
        self._reaction_s = reaction_s
        self._arrived_m = arrived_m
        if place_m is None:
            place_m = range_m / _LONGEST_PLACES
        places = _PLACES
        if route is not None:
            places = len(route.grade_rad)
            place_m = float(route.place_m)
        self._start_soc = soc
        self._route = route
        self._cutoff_v = cutoff_v
        knowledge = known_of(self.robot, forecast_mps is not None)
        if prior is not None:
            prior = Prior(*map(float, prior))
            knowledge = PriorKnowledge(prior, (), meter_sd=prior.gain_sd)
        if capacity_j is not None:
            knowledge = knowledge.with_capacity(capacity_j / full_j)
        self._estimator = HomeEstimator(
            self.robot,
            knowledge,
            places=places,
            place_m=place_m,
            cruise_mps=cruise_mps,
            keeps_cruise=keeps_cruise,
            more_omitted=max(self._evidence_s / window_s, 1.0) ** 0.5,
            risk=risk,
            route=route,
            forecast_mps=forecast_mps,
            cutoff_v=cutoff_v,
        )
        # What a saved state depends on: one that was made for something else is refused.
        made_for = (
            self.robot,
            places,
            place_m,
            cruise_mps,
            window_s,
            home,
            cutoff_v,
            self._estimator.known.prior,
            policy is None,
            self._estimator.estimates.dtype.descr,
            self._estimator.places.tobytes(),
            self._docks,
        )
        self._made_for = digest(repr(made_for))
        self._way = Way(home, route, max(place_m / _CRUMBS, 1.0), self._limits.way_m)
        self._readings = Readings(self._limits, self._way.is_possible, self._way.noise_m)
        self._window = Window()
        self._evidence = Window()
        self._other_way: RouteLike | None = None
        self._other_way_m: float | None = None
        self._set_out()
        self._charged = False
        self._mismatched = 0
        self._stands = 0
        self._since_stop = math.inf
        self._may_be_swapped = False
        self._lowest_j = math.inf
        self._used_j = 0.0
        self._has = dict.fromkeys(("power", "soc", "grade", "heading", "position"), False)
        self._action: tuple[float, float, str] | None = None
        if self._policy is not None:
            self._policy.begin()
        self._form = form_of(self)

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
        """Process the readings of a moment, as many as there are, and advise.

        Args:
            time_s: Time, s, of any monotonic clock.
            speed_mps: Speed since the reading before, m/s, negative in reverse.
            power_w: Power drawn from the battery since the reading before, W.
            voltage_v: Voltage of the battery, V; with `current_a` instead of `power_w`.
            current_a: Current out of the battery, A, discharge positive.
            soc: State of charge, 0 to 1.
            grade_rad: Slope in the direction of travel, rad, uphill positive.
            heading_rad: Direction of travel, rad counter-clockwise from east.
            position: Metres from home along the way, or `(east, north)` in metres.
            sensing_hz: Sensing rate, Hz.
            temperature_c: Air temperature, C; the first one says how cold the battery is.
            interest: Interest of the ground here, a weight; only for the policy.

        Raises:
            CompanionError: A value is not a number, home was not set, or the position cannot be
                determined.
        """
        values = {
            "speed_mps": speed_mps,
            "power_w": power_w,
            "voltage_v": voltage_v,
            "current_a": current_a,
            "soc": soc,
            "grade_rad": grade_rad,
            "heading_rad": heading_rad,
            "position": position,
            "sensing_hz": sensing_hz,
            "temperature_c": temperature_c,
            "interest": interest,
        }
        reading = self._readings.take(time_s, values)
        if power_w is None and None not in (voltage_v, current_a):
            self._estimator.see_terminals()
        if reading is not None:
            self._process(reading)
        with self._estimator.with_open(self._window, self._way.position_m):
            return self._advise()

    def _process(self, reading: Reading) -> None:
        """Process the readings of a moment that are new."""
        self._charge_first(reading)
        if math.isnan(reading.speed_mps) and reading.position is None:
            # it drives on as before
            reading = reading._replace(speed_mps=self._estimator.speed_mps)
        step = self._way.follow(reading)
        self._note(reading, step)
        self._ask_policy(reading, step)
        modelled_w, drive_w, steady_w = self._estimator.model(reading, step)
        for window in (self._window, self._evidence):
            window.add(reading, step, modelled_w, drive_w, steady_w)
        # The first voltage under load says at once whether the battery holds it.
        is_first = (
            self._estimator.windows == 0
            and self._window.time_s > 0.0
            and math.isfinite(reading.voltage_v)
        )
        if is_first:
            self._flush()
        elif self._window.time_s >= self._window_s * (1.0 - 1e-6):
            self._flush(self._evidence_s * (1.0 - 1e-6))

    def _ask_policy(self, reading: Reading, step: Step) -> None:
        if self._policy is None:
            return
        action = self._policy.update(
            self._readings.clock_s,
            self._way.position_m,
            speed_mps=abs(reading.speed_mps),
            power_w=reading.power_w,
            soc=reading.soc,
            grade_rad=reading.grade_rad,
            heading_rad=step.heading_rad,
            temperature_c=reading.temperature_c,
            interest=reading.interest,
        )
        if action is not None:
            speed_mps, sensing_hz, mode = action
            action = None
            if math.isfinite(speed_mps) and math.isfinite(sensing_hz):
                # of any type of number, as a policy computes them
                action = (float(speed_mps), float(sensing_hz), str(mode))
        self._action = action

    def charged(self, soc: float) -> None:
        """Tell the companion that the battery was charged on the way, and that the mission goes on.

        The energy left becomes that of this charge, with its uncertainty. The way and all estimates
        stay: of the robot, the ground, the wind, and what this battery holds. The time from the
        reading before this call to the next one passed at the charger. A policy begins another
        mission, because it knows a single charge.

        Args:
            soc: State of charge now, 0 to 1.

        Raises:
            CompanionError: `soc` is not such a number.
        """
        soc = checked_number("soc", soc, 0.0, 1.0)
        self._flush()
        self._estimator.recharge(soc)
        self._readings.charge()
        # From here on the energy left may rise by no more than is recovered, as before.
        self._lowest_j = self._estimator.left_j
        self._begin_charge()

    def _set_out(self) -> None:
        """Begin a way out on another charge: the robot was neither told to turn nor seen away from
        home."""
        self._turned = False
        self._has_left = False

    def _begin_charge(self) -> None:
        """Begin a charge that was told, whatever the first readings and the argument `soc` say."""
        self._charged = True
        self._set_out()
        self._mismatched = 0
        if self._policy is not None:
            self._policy.begin()

    def swap_battery(self, soc: float = 1.0) -> None:
        """Tell the companion that the battery is another one: estimates of the old one are dropped.

        Args:
            soc: Its state of charge, 0 to 1.

        Raises:
            CompanionError: `soc` is not such a number.
        """
        soc = checked_number("soc", soc, 0.0, 1.0)
        self._flush()
        self._estimator.begin_battery(Start(soc))
        self._lowest_j = math.inf
        self._begin_charge()

    def move_home(self, home: Position) -> None:
        """Tell the companion that home has moved: back along the trail as far as that helps, then
        straight on.

        Args:
            home: `(east, north)` in metres, or metres along the way from where home was.

        Raises:
            CompanionError: `home` is neither.
        """
        checked = checked_position("home", home)
        if checked is None or not self._way.is_possible(checked):
            raise CompanionError(
                f"home = {home!r} is not allowed; give (east, north) in metres, or metres along the way, within "
                f"{self._limits.way_m:.4g} m of where it was"
            )
        self._way.moved_home = checked
        self._turned = False
        self._other_way = None
        self._other_way_m = None

    def take_home(self, route: RouteLike | None) -> None:
        """Tell the companion to go home by another way than the way out; None: by the way out
        again.

        Args:
            route: From here home, such as `homeward.envs.routes.load_route` returns.

        Raises:
            CompanionError: It is not a route.
        """
        check_route(route, self._limits.way_m)
        self._other_way = route
        self._other_way_m = None
        if route is not None:
            self._other_way_m = 0.0
        self._way.moved_home = None
        self._turned = False

    def ahead(self, ways: NDArray[np.void], other_j: float = 0.0) -> UncertainValue:
        """Energy that a way from here consumes, by the present estimates, J as metered.

        Args:
            ways: Its stretches, `homeward.estimation.WAY_DTYPE`, shape (m,).
            other_j: Energy by the robot's own model for all but steady driving on it, J: standing,
                turning.
        """
        return self._estimator.ahead(ways, float(other_j))

    def after(self, ways: NDArray[np.void]) -> UncertainValue:
        """Energy left after a way from here, see `ahead`, if only standing and steady driving
        consume energy, J."""
        return self._estimator.after(ways).margin

    def arrives(self, ways: NDArray[np.void]) -> Outcome:
        """What a way from here consumes and leaves, and the probability of its end; as of
        `after`."""
        return self._estimator.after(ways)

    @property
    def vehicle(self) -> Vehicle:
        """Parameters of the robot's own model in the form that the estimator takes."""
        return self._estimator.vehicle

    def _flush(self, least_evidence_s: float = 0.0) -> None:
        """Pass the readings so far to the estimator; those of voltage and gauge if they are of as long
        a time as given."""
        if self._window.time_s > 0.0:
            self._estimator.add_window(self._window, self._way.position_m)
            self._window = Window()
        if self._evidence.time_s > 0.0 and self._evidence.time_s >= least_evidence_s:
            self._estimator.see_battery(self._evidence)
            self._check_charge(self._evidence)
            self._check_speed(self._evidence)
            self._evidence = Window()

    def _check_charge(self, window: Window) -> None:
        """Say which reading is not believed. A lower one after a stop is accepted, as of another
        battery: that is safe."""
        believed = self._estimator.gauge.believed
        differs = window.soc - self._estimator.charge
        # Nobody changes a battery while the robot drives; while it is off, readings are missing.
        stops = window.stood_s > 0.0 or window.time_s > thresholds.GAP_INTERVALS * self._window_s
        if stops:
            self._since_stop = 0.0
        else:
            self._since_stop += 1.0
        if believed == FOLLOWS:
            self._mismatched = 0
            self._may_be_swapped = self._since_stop < thresholds.SOC_MISMATCH_WINDOWS
            return
        kind = "the state of charge"
        less_or_more = f"{abs(differs):.0%} {'more' if differs > 0.0 else 'less'}"
        if believed == OWN:
            text = f"{kind} does not follow the energy drawn, as of a map of the voltage: it reads {less_or_more}"
            self._readings.say(f"{text}; power alone is used", kind)
            return
        text = f"{kind} has jumped or stays: it reads {less_or_more} than the energy drawn implies"
        lower = self._may_be_swapped and differs < -thresholds.SOC_MISMATCH
        if lower:
            self._mismatched += 1
        else:
            self._mismatched = 0
        if self._mismatched < thresholds.SOC_MISMATCH_WINDOWS:
            self._readings.say(f"{text}; power alone is used", kind)
            return
        self._readings.say(f"{text}: another battery? Estimates of the old one are dropped", kind)
        self._estimator.begin_battery(Start(window.soc, told=False))
        self._mismatched = 0

    def _check_speed(self, window: Window) -> None:
        """Warn if the robot stands by its speed and drives by its power; which is wrong cannot be
        known."""
        stands = window.stood_s >= window.time_s and window.power_w > self._estimator.driving_w
        if not stands:
            self._stands = 0
            return
        self._stands += 1
        if self._stands < thresholds.STANDS_WINDOWS:
            return
        kind = "the speed reads 0 while"
        text = f"{kind} {window.power_w:.3g} W are drawn, as in driving: is it stuck, or a load that its file lacks?"
        if not self._has["position"]:
            text = f"{text} Home may be farther than estimated"
        self._readings.say(text, kind)

    def _charge_first(self, reading: Reading) -> None:
        """Begin with the battery as it is told, or as the first readings show it, which may come
        one by one."""
        estimator = self._estimator
        start = estimator.battery.start
        begins = estimator.windows == 0 and estimator.see_temperature(reading.temperature_c)
        if not self._charged and self._start_soc is not None:
            start = Start(self._start_soc)
            self._charged = True
            begins = True
        elif not self._charged and math.isfinite(reading.soc):
            start = Start(reading.soc, told=False)
            self._charged = True
            begins = True
        if begins:
            estimator.begin_battery(start)

    def _note(self, reading: Reading, step: Step) -> None:
        """Record which readings there have been."""
        self._has["power"] |= math.isfinite(reading.power_w)
        self._has["soc"] |= math.isfinite(reading.soc)
        self._has["grade"] |= math.isfinite(reading.grade_rad)
        self._has["heading"] |= math.isfinite(step.heading_rad)
        self._has["position"] |= reading.position is not None
        if self._other_way_m is not None:
            self._other_way_m += step.way_m

    def _way_home(self) -> WayHome:
        """The way home from here: along the way out, or another one."""
        unsure_m = self._way.unsure_m
        if self._other_way is not None and self._other_way_m is not None:
            ways = along_route(self._other_way, self._other_way_m, self._estimator.home_mps)
        elif self._way.moved_home is not None:
            ways = self.way_to(self._way.moved_home)
        else:
            return self._estimator.way_home(self._way.position_m, unsure_m)
        return self._estimator.way_home(float(ways["way_m"].sum()), unsure_m, ways)

    def _way_to_dock(self, dock: Position) -> WayHome:
        unsure_m = thresholds.DEAD_RECKONING_ERROR * self._way.reckoned_m
        ways = self.way_to(dock)
        return self._estimator.way_home(float(ways["way_m"].sum()), unsure_m, ways)

    def way_to(self, place: Position, from_m: float | None = None) -> NDArray[np.void]:
        """The way to a place, `homeward.estimation.WAY_DTYPE`: along the trail or the route as far
        as that helps, then straight on, times 1.3.

        Args:
            place: `(east, north)` in metres, or metres from home along the way.
            from_m: With a route: position on it to start from, m from home; by default the robot's.

        Raises:
            CompanionError: `place` is neither.
        """
        checked = checked_position("place", place)
        if checked is None:
            raise CompanionError(
                f"place = {place!r} is not allowed; give (east, north) in metres, or metres from home along the way"
            )
        here_m = self._way.position_m
        if from_m is not None:
            here_m = from_m
        leave_m, leg_m = self._way.beyond(checked, from_m)
        leg_m, speed_mps = thresholds.DETOUR * leg_m, self._estimator.home_mps
        return along_and_off(
            self._estimator.places, self.vehicle, here_m, leave_m, leg_m, speed_mps
        )

    def _advise(self) -> Advice:
        estimator = self._estimator
        ways = {HOME: self._way_home()}
        for name, dock in self._docks.items():
            ways[name] = self._way_to_dock(dock)
        outcomes = {name: estimator.leaves(way) for name, way in ways.items()}
        advised, *alternatives = best_first(outcomes)
        home = ways[advised]
        now = outcomes[advised]
        self._check_rise(now.energy_left.mean)
        self._check_drawn()
        self._check_cutoff()

        def low_after_j(onwards_m: float) -> float:
            return estimator.low_after_j(home, onwards_m)

        turn = when_to_turn(
            low_after_j,
            now.low_j,
            most_m=self._range_m,
            pace_mps=estimator.pace_mps,
            draws_w=max(estimator.pace_w, self.vehicle.idle_w, 1e-9),
            reaction_s=self._reaction_s,
        )
        # A way from dead reckoning has a relative error: a robot that may be elsewhere has not
        # arrived.
        unsure_m = thresholds.DEAD_RECKONING_ERROR * self._way.reckoned_m
        is_home = home.way_m + unsure_m <= self._arrived_m
        self._has_left |= not is_home
        if not is_home:
            self._turned |= turn.is_due
        else:
            # Who comes home has arrived. Who has not left yet is told not to leave for as long as
            # that is so: its battery may be charged there.
            self._turned = turn.is_due and not self._has_left
        chance_there = None
        if self._way.route_m is not None and ways[HOME].ways is None:
            onwards_m = max(self._way.route_m - ways[HOME].way_m, 0.0)
            chance_there = estimator.leaves(ways[HOME], onwards_m).chance_home
        advises_to_look_back = not self._turned and looks_back(
            estimator.windows, home.way_m, self.vehicle.cruise_mps, self._window_s
        )
        if self._turned:
            turn = turn._replace(in_m=0.0, in_s=0.0)
        action = None
        if self._action is not None:
            action = Action(*self._action)
        of_battery = (estimator.of_cells, self._cutoff_words())
        return Advice(
            time_s=self._readings.clock_s,
            way_home_m=home.way_m,
            energy_left_j=now.energy_left,
            energy_home_j=now.cost,
            margin_j=now.margin,
            chance_home=now.chance_home,
            risk=self.risk,
            turn_in_m=turn.in_m,
            turn_in_s=turn.in_s,
            turn_now=self._turned,
            chance_there_and_back=chance_there,
            looks_back=advises_to_look_back,
            rests_on=rests_on(
                self._has, estimator.known, self._what_home(advised), of_battery, estimator.of_pace
            ),
            warnings=(*self._readings.warnings(), *self._off_route(), *self._must_stay()),
            action=action,
            home=advised,
            others=tuple(outcomes[name].option(name, ways[name].way_m) for name in alternatives),
        )

    def _check_rise(self, left_j: float) -> None:
        """Say if the energy left rises by more than was recovered: what is read shows a fuller
        battery.

        It is compared with the lowest one since this was said last, so that a slow rise is said
        too.
        """
        used_j = self._estimator.ever_used_j
        recovered_j = max(self._used_j - used_j, 0.0)
        self._used_j = used_j
        self._lowest_j += recovered_j
        rises_j = left_j - self._lowest_j
        says_so = rises_j > thresholds.LEAST_RISE * self.vehicle.full_j
        if says_so:
            kind = "the energy left rises"
            share = rises_j / self.vehicle.full_j
            self._readings.say(
                f"{kind} by {share:.1%} of the battery: what is read shows a fuller one", kind
            )
        if says_so or left_j < self._lowest_j:
            self._lowest_j = left_j

    def _check_drawn(self) -> None:
        """Say if more was drawn than the battery can hold."""
        estimator = self._estimator
        if not estimator.battery.is_overdrawn:
            return
        kind = "more was drawn"
        share = estimator.used_j / self.vehicle.full_j
        errs = "the meter reads"
        if estimator.has_power is False:
            errs = "the model consumes"
        self._readings.say(
            f"{kind} than this battery can hold ({share:.0%} of the file's): another one, or {errs} too much? "
            "Call swap_battery or charged, or correct the meter or capacity_j=",
            kind,
        )

    def _check_cutoff(self) -> None:
        """Say if the battery may be cut off under load, however full it is."""
        if self._estimator.battery.fails <= self.risk:
            return
        kind = "the voltage under load"
        text = f"{kind} may fall to the cut-off on the way home, however full the battery is: drive slower"
        if self._cutoff_v is None:
            text = f"{text}, or give cutoff_v= if it is lower"
        self._readings.say(text, kind)

    def _cutoff_words(self) -> str:
        """Down to which voltage the battery is used."""
        if self._cutoff_v is not None:
            return f"the battery is usable down to its cut-off voltage under load ({self._cutoff_source})"
        cells = "its cells" if self.robot.curve.mean_v > 0.0 else "cells of any chemistry"
        return f"the battery is usable down to its cut-off voltage under load (none was given: that usual for {cells})"

    def _must_stay(self) -> tuple[str, ...]:
        """The warning that a robot that has not left home must not leave it, if that is so."""
        if self._has_left or not self._turned:
            return ()
        return (f"do not leave home: at a risk of {self.risk:g} the robot may not come back",)

    def _off_route(self) -> tuple[str, ...]:
        """The warning that the robot is off its route, if it is."""
        off_m = self._way.off_route_m
        if off_m <= thresholds.OFF_ROUTE_M:
            return ()
        return (f"{off_m:.0f} m off the route",)

    def _what_home(self, name: str) -> str:
        """Kind of the way to a home or dock, as `rests_on` names it."""
        if name != HOME:
            return "dock"
        if self._other_way is not None:
            return "other way"
        if self._way.moved_home is not None:
            return "moved"
        if self._route is None:
            return "trail"
        if self._way.ends_at_home:
            return "loop"
        return "route"

    def state(self) -> dict[str, Any]:
        """State for a restart, for JSON; 30 to 140 kB. Nothing changes by asking for it."""
        state = {"robot": self.robot.name, "made_for": self._made_for, "companion": values_of(self)}
        if self._policy is not None:
            state["policy"] = self._policy.state()
        return sealed(state)

    def restore(self, state: dict[str, Any], other_way: RouteLike | None = None) -> None:
        """Continue from `state`, in a companion with the same arguments; if that is refused, it is
        as before.

        Args:
            state: Value of `state`.
            other_way: The argument of `take_home`, if it was called.

        Raises:
            CompanionError: The state is damaged, of another version, or of a companion with other
                arguments.
        """
        check_route(other_way, self._limits.way_m)
        check_sealed(state)
        if state["robot"] != self.robot.name:
            raise CompanionError(
                f"the state is of robot {state['robot']!r}, not of {self.robot.name!r}"
            )
        if state["made_for"] != self._made_for:
            raise CompanionError(
                "the state is of another robot file, version or route, or of other arguments"
            )
        state_before = self.state()
        other_way_before = self._other_way
        try:
            check_form(state["companion"], self._form)
            self._put(state, other_way)
            self._rehearse()
            self._put(state, other_way)
        except DAMAGE as error:
            self._put(state_before, other_way_before)
            reason = " ".join(str(error).split())
            raise CompanionError(f"the state cannot be used: {reason}") from None

    def _put(self, state: dict[str, Any], other_way: RouteLike | None) -> None:
        put_values(self, state["companion"])
        if other_way is None and self._other_way_m is not None:
            raise CompanionError(
                "the state is of a robot that takes another way home; pass it as other_way="
            )
        self._other_way = other_way
        if other_way is not None and self._other_way_m is None:
            self._other_way_m = 0.0
        if self._policy is not None:
            self._policy.restore(state["policy"])

    def _rehearse(self) -> None:
        """Check that the advice stays sound over the next windows; it changes the state.

        Raises:
            ArithmeticError, AttributeError, LookupError, TypeError, ValueError: It does not.
        """
        cruise_mps = self.vehicle.cruise_mps
        power_w = self.vehicle.full_j * cruise_mps / self._range_m
        position: Position = self._way.position_m
        if self._way.home is not None:
            position = (self._way.position_m, 0.0)
        moving: dict[str, Any] = {
            "speed_mps": cruise_mps,
            "power_w": power_w,
            "heading_rad": 0.0,
            "position": position,
        }
        standing: dict[str, Any] = {"speed_mps": 0.0, "power_w": self.vehicle.idle_w}
        rehearsed: list[tuple[float, dict[str, Any]]] = [(0.0, {}), (0.0, moving)]
        for readings in (moving, moving, standing, moving):
            rehearsed.append((0.5 * max(self._window_s, self._evidence_s), readings))
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            for step_s, readings in rehearsed:
                try:
                    advice = self.update(self._readings.last_s + step_s, **readings)
                except CompanionError:
                    continue  # such as a home that is still to be told
                if not advice.is_sound:
                    raise ValueError("no sound advice follows from it")

    def save(self, path: str | Path) -> None:
        """Write `state` to a file, completely or not at all.

        Raises:
            OSError: It cannot be written.
        """
        write_whole(Path(path), json.dumps(self.state()) + "\n")

    def load(self, path: str | Path, other_way: RouteLike | None = None) -> None:
        """Continue from a file that `save` wrote, see `restore`.

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


def _checked_range(robot: Robot) -> float:
    """Range of a robot, m, which must drive, and run empty.

    Raises:
        CompanionError: It does not.
    """
    reason = why_no_mission(robot)
    if reason:
        raise CompanionError(reason)
    return float(d_max(robot))
