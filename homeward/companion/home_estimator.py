"""The companion's use of the estimator: windows of readings, and the energy that the way home
consumes and leaves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.companion import thresholds
from homeward.companion.advice import HomeOption, UncertainValue
from homeward.companion.battery import BatteryBelief, Conditions, Start, Witnesses
from homeward.companion.gauge import GaugeTrust
from homeward.companion.prior_knowledge import PriorKnowledge
from homeward.companion.readings import Reading
from homeward.companion.way import RouteLike, Step
from homeward.companion.window import Window
from homeward.estimation import PLAN_DTYPE, READING_DTYPE, Estimator, Margin, vehicle_of
from homeward.estimation.drive import modelled_driving
from homeward.estimation.estimator import NO_WAYS
from homeward.estimation.filter import place_of
from homeward.estimation.home import home_cost, modelled_power
from homeward.estimation.margin import chance_below, quantile_of_sum
from homeward.estimation.prior import GAIN, PER_CAPACITY, ROLLING, USED, WEIGHT
from homeward.estimation.tails import deviations
from homeward.physics import Robot
from homeward.physics.cells import cells_of
from homeward.physics.effects import cold_battery
from homeward.physics.jit import announce_compilation
from homeward.physics.kernel import full_charge
from homeward.physics.plain import plain
from homeward.physics.terminal_power import at_terminals

_PACE = 0.2
"""Weight of the last window in the present pace. Chosen: some five windows count."""
_ONE = np.ones(1, np.bool_)
_OWN_POWER = (GAIN, ROLLING, WEIGHT)
"""States of the robot's own consumption, which are exact where the model takes the place of the
meter."""


class WayHome(NamedTuple):
    """The way home from here.

    Attributes:
        way_m: Its length, m.
        cost_j: Its energy by the robot's own model, with that of turning round, J.
        unsure_j: Standard deviation of that by the errors of the positions and of the time of
            turning, J.
        ways: Its stretches if it is not the way out, `WAY_DTYPE`; otherwise None.
    """

    way_m: float
    cost_j: float
    unsure_j: float
    ways: NDArray[np.void] | None


class Outcome(NamedTuple):
    """What a plan leaves, J as metered.

    Attributes:
        energy_left: Energy left in the battery, until it is empty or cut off.
        cost: Energy of the plan.
        margin: The former less the latter.
        low_j: Margin at the accepted risk.
        chance_home: Probability of a margin above zero.
    """

    energy_left: UncertainValue
    cost: UncertainValue
    margin: UncertainValue
    low_j: float
    chance_home: float

    @property
    def reachable(self) -> bool:
        """Whether the energy is enough at the accepted risk."""
        return self.low_j >= 0.0

    @property
    def preference(self) -> tuple[bool, float]:
        """Homes are preferred by this: first those that are reachable, by the margin at the
        accepted risk; of the others the one with the highest probability."""
        if self.reachable:
            return True, self.low_j
        return False, self.chance_home

    def option(self, name: str, way_m: float) -> HomeOption:
        """A home or dock with this outcome."""
        return HomeOption(
            name=name,
            way_m=way_m,
            energy_j=self.cost,
            margin_j=self.margin,
            chance=self.chance_home,
            reachable=self.reachable,
        )


def best_first(reached: Mapping[str, Outcome]) -> list[str]:
    """Names of homes and docks, the advised one first; of equals, as they were given."""
    return sorted(reached, key=lambda name: reached[name].preference, reverse=True)


class HomeEstimator:
    """The estimated robot, and the energy that a way consumes and leaves.

    Args:
        robot: The robot of the file.
        knowledge: Its prior.
        places: Number of places that are kept.
        place_m: Length of a place, m.
        cruise_mps: Speed of the robot's own model, and on the way home until the robot has driven,
            m/s.
        keeps_cruise: Whether it is the speed on the way home in any case.
        more_omitted: By how much more the model omits of a window, a share, if the file does not state
            what is unexplained: the generic share is of a window of usual length, and shorter ones
            average less.
        risk: Accepted probability of not getting home.
        route: The route, if there is one.
        forecast_mps: Forecast of the wind: components towards where it comes from, east and north,
            if there is one.
        cutoff_v: Voltage at which the battery is cut off, if it is known.

    Attributes:
        battery: What is believed of the battery.
        has_power: Whether power was ever read; None before the first window. If not, the model
            takes its place, and what the battery holds is as uncertain as the model.
        vehicle: Parameters of the robot's own model in the form that the estimator takes.
        windows: Number of windows processed.
        home_mps: Speed on the way home: that at which its ground was driven, if none was told.
        pace_mps: Recent mean speed, including stops.
        pace_w: Recent mean power by the robot's own model, beyond steady driving.
        speed_mps: Last speed reading.
    """

    SAVED: ClassVar = (
        "at_terminals", "estimates", "_extra", "_paces", "_state", "windows", "home_mps", "pace_mps", "pace_w",
        "speed_mps", "_heading_rad", "battery", "has_power", "_temperature_c", "_forgotten_j",
    )  # fmt: skip
    MAY_BE: ClassVar = {"has_power": (True,)}

    def __init__(
        self,
        robot: Robot,
        knowledge: PriorKnowledge,
        *,
        places: int,
        place_m: float,
        cruise_mps: float,
        keeps_cruise: bool,
        more_omitted: float,
        risk: float,
        route: RouteLike | None,
        forecast_mps: tuple[float, float] | None,
        cutoff_v: float | None,
    ) -> None:
        announce_compilation()
        self._robot = robot
        self._route = route
        self._risk = risk
        self._student_quantile = deviations(risk)
        self._places = places
        self._keeps_cruise = keeps_cruise
        self._more_omitted = more_omitted
        self._forecast_mps = forecast_mps or (0.0, 0.0)
        self.known = knowledge
        self.at_terminals = False
        self.vehicle = vehicle_of(robot, place_m, cruise_mps)
        self._record = plain(robot.record())
        self._temperature_c = math.nan
        self._estimator = Estimator(self.vehicle, knowledge.prior, places, 1)
        self._cells = cells_of(robot)
        self._rate_per_h = (
            3600.0 * self._modelled_w(robot, self.vehicle.cruise_mps) / self.vehicle.full_j
        )
        self.battery = BatteryBelief(
            self._cells, knowledge.prior, knowledge.capacity_is_fitted, cutoff_v
        )
        self.begin()
        self._compile()

    def _modelled_w(self, robot: Robot, speed_mps: float) -> float:
        """Power by the model of a robot with a full battery at a steady speed on level ground,
        W."""
        state = plain(full_charge(robot))
        state["step_s"] = 1.0
        power_w, _, _ = modelled_power(
            self.vehicle,
            plain(robot.record()),
            state,
            speed_mps=speed_mps,
            sensing_hz=0.0,
            accel_mps2=0.0,
            sine=0.0,
            yaw_rate_radps=0.0,
            ahead=1.0,
            temperature_c=self._air_c,
        )
        return float(power_w)

    @property
    def _air_c(self) -> float:
        """Temperature of the air for the robot's own model, C: that at which it was measured, if
        none was read."""
        if math.isfinite(self._temperature_c):
            return self._temperature_c
        return thresholds.MODEL_C

    @property
    def _models_cold(self) -> bool:
        """Whether the robot's own model counts what the battery loses in the cold, so that its
        cells do not, too."""
        return cold_battery.EFFECT.id in self._robot.active_effects

    @property
    def _metered_share(self) -> float:
        """Share of the energy out of the cells that the meter measures at cruise."""
        if not self.at_terminals:
            return 1.0
        cruise_mps = self.vehicle.cruise_mps
        terminals_w = self._modelled_w(at_terminals(self._robot), cruise_mps)
        cells_w = self._modelled_w(self._robot, cruise_mps)
        return terminals_w / cells_w

    def see_terminals(self) -> None:
        """From now on power is voltage times current, which excludes losses inside the battery."""
        if self.at_terminals:
            return
        self.at_terminals = True
        self._take_meter()
        self.begin_battery(Start(self.battery.charge))

    def _take_meter(self) -> None:
        """Use the model of the power that the meter measures."""
        robot = self._robot
        if self.at_terminals:
            robot = at_terminals(robot)
        self._record = plain(robot.record())
        self.vehicle = self.vehicle._replace(idle_w=self._modelled_w(robot, 0.0))
        self._idle_share = self.vehicle.idle_w / self._modelled_w(robot, self.vehicle.cruise_mps)
        self._estimator.vehicle = self.vehicle

    @property
    def estimates(self) -> NDArray[np.void]:
        """State of the estimator, shape (1,)."""
        return self._estimator.state

    @estimates.setter
    def estimates(self, estimates: NDArray[np.void]) -> None:
        self._estimator.state[:] = estimates
        self._take_meter()

    def begin(self) -> None:
        """Restart from the prior."""
        self._state = plain(full_charge(self._robot))
        self.has_power: bool | None = None
        self._forgotten_j = 0.0
        self._temperature_c = math.nan
        self._take_meter()
        east_mps, north_mps = np.array(self._forecast_mps)[:, None]
        self._estimator.begin(_ONE, east_mps, north_mps)
        covariance = self._estimator.state["hypotheses"]["covariance"]
        covariance[..., WEIGHT, WEIGHT] += self.known.weight_sd**2
        # A power at rest that is not the file's is consumed by the robot: it says nothing of the
        # meter, so that it does not change what the battery holds as metered.
        covariance[..., GAIN, GAIN] += self.known.idle_sd**2
        self._extra = np.zeros(self._places)
        self.windows = 0
        self._paces = np.zeros(self._places)
        self.home_mps = self.vehicle.cruise_mps
        self.pace_mps = self.vehicle.cruise_mps
        self.pace_w = self.vehicle.idle_w
        self.speed_mps = math.nan
        self._heading_rad = math.nan
        if self._route is not None:
            sines = np.sin(self._route.grade_rad)
            places = self.places
            places["sine"] = sines
            places["sine_driven"] = sines
            places["east"] = np.cos(self._route.heading_rad)
            places["north"] = np.sin(self._route.heading_rad)
            places["readings"] = 1.0
        self.begin_battery(Start())

    def _compile(self) -> None:
        """Run every kernel once, without a lasting effect."""
        state_before = self._estimator.state.copy()
        reading = np.zeros(1, READING_DTYPE)
        reading["time_s"] = 1.0
        reading["position_m"] = self.vehicle.place_m
        reading["east"] = 1.0
        self._estimator.update(reading, _ONE)
        self._estimator.relocate(0.5 * self.vehicle.place_m)
        self.leaves(self.way_home(1.0, 0.0))
        self._estimator.state[:] = state_before

    @property
    def places(self) -> NDArray[np.void]:
        """Notes on the places of the way out, shape (places,)."""
        places: NDArray[np.void] = self._estimator.state["places"][0]
        return places

    @property
    def gauge(self) -> GaugeTrust:
        """What is believed of the gauge."""
        return self.battery.trust

    @property
    def charge(self) -> float:
        """State of charge by all that is read, 0 to 1."""
        return self.battery.charge

    @property
    def used_j(self) -> float:
        """Energy drawn from this battery, J as metered."""
        return float(self._estimator.mean()[0, USED]) * self.vehicle.full_j

    @property
    def ever_used_j(self) -> float:
        """Energy drawn since the first reading, also from batteries before, J as metered: it falls
        only where energy is recovered."""
        return self._forgotten_j + self.used_j

    @property
    def left_j(self) -> float:
        """Mean energy left in the battery, J as metered."""
        return self._over(NO_WAYS, 0.0).energy_left.mean

    @property
    def driving_w(self) -> float:
        """Power half way between standing and driving at cruise on level ground, by the robot's own
        model."""
        cruise_mps = self.vehicle.cruise_mps
        return (
            self.vehicle.idle_w
            + thresholds.DRIVES * modelled_driving(self.vehicle, 0.0, cruise_mps) * cruise_mps
        )

    def recharge(self, soc: float) -> None:
        """Go on with the same battery at another charge, 0 to 1."""
        self._forget_used()
        self.battery.recharge(soc)

    def _forget_used(self) -> None:
        """Count the energy drawn from here on."""
        self._forgotten_j = self.ever_used_j
        self._estimator.recharge(1.0, 0.0)
        # The filter knows the energy drawn; what the battery holds is known by `battery`.
        self._estimator.state["hypotheses"]["mean"][..., PER_CAPACITY] = 1.0
        self._make_exact(PER_CAPACITY)

    def _make_exact(self, state: int) -> None:
        """Take a state as exactly known, in all hypotheses."""
        covariance = self._estimator.state["hypotheses"]["covariance"]
        covariance[..., state, :] = 0.0
        covariance[..., :, state] = 0.0

    def begin_battery(self, start: Start) -> None:
        """Replace the battery by one of which only the prior and the charge are known."""
        self._forget_used()
        conditions = Conditions(
            temperature_c=self._temperature_c,
            rate_per_h=self._rate_per_h,
            gain_sd=self.known.meter_sd,
            modelled_sd=self._modelled_sd,
            metered_share=self._metered_share,
            models_cold=self._models_cold,
        )
        self.battery.begin(start, conditions)

    @property
    def of_pace(self) -> str:
        """What is assumed of the speed on the way home, a sentence."""
        speed = f"the way home at {self.home_mps:.2g} m/s"
        if self._keeps_cruise:
            return f"{speed} (given)"
        if not self._paces.any():
            speed = f"{speed}, the speed with the longest range, until the robot has driven"
        else:
            speed = f"{speed}, as it was driven on the way out"
        return f"{speed}; give cruise_mps= if it differs"

    @property
    def of_cells(self) -> str:
        """What is assumed of the battery's cells, a sentence."""
        cells_c = self._temperature_c
        if self._models_cold:  # what the robot's own model counts does not count twice
            cells_c = math.nan
        low, high = self._cells.derating(cells_c, self._rate_per_h)
        air = "warm, as no temperature was read"
        if math.isfinite(self._temperature_c):
            air = f"at {self._temperature_c:.0f} C"
        share = f"{high:.0%}"
        if low < high:
            share = f"{low:.0%} to {high:.0%}"
        return f"{self._cells.words}, {air}, at {self._rate_per_h:.2g} charges an hour: {share} of the label"

    def see_temperature(self, temperature_c: float) -> bool:
        """Note the temperature of the air at the start, on which the capacity depends, C; whether
        it is news."""
        if math.isfinite(self._temperature_c) or not math.isfinite(temperature_c):
            return False
        self._temperature_c = temperature_c
        self._take_meter()
        return True

    def _see_power(self, power_w: float) -> None:
        """Note whether power is read: if not, the model takes its place."""
        if self.has_power is None:
            self.has_power = math.isfinite(power_w)
            if not self.has_power:
                for state in _OWN_POWER:
                    self._make_exact(state)
                self.begin_battery(self.battery.start)
        elif not self.has_power and math.isfinite(power_w):
            self.has_power = True
            covariance = self._estimator.state["hypotheses"]["covariance"]
            prior = self.known.prior
            gain_sd = math.hypot(prior.gain_sd, self.known.idle_sd)
            for state, sd in zip(
                _OWN_POWER, (gain_sd, prior.rolling_sd, prior.mass_sd), strict=True
            ):
                covariance[..., state, state] += sd**2
            self.begin_battery(Start(self.battery.charge, told=False))

    def model(self, reading: Reading, step: Step) -> tuple[float, float, float]:
        """Power since the last reading by the robot's own model, see `modelled_power`, W."""
        dt_s = reading.dt_s
        if dt_s <= 0.0:
            self.speed_mps = reading.speed_mps
            self._heading_rad = step.heading_rad
            return 0.0, 0.0, 0.0
        speed_mps = step.way_m / dt_s
        if math.isfinite(reading.speed_mps):
            speed_mps = abs(reading.speed_mps)
        speed_before_mps = speed_mps
        if math.isfinite(self.speed_mps):
            speed_before_mps = abs(self.speed_mps)
        turn_rad = math.remainder(step.heading_rad - self._heading_rad, math.tau)
        if not math.isfinite(turn_rad):
            turn_rad = 0.0
        sine = 0.0
        if math.isfinite(reading.grade_rad):
            sine = math.sin(reading.grade_rad)
        self._state["speed_mps"] = speed_before_mps
        self._state["step_s"] = dt_s
        modelled_w, drive_w, steady_w = modelled_power(
            self.vehicle,
            self._record,
            self._state,
            speed_mps=speed_mps,
            sensing_hz=reading.sensing_hz,
            accel_mps2=(speed_mps - speed_before_mps) / dt_s,
            sine=sine,
            yaw_rate_radps=turn_rad / dt_s,
            ahead=1.0,
            temperature_c=self._air_c,
        )
        if math.isfinite(reading.speed_mps):
            self.speed_mps = reading.speed_mps
        if math.isfinite(step.heading_rad):
            self._heading_rad = step.heading_rad
        # Numbers of numpy would make truths of numpy, which JSON does not take.
        return float(modelled_w), float(drive_w), float(steady_w)

    @contextmanager
    def with_open(self, window: Window, position_m: float) -> Iterator[None]:
        """Temporarily include a window that is not over yet, also one without length, of the first
        reading."""
        state_before = self._estimator.state.copy()
        try:
            if window.time_s > 0.0:
                self._update(window, position_m)
            else:
                self._estimator.relocate(position_m)
            yield
        finally:
            self._estimator.state[:] = state_before

    def add_window(self, window: Window, position_m: float) -> None:
        """Process a finished window, and note its ground and pace.

        Args:
            window: A window of positive length.
            position_m: Way home at its end, m.
        """
        self._see_power(window.power_w)
        self._update(window, position_m)
        self.windows += 1
        window_mps = window.way_m / window.time_s
        window_w = (window.other_j - window.extra_j) / window.time_s
        self.pace_mps = (1.0 - _PACE) * self.pace_mps + _PACE * window_mps
        self.pace_w = (1.0 - _PACE) * self.pace_w + _PACE * window_w
        place_m = self.vehicle.place_m
        if window.way_m > thresholds.DRIVEN_SHARE * place_m:
            place = place_of(self.vehicle, position_m, self._extra)
            extra_j_per_m = window.extra_j / window.way_m
            share = min(window.way_m / place_m, 1.0)
            # The first note of a place counts whole.
            weight = share if self._extra[place] else 1.0
            self._extra[place] += (extra_j_per_m - self._extra[place]) * weight
            self._note_pace(window, place, share)

    def see_battery(self, window: Window) -> None:
        """Weigh the possible batteries by voltage and gauge of a window, up to the end of the last
        one that was processed."""
        estimate = self._estimator.estimate()
        voltage_v, current_a = window.electric
        used_variance = float(estimate.covariance[0, USED, USED])
        self.battery.see(
            Witnesses(
                used=float(estimate.mean[0, USED]),
                used_sd=math.sqrt(max(used_variance, 0.0)),
                voltage_v=voltage_v,
                current_a=current_a,
                peak_a=window.peak_a,
                gauge=window.soc,
                time_s=window.time_s,
            )
        )

    def _note_pace(self, window: Window, place: int, share: float) -> None:
        """Note how fast a place was driven, of which a window covers a share, and so how fast it is
        home from here."""
        if self._keeps_cruise:
            return
        # Without a speed reading, stops count as slow driving.
        driven_mps = window.speed_mps
        if not math.isfinite(driven_mps):
            driven_mps = window.way_m / window.time_s
        noted_mps = self._paces[place]
        self._paces[place] += (driven_mps - noted_mps) * (share if noted_mps else 1.0)
        ahead = self._paces[: place + 1]
        known_mps = np.maximum(ahead[ahead > 0.0], thresholds.SLOWEST_MPS)
        # Places are equally long, so that their times add up.
        home_mps = len(known_mps) / float((1.0 / known_mps).sum())
        self.home_mps = min(home_mps, self._robot.max_speed_mps)

    def _update(self, window: Window, position_m: float) -> None:
        """Update the estimator with a window."""
        robot = self._estimator.state["robot"][0]
        change_m = position_m - float(robot["position_m"])
        straight = window.straight(change_m)
        outwards = change_m >= 0.0 or not straight
        sign = 1.0 if outwards else -1.0
        reached_m = position_m
        if not straight:
            reached_m = float(robot["position_m"]) + window.way_m
        readings = np.zeros(1, READING_DTYPE)
        reading = readings[0]
        reading["time_s"] = float(robot["time_s"]) + window.time_s
        reading["position_m"] = reached_m
        reading["power_w"] = window.power_w
        reading["soc"] = np.nan  # `battery` takes it
        # A single slope may be of the other direction of travel, if the robot has just turned: if
        # it is used for the whole way, 60 missions of benchmarks/on_the_robot/companion.py turn
        # home at 82 % of the shield's distance, not at 96 %.
        reading["modelled_j"] = np.nan
        if window.slopes > 1 and math.isfinite(window.sine):
            reading["modelled_j"] = window.modelled_j
        reading["other_j"] = window.other_j - self.vehicle.idle_w * window.time_s
        reading["speed_mps"] = window.speed_mps
        # Without a direction: straight out, so that a wind that helped on the way out is against
        # the robot on the way home.
        reading["east"] = 1.0
        reading["north"] = 0.0
        east, north = window.direction
        if math.isfinite(east):
            reading["east"] = sign * east
            reading["north"] = sign * north
        reading["sine"] = self._sine_noted(reached_m)
        if math.isfinite(window.sine):
            reading["sine"] = sign * window.sine
        prior = self.known.with_unexplained(window.way_m)
        changes: dict[str, float] = {}
        if math.isnan(window.sine) and window.way_m > 0.0 and self._route is None:
            changes["slope_noise"] = thresholds.NO_SLOPE_SD
        if math.isnan(window.sine) or self._route is not None:
            changes["slope_offset"] = 0.0  # a route's slopes are known, whatever the sensor reads
        # A file that states what is unexplained states it of a way of any length.
        if self.known.uncertainty is None:
            changes["model_error"] = self._more_omitted * prior.model_error
        changes["power_noise"] = math.hypot(
            prior.power_noise * window.of_the_mean, window.power_noise
        )
        self._estimator.prior = prior._replace(**changes)
        self._estimator.update(readings, _ONE)
        self._estimator.prior = self.known.prior
        if not straight:
            self._estimator.relocate(position_m)

    def _sine_noted(self, position_m: float) -> float:
        """Slope that the route has, 0 without one."""
        if self._route is None:
            return 0.0
        return math.sin(
            self._route.grade_rad[place_of(self.vehicle, position_m, self._route.grade_rad)]
        )

    def way_home(
        self, way_m: float, unsure_m: float, ways: NDArray[np.void] | None = None
    ) -> WayHome:
        """The way home and its energy by the robot's own model, with that of turning round.

        Args:
            way_m: Its length; of `ways`, their total length.
            unsure_m: Standard deviation of that without positions.
            ways: Its stretches if it is not the way out, `WAY_DTYPE`.
        """
        if ways is None:
            cost_j = float(home_cost(self.vehicle, self.places, self._extra, way_m))
        else:
            cost_j = self._at_cruise_j(ways) + self._standing_j(way_m)
        unsure_j = unsure_m * (cost_j / max(way_m, self.vehicle.place_m))
        turn_j = self.vehicle.idle_w * thresholds.TURN_S
        turn_sd_j = self.vehicle.idle_w * thresholds.TURN_SD_S
        return WayHome(way_m, cost_j + turn_j, math.hypot(unsure_j, turn_sd_j), ways)

    def leaves(self, home: WayHome, onwards_m: float = 0.0) -> Outcome:
        """Energy left at home after driving on at the present pace, and then home."""
        return self._outcome(self._margin_at_home(home, onwards_m))

    def low_after_j(self, home: WayHome, onwards_m: float) -> float:
        """`low_j` of `leaves`, in less time."""
        return self._low_j(_mixture_of(self._margin_at_home(home, onwards_m)), self._totals_j)

    def _margin_at_home(self, home: WayHome, onwards_m: float) -> Margin:
        plan = self._plan(onwards_m, home.cost_j)
        plan["elsewhere"] = float(home.ways is not None)
        plan["unsure_j"] = home.unsure_j
        return self._margin(plan, home.ways, home.way_m + 2.0 * onwards_m)

    def _outcome(self, margin: Margin) -> Outcome:
        """What a plan leaves, with what is believed of the battery: `margin` is that of a battery
        known to hold 1."""
        battery = self.battery
        full_j = self.vehicle.full_j
        total = margin.total[0]
        beyond_j = full_j * (battery.total - 1.0)
        total_sd_j = full_j * battery.total_sd
        energy_left = UncertainValue(
            mean=float(total["left_j"]) + beyond_j,
            sd=math.hypot(float(total["left_sd_j"]), total_sd_j),
        )
        after_plan = UncertainValue(
            mean=float(total["margin_j"]) + beyond_j,
            sd=math.hypot(float(total["margin_sd_j"]), total_sd_j),
        )
        mixture = _mixture_of(margin)
        totals_j = self._totals_j
        chance_stranded = float(chance_below(mixture, totals_j, battery.weights, 0.0, 0.0))
        return Outcome(
            energy_left=energy_left.within(0.0, full_j),
            cost=self._cost(total).within(0.0, math.inf),
            margin=after_plan,
            low_j=self._low_j(mixture, totals_j),
            chance_home=max(1.0 - chance_stranded, 0.0),
        )

    @property
    def _totals_j(self) -> NDArray[np.float64]:
        """What each possible battery holds beyond the file's usable energy, J as metered."""
        return np.asarray(self.vehicle.full_j * (self.battery.totals - 1.0))

    def _low_j(self, mixture: NDArray[np.float64], totals_j: NDArray[np.float64]) -> float:
        """Margin at the accepted risk, J."""
        weights = self.battery.weights
        return float(
            quantile_of_sum(mixture, totals_j, weights, self._risk, self._student_quantile)
        )

    def _cost(self, total: np.void) -> UncertainValue:
        """Energy of a plan. Without power, the model's scale is unknown; in the margin it
        cancels."""
        cost_j = float(total["cost_j"])
        sd_j = math.hypot(float(total["cost_sd_j"]), self._modelled_sd * cost_j)
        return UncertainValue(cost_j, sd_j)

    @property
    def _modelled_sd(self) -> float:
        """Relative standard deviation of the model's energy where it takes the place of the meter,
        otherwise 0."""
        if self.has_power is not False:
            return 0.0
        prior = self.known.prior
        idle_share = self._idle_share
        # Rolling resistance and payload act on what driving consumes, and not on what the robot
        # consumes at rest.
        driving_sd = (1.0 - idle_share) * math.hypot(
            prior.rolling_sd / prior.rolling, prior.mass_sd / prior.mass
        )
        beyond_meter_sd = math.sqrt(max(prior.gain_sd**2 - self.known.meter_sd**2, 0.0))
        return math.hypot(driving_sd, idle_share * self.known.idle_sd, beyond_meter_sd)

    def ahead(self, ways: NDArray[np.void], other_j: float = 0.0) -> UncertainValue:
        """Energy that a way from here consumes, by the present estimates, J as metered.

        Args:
            ways: Its stretches, `homeward.estimation.WAY_DTYPE`, shape (m,).
            other_j: Energy by the robot's own model for all but steady driving on it, J: standing,
                turning.
        """
        return self._over(ways, self._at_cruise_j(ways) + other_j).cost

    def after(self, ways: NDArray[np.void]) -> Outcome:
        """What a way from here leaves, see `ahead`, if only standing and steady driving consume
        energy."""
        return self._over(
            ways, self._at_cruise_j(ways) + self._standing_j(float(ways["way_m"].sum()))
        )

    def _over(self, ways: NDArray[np.void], cost_j: float) -> Outcome:
        """What a way from here consumes and leaves, given its energy by the robot's own model."""
        plan = self._plan(0.0, cost_j)
        plan["elsewhere"] = 1.0
        return self._outcome(self._margin(plan, ways, float(ways["way_m"].sum())))

    def _plan(self, onwards_m: float, home_cost_j: float) -> NDArray[np.void]:
        """Plan of driving on at the present pace, and then home."""
        pace_mps = max(self.pace_mps, self._robot.min_speed_mps)
        onwards_s = onwards_m / pace_mps
        plans = np.zeros(1, PLAN_DTYPE)
        plan = plans[0]
        plan["onwards_m"] = onwards_m
        plan["onwards_s"] = onwards_s
        plan["speed_mps"] = min(max(pace_mps, thresholds.SLOWEST_MPS), self._robot.max_speed_mps)
        plan["onwards_j"] = max(self.pace_w, self.vehicle.idle_w) * onwards_s
        plan["home_mps"] = self.home_mps
        plan["home_cost_j"] = home_cost_j
        plan["sine"] = np.nan
        plan["knows_ahead"] = float(self._route is not None)
        return plans

    def _margin(
        self, plan: NDArray[np.void], ways: NDArray[np.void] | None, way_m: float
    ) -> Margin:
        """Energy that a plan leaves."""
        if ways is None:
            ways = NO_WAYS
        self._estimator.prior = self.known.with_unexplained(way_m)
        margin = self._estimator.margin(plan, 0.0, ways)
        self._estimator.prior = self.known.prior
        return margin

    def _at_cruise_j(self, ways: NDArray[np.void]) -> float:
        """Energy of steady driving over a way, by the robot's own model."""
        total_j = 0.0
        for stretch in ways:
            j_per_m = modelled_driving(
                self.vehicle, float(stretch["sine"]), self.vehicle.cruise_mps
            )
            total_j += j_per_m * float(stretch["way_m"])
        return total_j

    def _standing_j(self, way_m: float) -> float:
        """Energy of standing for as long as a way home takes."""
        return self.vehicle.idle_w / self.home_mps * way_m


def _mixture_of(margin: Margin) -> NDArray[np.float64]:
    """A margin in the form that `homeward.estimation.margin` takes, shape (hypotheses, 4)."""
    parts = (margin.weight[0], margin.mean_j[0], margin.sd_j[0], margin.skewness[0])
    return np.stack(parts, axis=-1)
