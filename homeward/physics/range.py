"""Range on one battery charge: the paper's Eqs. 4, 7 and 8, and the kernel's range where effects
are active; and what a leg of a route consumes."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from homeward.physics import model, thresholds
from homeward.physics.intervals import FINITE, NOT_NEGATIVE, Bounds, checked
from homeward.physics.jit import announce_compilation, compiled
from homeward.physics.kernel import BELOW_CUTOFF, Conditions, advance, demand, full_charge
from homeward.physics.log_replay import Recorded, conditions
from homeward.physics.robot import Robot
from homeward.physics.uncertainty import Uncertainty

# chosen: a step is half a per cent of the span of speeds, and the optimum is flat
_SPEED_GRID = 201
_SPEEDS = Bounds(0.0, np.inf, open_low=True, open_high=True)
_DUTIES = Bounds(0.0, 1.0, open_low=True)
# standard deviations from the mean to either end of a normal distribution's central 90 %
_HALF_90 = 1.645
# relative change of a parameter for a derivative; chosen: small, and far above rounding
_STEP = 1e-3
_IDLE = "sensing_idle_w", "communication_w", "controller_w"
# what a robot that stands draws; of these, a diagnosis fits the former
_AT_REST = *_IDLE, "computer_w"
_SAMPLE = "sensing_j_per_sample", "computer_j_per_sample"


class RouteLike(Protocol):
    """A way cut into places of equal length, such as `homeward.envs.routes.Route`; arrays of shape
    (places,)."""

    @property
    def place_m(self) -> float:
        """Length of a place, m."""

    @property
    def grade_rad(self) -> NDArray[np.float64]:
        """Slope angle along the way, rad."""

    @property
    def heading_rad(self) -> NDArray[np.float64]:
        """Direction of the way, rad counter-clockwise from east."""


class Leg(NamedTuple):
    """What a leg consumes.

    Attributes:
        mean_j: Energy out of the battery by the robot's file, J.
        sd_j: Its standard deviation, J.
        low_j: Lower end of the central 90 % interval, J, at least 0.
        high_j: Upper end, J.
        time_s: Time that it takes, s.
    """

    mean_j: float
    sd_j: float
    low_j: float
    high_j: float
    time_s: float


def manoeuvring_energy(force_n: Any, distance_m: Any) -> Any:
    """Work at the wheels F d, J (Eq. 4).

    Args:
        force_n: Force at the wheels, N, any shape.
        distance_m: Distance, m, any shape.

    Raises:
        ValueError: A value is outside its bounds.
    """
    return checked("force_n", force_n, FINITE) * checked("distance_m", distance_m, NOT_NEGATIVE)


def mission_energy(
    robot: Robot,
    distance_m: Any,
    speed_mps: Any,
    grade_rad: Any = 0.0,
    duty: Any = 1.0,
    sensing_hz: Any = 0.0,
) -> Any:
    """Battery energy of a mission of a given length, J (Eq. 7): d { P_anc / (v D) + F / Gamma }.

    The paper also writes AE = eta4 E. That contradicts Eq. 7 and its Table I, so Eq. 7 is the
    model. A negative force (a steep descent) consumes nothing.

    Args:
        robot: The robot; its effects are not part of the equation.
        distance_m: Length of the mission, m, any shape.
        speed_mps: Speed while moving, m/s, above 0, any shape.
        grade_rad: Slope angle, rad, any shape.
        duty: Duty cycle D, share of the time spent moving, in (0, 1], any shape.
        sensing_hz: Sensing rate, Hz, any shape.

    Raises:
        ValueError: A value is outside its bounds.
    """
    distance_m = checked("distance_m", distance_m, NOT_NEGATIVE)
    speed_mps = checked("speed_mps", speed_mps, _SPEEDS)
    grade_rad, duty, sensing_hz = _checked_way(grade_rad, duty, sensing_hz)
    return distance_m * _energy_per_metre(robot, speed_mps, grade_rad, duty, sensing_hz)


def optimal_speed(
    robot: Robot, grade_rad: Any = 0.0, duty: Any = 1.0, sensing_hz: Any = 0.0
) -> Any:
    """Speed with the longest range, m/s: (P_anc Gamma / (2 c D))^(1/3), within the robot's limits.

    The minimum of Eq. 7 over v at a fixed duty cycle. Without drag the highest speed is optimal. On
    a descent that the robot rolls down without power it is at least the speed at which drag
    balances gravity. With active effects or a cut-off, the kernel's range is maximised instead.

    Args:
        robot: The robot.
        grade_rad: Slope angle, rad, any shape.
        duty: Duty cycle, in (0, 1], any shape.
        sensing_hz: Sensing rate, Hz, any shape.

    Raises:
        ValueError: A value is outside its bounds.

    >>> import homeward
    >>> husky = homeward.load_robot("husky")
    >>> float(optimal_speed(husky)) == husky.max_speed_mps
    True
    """
    grade_rad, duty, sensing_hz = _checked_way(grade_rad, duty, sensing_hz)
    if _needs_kernel(robot):
        speeds = np.linspace(robot.min_speed_mps, robot.max_speed_mps, _SPEED_GRID)
        arguments = np.broadcast_arrays(grade_rad, duty, sensing_hz)
        # The speeds vary along an axis of their own, the last.
        columns = [np.asarray(argument, dtype=np.float64)[..., None] for argument in arguments]
        return speeds[np.argmax(d_max(robot, speeds, *columns), axis=-1)]
    drag = robot.drag_ns2_per_m2
    if drag == 0.0:
        return np.full(np.broadcast(grade_rad, duty, sensing_hz).shape, robot.max_speed_mps)[()]
    ancillary_w = model.ancillary_power(robot, sensing_hz)
    cube = ancillary_w * robot.traction_efficiency / (2.0 * drag * duty)
    # The zero of the derivative of Eq. 7 over v: P / (v^2 D) = 2 c v / Gamma.
    balance_mps = cube ** (1.0 / 3.0)
    downhill_n = np.maximum(-model.traction_force(robot, 0.0, grade_rad), 0.0)
    rolling_mps = np.sqrt(downhill_n / drag)  # where drag balances gravity
    unlimited_mps = np.maximum(balance_mps, rolling_mps)
    return np.minimum(np.maximum(unlimited_mps, robot.min_speed_mps), robot.max_speed_mps)


def d_max(
    robot: Robot,
    speed_mps: Any = None,
    grade_rad: Any = 0.0,
    duty: Any = 1.0,
    sensing_hz: Any = 0.0,
    energy_j: Any = None,
) -> Any:
    """Range on one battery charge, m (Eq. 8): E / { P_anc / (v D) + F(v) / Gamma }.

    For a robot with effects or a cut-off the kernel drives until the battery is empty, or its
    voltage under load falls to the cut-off. Without either the kernel and Eq. 8 agree.

    Args:
        robot: The robot.
        speed_mps: Speed while moving, m/s, above 0, any shape; `optimal_speed` if left out.
        grade_rad: Slope angle, rad, any shape.
        duty: Duty cycle D, share of the time spent moving, in (0, 1], any shape.
        sensing_hz: Sensing rate, Hz, any shape.
        energy_j: Energy in the battery, J, any shape; the robot's usable energy (Eq. 6) if left
            out.

    Raises:
        ValueError: A value is outside its bounds.

    The paper measured 1.368, 2.143 and 2.87 h on its box at these duty cycles; its equations, which
    neglect drag, give:

    >>> import dataclasses, homeward
    >>> rusti = dataclasses.replace(homeward.load_robot("rusti"), drag_ns2_per_m2=0.0)
    >>> duty = np.array([0.997, 0.367, 0.286])
    >>> (d_max(rusti, 1.0, duty=duty) / duty / 3600).round(2).tolist()
    [1.64, 4.02, 4.95]
    """
    grade_rad, duty, sensing_hz = _checked_way(grade_rad, duty, sensing_hz)
    if speed_mps is None:
        speed_mps = optimal_speed(robot, grade_rad, duty, sensing_hz)
    if energy_j is None:
        energy_j = robot.usable_energy_j
    speed_mps = checked("speed_mps", speed_mps, _SPEEDS)
    energy_j = checked("energy_j", energy_j, NOT_NEGATIVE)
    if _needs_kernel(robot):
        return _range_by_kernel(robot, speed_mps, grade_rad, duty, sensing_hz, energy_j)
    per_metre = _energy_per_metre(robot, speed_mps, grade_rad, duty, sensing_hz)
    with np.errstate(divide="ignore"):  # a descent without consumption has an infinite range
        return np.divide(energy_j, np.where(energy_j, per_metre, 1.0))


def why_no_mission(robot: Robot) -> str:
    """Why a robot can do no mission on the level, in words; empty if it drives, and runs empty."""
    range_m = float(d_max(robot))
    if not np.isfinite(range_m):
        return f"robot {robot.name!r} never runs empty on level ground; check its effects"
    if range_m == 0.0:
        return f"robot {robot.name!r} is cut off at once on level ground; check its cutoff_v"
    return ""


def below_cutoff(
    robot: Robot,
    speed_mps: Any,
    grade_rad: Any = 0.0,
    duty: Any = 1.0,
    sensing_hz: Any = 0.0,
) -> Any:
    """Energy that stays in the battery at the end of `d_max`, because its voltage under load has
    fallen to its cut-off, J; 0 without a cut-off.

    Args:
        robot: The robot.
        speed_mps: Speed while moving, m/s, above 0, any shape.
        grade_rad: Slope angle, rad, any shape.
        duty: Duty cycle D, share of the time spent moving, in (0, 1], any shape.
        sensing_hz: Sensing rate, Hz, any shape.

    Raises:
        ValueError: A value is outside its bounds.
    """
    grade_rad, duty, sensing_hz = _checked_way(grade_rad, duty, sensing_hz)
    speed_mps = checked("speed_mps", speed_mps, _SPEEDS)
    if not robot.has_cutoff:
        return np.zeros(np.broadcast(speed_mps, grade_rad, duty, sensing_hz).shape)[()]
    full_j = robot.usable_energy_j
    _, kept_j = _on_one_charge(robot, speed_mps, grade_rad, duty, sensing_hz, full_j)
    return kept_j


def leg(robot: Robot, route: RouteLike, speed_mps: float, sensing_hz: float = 0.0) -> Leg:
    """Energy that a leg from A to B consumes, with its 90 % interval.

    The robot drives the route's slopes and bends at a steady speed, with a charged battery, in calm
    air, by the compiled model with its effects; a bend is spread over its place. The interval is
    that of the file's table `[uncertainty]`: of its parameters as they count on this leg, of what
    differs between runs, and of unexplained power over its length. A file without it (or with one
    of motor charge) has generic ranges, `homeward.physics.thresholds`.

    Args:
        robot: The robot.
        route: The leg, such as `homeward.envs.routes.load_route` returns.
        speed_mps: Speed, m/s, above 0.
        sensing_hz: Sensing rate, Hz.

    Raises:
        ValueError: A value is outside its bounds, or the file's uncertainty names a parameter that
            it does not have.

    A kilometre uphill at 5 %, then one downhill, by a robot whose file states no uncertainty:

    >>> import homeward
    >>> from homeward.envs.routes import Route
    >>> flat, slope = np.zeros(40), np.repeat((0.05, -0.05), 20)
    >>> hill = Route(place_m=50.0, grade_rad=slope, roughness=flat, interest=flat, heading_rad=flat)
    >>> there = leg(homeward.load_robot("husky"), hill, speed_mps=0.8)
    >>> [round(joules / 1000.0) for joules in (there.low_j, there.mean_j, there.high_j)]
    [268, 348, 427]
    """
    speed_mps = float(checked("speed_mps", speed_mps, _SPEEDS))
    sensing_hz = float(checked("sensing_hz", sensing_hz, NOT_NEGATIVE))
    length_m, driven = _driven(route, speed_mps, sensing_hz)
    mean_j = _consumed(robot, driven)
    sd_j = math.sqrt(_variance(robot, driven, mean_j, length_m))
    return Leg(
        mean_j=mean_j,
        sd_j=sd_j,
        low_j=max(mean_j - _HALF_90 * sd_j, 0.0),
        high_j=mean_j + _HALF_90 * sd_j,
        time_s=length_m / speed_mps,
    )


def _driven(route: RouteLike, speed_mps: float, sensing_hz: float) -> tuple[float, Recorded]:
    """Length of a route, m, and its steady drive."""
    grade_rad = np.asarray(checked("grade_rad", route.grade_rad, model.GRADES), np.float64)
    heading_rad = np.unwrap(
        np.asarray(checked("heading_rad", route.heading_rad, FINITE), np.float64)
    )
    place_m = float(checked("place_m", route.place_m, _SPEEDS))
    length_m = place_m * len(grade_rad)
    if len(grade_rad) == 1:  # of one place: two halves, because a drive has two samples
        grade_rad = np.repeat(grade_rad, 2)
        heading_rad = np.repeat(heading_rad, 2)
        place_m *= 0.5
    place_s = place_m / speed_mps
    time_s = place_s * np.arange(len(grade_rad), dtype=np.float64)
    turned_rad = np.append(np.diff(heading_rad), 0.0)  # the last place has no bend after it
    driven = conditions(
        time_s, np.full(len(time_s), speed_mps), grade_rad=grade_rad, yaw_rate_radps=turned_rad / place_s,
        accel_mps2=0.0, headwind_mps=0.0, roughness=None, temperature_c=20.0, sensing_hz=sensing_hz,
        base_distance_m=0.0, direction=1.0,
    )  # fmt: skip
    return length_m, driven


def _consumed(robot: Robot, driven: Recorded) -> float:
    return sum(driven.replay(robot).energy_j.values())


def _variance(robot: Robot, driven: Recorded, mean_j: float, length_m: float) -> float:
    """Variance of the energy of a leg, J^2."""
    in_file = robot.uncertainty

    def per_share(name: str) -> float:
        """Change of the energy by the relative change of a parameter, J; downwards, so that a share
        stays one."""
        return (mean_j - _consumed(_changed(robot, name, 1.0 - _STEP), driven)) / _STEP

    stated = in_file
    if stated is None or stated.of == "charge":
        stated = Uncertainty()
    of_parameters = 0.0
    if stated.fitted:
        slopes_j = np.array([per_share(name) for name in stated.fitted])
        of_parameters = float(slopes_j @ np.array(stated.covariance) @ slopes_j)
    if in_file is None or in_file.of != "energy":
        generic_sds_j = (
            share * per_share(name) for name, share in _not_stated(stated.fitted).items()
        )
        generic = sum(sd_j**2 for sd_j in generic_sds_j)
        omitted_j = thresholds.OMITTED * mean_j
        return of_parameters + generic + omitted_j**2
    unexplained_j = in_file.unexplained_over(length_m) * mean_j
    if in_file.between_runs is None:
        runs = (thresholds.BETWEEN_RUNS * mean_j) ** 2 + of_parameters
    else:  # the spread between runs, where it was measured, includes the file's own error
        runs = max((in_file.between_runs * mean_j) ** 2, of_parameters)
    return runs + unexplained_j**2


def _not_stated(measured: tuple[str, ...]) -> dict[str, float]:
    """Relative standard deviations of what was not measured, by name.

    A payload is rolled, too; where the resistance was measured, with the load of the test, it
    changes the climbs alone.
    """
    shares = {}
    load = "mass"
    if "rolling" not in measured:
        shares["rolling"] = thresholds.GENERIC_ROLLING_SD
        load = "payload"
    if "mass" not in measured:
        shares[load] = thresholds.GENERIC_PAYLOAD_SD
    if "idle_power" not in measured:
        shares["power_at_rest"] = thresholds.GENERIC_IDLE_SD
    return shares


def _changed(robot: Robot, name: str, factor: float) -> Robot:
    """The robot with a parameter of its uncertainty multiplied.

    Rolling resistance counts as C_rr m, so that mass alone acts on slopes, as in a diagnosis.
    """
    if name == "capacity":  # of which the consumption is independent
        return robot
    if name == "rolling":
        return dataclasses.replace(robot, rolling_resistance=robot.rolling_resistance * factor)
    if name == "mass":
        rolling_resistance = min(robot.rolling_resistance / factor, 1.0)
        return dataclasses.replace(
            robot, mass_kg=robot.mass_kg * factor, rolling_resistance=rolling_resistance
        )
    if name == "payload":
        return dataclasses.replace(robot, mass_kg=robot.mass_kg * factor)
    fields_of = {
        "drag": ("drag_ns2_per_m2",), "idle_power": _IDLE, "power_at_rest": _AT_REST, "sample_energy": _SAMPLE,
    }  # fmt: skip
    fields = fields_of.get(name, ())
    if fields:
        return dataclasses.replace(
            robot, **{field: getattr(robot, field) * factor for field in fields}
        )
    effect, _, parameter = name.partition(".")
    if parameter == "track_m":
        return dataclasses.replace(robot, track_m=robot.track_m * factor)
    numbers = dict(robot.effects.get(effect, {}))
    if parameter not in numbers:
        raise ValueError(
            f"uncertainty.fitted names {name!r}, which robot {robot.name!r} does not have"
        )
    numbers[parameter] *= factor
    return dataclasses.replace(robot, effects={**robot.effects, effect: numbers})


def _energy_per_metre(
    robot: Robot, speed_mps: Any, grade_rad: Any, duty: Any, sensing_hz: Any
) -> Any:
    force_n = np.maximum(model.traction_force(robot, speed_mps, grade_rad), 0.0)
    return (
        model.ancillary_power(robot, sensing_hz) / (speed_mps * duty)
        + force_n / robot.traction_efficiency
    )


def _checked_way(grade_rad: Any, duty: Any, sensing_hz: Any) -> Any:
    return (
        checked("grade_rad", grade_rad, model.GRADES),
        checked("duty", duty, _DUTIES),
        checked("sensing_hz", sensing_hz, NOT_NEGATIVE),
    )


def _needs_kernel(robot: Robot) -> bool:
    """Whether the paper's equations do not describe a robot."""
    return bool(robot.active_effects) or robot.has_cutoff


def _range_by_kernel(
    robot: Robot, speed_mps: Any, grade_rad: Any, duty: Any, sensing_hz: Any, energy_j: Any
) -> NDArray[np.float64]:
    range_m, _ = _on_one_charge(robot, speed_mps, grade_rad, duty, sensing_hz, energy_j)
    return range_m


def _on_one_charge(
    robot: Robot, speed_mps: Any, grade_rad: Any, duty: Any, sensing_hz: Any, energy_j: Any
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Range, m, and energy that then stays in the battery below its cut-off, J."""
    announce_compilation()
    arguments = np.broadcast(speed_mps, grade_rad, duty, sensing_hz, energy_j)
    ranges_m = []
    kept_j = []
    record = robot.record()
    roughness = float(record["surface_usual"][0])
    for speed, grade, duty_cycle, rate, energy in arguments:
        driving = _steady(float(speed), float(rate), float(grade), roughness)
        standing = driving._replace(speed_mps=0.0)
        state = full_charge(robot, float(energy))
        ranges_m.append(_drive_until_empty(record, state, driving, standing, float(duty_cycle)))
        kept_j.append(state["ledger_j"][0, BELOW_CUTOFF])
    shape = arguments.shape
    return (
        np.array(ranges_m, np.float64).reshape(shape)[()],
        np.array(kept_j, np.float64).reshape(shape)[()],
    )


def _steady(speed_mps: float, sensing_hz: float, grade_rad: float, roughness: float) -> Conditions:
    return Conditions(
        speed_mps=speed_mps,
        sensing_hz=sensing_hz,
        accel_mps2=0.0,
        sin_grade=float(np.sin(grade_rad)),
        cos_grade=float(np.cos(grade_rad)),
        yaw_rate_radps=0.0,
        roughness=roughness,
        headwind_mps=0.0,
        temperature_c=20.0,
        base_distance_m=0.0,
        direction=1.0,
    )


@compiled
def _drive_until_empty(robots: Any, states: Any, driving: Any, standing: Any, duty: float) -> Any:
    """Distance on one charge, m: drives and stands in turn, in cycles that consume a thousandth of
    the charge each."""
    p = robots[0]
    s = states[0]
    charge_j = s.energy_j
    s.speed_mps = driving.speed_mps
    s.step_s = 1.0
    driving_w = abs(demand(p, s, driving))
    standing_w = abs(demand(p, s, standing))
    cycle_s = 1e-3 * charge_j / max(driving_w, standing_w, 1e-9)
    spent_j = 0.0
    while s.energy_j > 0.0:
        before_j = s.energy_j
        before_m = s.distance_m
        s.speed_mps = driving.speed_mps  # an average speed: the range excludes stops and starts
        advance(p, s, driving, duty * cycle_s)
        if duty < 1.0:
            advance(p, s, standing, (1.0 - duty) * cycle_s)
            # the share of a cycle for which the rest of the charge is enough
            if s.depleted and spent_j > 0.0:
                given_j = before_j - s.ledger_j[BELOW_CUTOFF]
                return before_m + min(given_j / spent_j, 1.0) * duty * cycle_s * driving.speed_mps
        spent_j = before_j - s.energy_j
        # A descent may consume nothing; effects with a memory may still change that.
        if spent_j <= 0.0 and cycle_s > thresholds.LONGEST_MEMORY_S:
            return np.inf
        # longer cycles, for the number of steps; what one spends grows with it
        if spent_j < 1e-3 * charge_j:
            cycle_s = 2.0 * cycle_s
            spent_j = 2.0 * spent_j
    return s.distance_m
