"""Keyword arguments of the environments, checked, and the constants that follow from them."""

from __future__ import annotations

import dataclasses
import difflib
import numbers
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.conditions.difficulty import DIFFICULTIES, DIFFICULTY, Difficulty, Uniform
from homeward.envs.conditions.gauges import (
    GAUGES,
    RISE,
    resistance_ohm,
    rms_error,
    suits,
    write_gauge,
)
from homeward.envs.conditions.instruments import InstrumentError, Instruments, load_instruments
from homeward.envs.docks import DockError, Docks, checked, write_docks
from homeward.envs.mission_base import Mission
from homeward.envs.missions import CODES, MISSIONS
from homeward.envs.routes import load_route
from homeward.envs.routes.route import GENERATED, HIDDEN_WIND, MEAN_INTEREST, Route, RouteError
from homeward.envs.state import (
    DRAWN_DTYPE,
    HIDDEN_DTYPE,
    INVERSES,
    MAX_PLACES,
    SHARED_DTYPE,
)
from homeward.physics import Robot, ancillary_power, d_max, load_robot, optimal_speed
from homeward.physics import thresholds as physics_thresholds
from homeward.physics.intervals import Bounds
from homeward.physics.range import why_no_mission

ACTION_TYPES = ("discrete", "continuous", "flat")
SHAPINGS = ("dmax", "none")
RANDOMISATIONS = ("generic", "file")
WEATHERS = ("still", "changing")
RETURN_SHARE = 0.015
"""Decisions in a row that make a return final, over those in which the battery lasts at cruise:
usually three of two hundred. With one, a random policy ends its mission after three decisions. With
eight, the value of a return is hardly learned: stable-baselines3's PPO had learned to stand still
after 0.3 M decisions of OutAndBack, and with three to come home (0.4 M, 96 % of 200 unseen
missions; one seed of training each, at commit b39fd99, which had other features).
`benchmarks/agents/plain_ppo.py` measures the present result."""
OFF_COMMAND = 0.1
"""Share of a decision's way at top speed by which a robot may differ from its command: beyond that,
it is assumed to have driven evenly between its positions. Chosen: a tenth or twice of it changes no
test of `observer` and `onboard`."""
_MOST_HALF = 0.6
"""Half of the widest range that is drawn from a file's uncertainty. Chosen: the factors then stay
above 0.4."""
_CERTAIN = 1e12
"""Weight of the prior of the capacity, in readings, where it is certain; its inverse is the least
weight. Chosen: beyond the readings of any mission, and above 0, because it divides."""
_SQRT_3 = 3.0**0.5  # from half the width of a uniform number to its standard deviation

_DECISIONS = 200
"""Decisions in which a robot without sensing drives its battery empty, unless `decision_s` says
otherwise. Chosen: one consumes 0.5 % of the battery."""
_FEWEST_DECISIONS, _MOST_DECISIONS = 5, 20_000
"""Bounds of the same. With fewer, one decision is so much of the way that the moment to turn is a
matter of luck; with more, an episode takes tens of thousands of steps. One second is allowed for
every preset."""
_LONGEST = 5.0
"""Longest time limit, over the time that the battery lasts at cruise. Chosen: what the features
`modelled` and `charged` show ends at ten batteries, and the fastest sensing may double the
consumption."""
_REACH = 0.625
"""Distance scale and length of generated routes, over d_max. Chosen a quarter above the half from
which a robot comes home, so that the battery and not the end of the route limits it: of 1,000
missions out and back each, driven by `dmax_adaptive` (uncertain) and by `dmax_mapped` (known, also
with hidden wind), none reached the end."""
_MOST_CROSSINGS = 10_000
"""Places that may be crossed in one decision: each is an iteration of the kernel. Chosen: they take
about 2 ms."""
_HALF_INFORMATION = 0.25
"""Samples per metre that yield half of the information, over those of the fastest rate at cruise.
Chosen so that the five sensing levels yield 0, 1/2, 2/3, 3/4 and 4/5 at cruise."""
_MEMORY = 0.1
"""Samples that fit on board, over those of the fastest rate while the battery lasts at cruise.
Chosen so that the highest level fills it in a tenth of that time, and moderate sensing does not. Of
1,000 missions (uncertain), driven until the battery is empty with the speed of `dmax_adaptive`,
level 4 throughout overflows it in 48 % and level 2 in 15 %; with its own levels `dmax_adaptive`
loses nothing."""
_RADIO = 0.25
"""Samples that the radio sends at base, over those of the fastest rate. Chosen so that a standing
robot there keeps up with level 1, and a driving one with none."""
_LINK = 0.25
"""Distance at which the radio is half as fast, over the distance scale. Chosen so that a stop to
send gains near base and little from where a robot turns: at half of d_max 9 % of the rate are left.
`dmax_adaptive` sends 47 % of its information (1,000 missions, uncertain) and carries the rest
home."""


class OptionError(ValueError):
    """An invalid keyword argument of an environment; the message says what is allowed."""


class RenderModeError(OptionError, TypeError):
    """An unknown render mode; also a `TypeError`, after which stable-baselines3 continues without
    rendering."""


@dataclass(frozen=True)
class Options:
    """Keyword arguments of the environments.

    Attributes:
        mission: `OutAndBack`, `Survey` or `Patrol`; set by the id.
        robot: Preset name, path of a robot file, or a `Robot`.
        route: `generated`, `hidden_wind` (generated, with a tail wind on the way out that the
            forecast lacks), the name of a shipped profile, the path of a CSV profile or of a track
            (GPX, FIT, or CSV with positions), or a `Route`. At `known`, wind acts only on robots
            with the effect `wind`; at `uncertain` and `harsh`, on all.
        difficulty: `known` (as in the files, route and wind known), `uncertain` (battery health,
            rolling resistance, payload and wind hidden, changing weather, the route seen a little
            ahead and forecast beyond) or `harsh` (also rough patches); see
            `homeward.envs.conditions.difficulty`.
        instruments: Instruments of the robot: `exact`, `meter`, `gauge`, `any_gauge`, the path of a
            TOML file with sizes, or `Instruments`; by default those of the difficulty: `exact` for
            `known`, `meter` for `uncertain` and `any_gauge` for `harsh`.
        weather: `still` (as at the start) or `changing` (`homeward.envs.conditions.weather`); by
            default that of the difficulty. Nothing changes at `known`.
        action_type: `discrete` (`MultiDiscrete`), `continuous` (`Box`) or `flat` (`Discrete`: the
            combinations of `discrete` as one list, for learners such as DQN).
        shaping: `dmax` (potential-based, from d_max) or `none` (only the score on coming home).
        discount: Discount factor of the shaping, in (0, 1].
        decision_s: Time between decisions, s; by default a 200th of the time that the battery lasts
            at cruise, and between a 20,000th and a fifth of it.
        randomise: `generic` (robots within the ranges of the difficulty) or, from `uncertain` on,
            `file` (robots drawn with the uncertainty in the table `[uncertainty]` of the robot's
            file, and its instruments).
        true_robot: The robot that is simulated, if it is not `robot`: the map of the way home and
            the commands are those of `robot`, the consumption is not.
        scaled_for: The robot for which lengths, times and memory are scaled, if it is not `robot`:
            different robots then have the same routes and limits.
        docks: Charging places (`homeward.envs.docks`): pairs of position along the route (m) and
            power of the charger (W), or their text `POSITION:POWER,...`. A robot that stands at one
            charges.
        time_limit_s: Time limit of a mission, s, in whole decisions; by default twice the time that
            the battery lasts at cruise. Missions with docks need one, as no battery limits them.

    Raises:
        OptionError: A value is not allowed.
    """

    mission: str
    robot: str | Path | Robot = "rusti_computer"
    route: str | Path | Route = GENERATED
    difficulty: str = "uncertain"
    instruments: str | Path | Instruments | None = None
    weather: str | None = None
    action_type: str = "discrete"
    shaping: str = "dmax"
    discount: float = 0.9995
    decision_s: float | None = None
    randomise: str = "generic"
    true_robot: str | Path | Robot | None = None
    scaled_for: str | Path | Robot | None = None
    docks: Docks | str = ()
    time_limit_s: float | None = None

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("mission", self.mission, tuple(MISSIONS)),
            ("difficulty", self.difficulty, DIFFICULTIES),
            ("action_type", self.action_type, ACTION_TYPES),
            ("shaping", self.shaping, SHAPINGS),
            ("weather", self.weather or "still", WEATHERS),
            ("randomise", self.randomise, RANDOMISATIONS),
        ):
            if not isinstance(value, str) or value not in allowed:
                raise OptionError(
                    f"{name} = {value!r} is not allowed; choose from {', '.join(allowed)}"
                )
        object.__setattr__(self, "discount", _number("discount", self.discount, 1.0))
        if self.instruments is not None:
            try:
                load_instruments(self.instruments)
            except InstrumentError as error:
                raise OptionError(str(error)) from None
        for name in ("decision_s", "time_limit_s"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _number(name, getattr(self, name), 1e9))
        try:
            object.__setattr__(self, "docks", checked(self.docks))
        except DockError as error:
            raise OptionError(str(error)) from None
        if self.docks and self.time_limit_s is None:
            raise OptionError(
                "docks need a time limit, as no battery ends the mission; give one in seconds"
            )


def parse_options(keywords: dict[str, Any], others: tuple[str, ...] = ()) -> Options:
    """Make `Options` from keyword arguments.

    Args:
        keywords: Names and values.
        others: Further keywords of the caller, named among those allowed.

    Raises:
        OptionError: A keyword is unknown or a value is not allowed.
    """
    names = [field.name for field in dataclasses.fields(Options) if field.name != "mission"]
    for name in keywords:
        if name not in (*names, "mission"):
            close = difflib.get_close_matches(name, names, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise OptionError(
                f"unknown keyword {name!r}{hint}; allowed: {', '.join((*names, *others))}"
            )
    return Options(**keywords)


def check_reset_options(options: Any, allowed: tuple[str, ...] = ()) -> None:
    """Refuse options of `reset` that would have no effect.

    Args:
        options: Options as given to `reset`, or None.
        allowed: Names that are known there.

    Raises:
        OptionError: They are no dictionary, or a name is not allowed.
    """
    if options is None:
        return
    if not isinstance(options, dict):
        raise OptionError(
            f"options = {options!r} of reset is not allowed; give a dictionary or None"
        )
    unknown = [name for name in options if name not in allowed]
    if unknown:
        hint = (
            f"it knows {', '.join(allowed)}"
            if allowed
            else "it knows none; options of missions are given to make"
        )
        raise OptionError(f"reset does not know the option {unknown[0]!r}; {hint}")


def _number(name: str, value: Any, largest: float) -> float:
    bounds = Bounds(0.0, largest, open_low=True)
    if isinstance(value, bool) or not isinstance(value, numbers.Real) or not bounds.hold(value):
        raise OptionError(f"{name} = {value!r} is not allowed; give a number in {bounds}")
    return float(value)


@dataclass(frozen=True)
class Known:
    """Constants of the environment that agents may know: those that the robot itself knows.

    Attributes:
        mission: `OutAndBack`, `Survey` or `Patrol`.
        robot: The robot of its file, which is its own model.
        shared: `SHARED_DTYPE`, shape (1,).
        difficulty: Distributions of the hidden variables.
        instruments: Its instruments.
    """

    mission: str
    robot: Robot
    shared: NDArray[np.void]
    difficulty: Difficulty
    instruments: Instruments


@dataclass(frozen=True)
class Hidden:
    """Hidden constants of the environment.

    Attributes:
        robot: The true robot, around which those of missions are drawn.
        record: `HIDDEN_DTYPE`, shape (1,).
    """

    robot: Robot
    record: NDArray[np.void]


def known_of(options: Options) -> Known:
    """The constants that an agent may know; see `constants_of`."""
    return constants_of(options)[0]


def constants_of(options: Options) -> tuple[Known, Hidden]:
    """Constants of an environment.

    Everything scales with the robot, or with `scaled_for`: distances with its d_max, times with its
    battery's duration, information and memory with its fastest sensing rate, so that a mission
    takes a few hundred decisions with any robot.

    Raises:
        RobotError, RouteError, OptionError, InstrumentError: An option is invalid.
    """
    robot = _robot(options.robot)
    truth = robot if options.true_robot is None else _robot(options.true_robot)
    scale = robot if options.scaled_for is None else _robot(options.scaled_for)
    mission = MISSIONS[options.mission]
    cruise_mps = float(optimal_speed(scale))
    range_m = float(d_max(scale))
    lasts_s = range_m / cruise_mps
    decision_s = _decision_s(options, scale, lasts_s)
    reach_m = _REACH * range_m

    difficulty, instruments = _difficulty(options, robot, decision_s)

    hidden = np.zeros(1, HIDDEN_DTYPE)
    h = hidden[0]
    places = mission.places
    length_m = mission.length_m(reach_m, cruise_mps * decision_s)
    interest = MEAN_INTEREST
    is_generated = isinstance(options.route, str) and options.route in (GENERATED, HIDDEN_WIND)
    if not is_generated:
        route = (
            options.route
            if isinstance(options.route, Route)
            else load_route(options.route, length_m / places)
        )
        _check_route(route, scale, mission, range_m, decision_s)
        _write(route, h["fixed"])
        places = len(route.grade_rad)
        length_m = route.length_m
        interest = float(route.interest.mean())
        h["temperature_c"] = route.temperature_c
        h["wind_mps"] = route.wind_mps
        h["wind_from_rad"] = route.wind_from_rad
    h["truth"] = truth.record()[0]
    h["full_j"] = truth.usable_energy_j
    h["generated"] = is_generated
    h["hidden_wind"] = is_generated and options.route == HIDDEN_WIND
    h["own_robots"] = not difficulty.route_is_known or truth is not robot
    h["forecast_errs"] = not difficulty.route_is_known
    h["weather_changes"] = difficulty.weather_changes
    for name in DRAWN_DTYPE.names or ():
        uniform = getattr(difficulty, name)
        h["drawn"][name] = uniform.low, uniform.high - uniform.low

    shared = np.zeros(1, SHARED_DTYPE)
    s = shared[0]
    s["mission"] = CODES[mission.name]
    s["shuttles"] = mission.shuttles
    s["senses"] = mission.senses
    s["route_is_known"] = difficulty.route_is_known
    s["shaped"] = options.shaping == "dmax"
    s["discrete"] = options.action_type != "continuous"
    s["max_decisions"] = _max_decisions(options, scale, lasts_s, decision_s)
    s["return_decisions"] = max(round(RETURN_SHARE * lasts_s / decision_s), 1)
    s["decision_s"] = decision_s
    s["discount"] = options.discount
    s["places"] = places
    s["length_m"] = length_m
    s["place_m"] = length_m / places
    s["reach_m"] = reach_m
    _write_robot(robot, s)
    # What a robot could do with the scaled one's sensors, memory and radio.
    s["saturation_per_m"] = _HALF_INFORMATION * scale.max_sensing_hz / cruise_mps
    s["backlog_limit"] = _MEMORY * scale.max_sensing_hz * lasts_s
    s["radio_hz"] = _RADIO * scale.max_sensing_hz
    s["link_m"] = _LINK * reach_m
    pit_stop_s = mission.pit_stop * length_m / cruise_mps
    s["pit_stop_s"] = pit_stop_s
    # At half of the fastest sensing rate a metre yields two thirds of its information.
    s["information_per_m"] = interest * 2.0 / 3.0

    duty = length_m / (length_m + cruise_mps * pit_stop_s)
    range_of_all_m = _mission_range_m(robot.without_cutoff(), mission, duty)
    s["energy_per_m"] = robot.usable_energy_j / range_of_all_m
    s["out_and_home_j_per_m"] = s["energy_per_m"] + s["cruise_w"] / s["cruise_mps"]
    half_m = 0.5 * _mission_range_m(scale, mission, duty)
    if mission.senses and interest <= 0.0:
        raise OptionError(
            "route has no interest anywhere, so a survey cannot score; give some place an interest above 0"
        )
    s["score_scale"] = mission.good_score(half_m, s)
    _write_instruments(instruments, robot, difficulty, s)
    try:
        write_docks(checked(options.docks), float(ancillary_power(robot, 0.0)), s)
    except DockError as error:
        raise OptionError(str(error)) from None
    for inverse, name in INVERSES.items():
        if s[name]:
            s[inverse] = 1.0 / s[name]
    known = Known(
        mission=options.mission,
        robot=robot,
        shared=shared,
        difficulty=difficulty,
        instruments=instruments,
    )
    return known, Hidden(robot=truth, record=hidden)


def _robot(option: Any) -> Robot:
    """A robot of an option, which must drive, and run empty.

    Raises:
        RobotError, OptionError: It cannot be loaded, or never does.
    """
    robot = load_robot(option)
    reason = why_no_mission(robot)
    if reason:
        raise OptionError(reason)
    return robot


def _difficulty(
    options: Options, robot: Robot, decision_s: float
) -> tuple[Difficulty, Instruments]:
    """What varies between missions, and the instruments, with what other options change of them."""
    difficulty = DIFFICULTY[options.difficulty]
    if options.weather == "still":
        difficulty = replace(difficulty, weather_changes=False)
    if options.instruments is None:
        instruments = load_instruments(difficulty.instruments)
        own_s: float | None = decision_s
    else:
        instruments = load_instruments(options.instruments)
        own_s = None
    if options.randomise == "file":
        difficulty, instruments = _by_file(robot, difficulty, own_s, instruments)
    return difficulty, instruments


def _write_robot(robot: Robot, s: Any) -> None:
    """Write what the robot of the file can do into the shared record."""
    cruise_mps = float(optimal_speed(robot))
    s["min_speed_mps"] = robot.min_speed_mps
    s["max_speed_mps"] = robot.max_speed_mps
    s["max_sensing_hz"] = robot.max_sensing_hz
    s["curve"] = tuple(robot.curve)
    s["curved"] = robot.curve.mean_v > 0.0
    s["usable_j"] = robot.usable_energy_j
    s["cruise_mps"] = cruise_mps
    range_of_all_m = d_max(robot.without_cutoff(), cruise_mps)
    s["cruise_w"] = robot.usable_energy_j * s["cruise_mps"] / range_of_all_m
    s["drag_j_per_m"] = robot.drag_ns2_per_m2 / robot.traction_efficiency


def _mission_range_m(robot: Robot, mission: Mission, duty: float) -> float:
    """Range of a robot on a mission at cruise, m: with its pit stops, and half of the fastest
    sensing rate."""
    sensing_hz = 0.0
    if mission.senses:
        sensing_hz = 0.5 * robot.max_sensing_hz
    return float(d_max(robot, float(optimal_speed(robot)), duty=duty, sensing_hz=sensing_hz))


def _by_file(
    robot: Robot, difficulty: Difficulty, own_s: float | None, instruments: Instruments
) -> tuple[Difficulty, Instruments]:
    """Ranges and instruments of the robot's file; what it lacks is that of the difficulty.

    A range is that of a uniform distribution with the file's standard deviation. Instruments are
    the file's own if the time between decisions is given, because a reading is then a mean over it.
    """
    uncertainty = robot.uncertainty
    if uncertainty is None or uncertainty.of == "charge" or difficulty.route_is_known:
        why = f"{robot.name!r} has no table [uncertainty] of energy or force"
        if difficulty.route_is_known and uncertainty is not None:
            why = "nothing is hidden at `known`"
        raise OptionError(
            f"randomise = 'file' is not allowed: {why}; give the corrected.toml of a diagnosis"
        )

    def around(middle: float, name: str, otherwise: Uniform, between_runs: float = 0.0) -> Uniform:
        variance = uncertainty.variance(name)
        if variance is None and between_runs == 0.0:
            return otherwise
        half = min(_SQRT_3 * float(np.hypot(np.sqrt(variance or 0.0), between_runs)), _MOST_HALF)
        return Uniform(middle - half, middle + half)

    rolling = difficulty.rolling
    has_one_run = uncertainty.between_runs is None and uncertainty.of == "energy"
    if not has_one_run:
        rolling = around(1.0, "rolling", difficulty.rolling, uncertainty.between_runs or 0.0)
    difficulty = replace(
        difficulty,
        health=around(1.0, "capacity", difficulty.health),
        rolling=rolling,
        payload=around(0.0, "mass", difficulty.payload),
    )
    if own_s is None:
        return difficulty, instruments
    sizes: dict[str, Any] = {}
    for name, size in uncertainty.instruments:
        sizes[name] = size if name == "soc_lag_s" else min(size, physics_thresholds.MOST_ERROR)
    sizes.pop("reading_s", None)
    if "power_noise" in sizes:
        # A reading over a decision is a mean of several of the robot's own.
        reading_s = dict(uncertainty.instruments).get("reading_s", own_s)
        sizes["power_noise"] *= min(reading_s / own_s, 1.0) ** 0.5
    return difficulty, replace(instruments, **sizes)


def _write_instruments(
    instruments: Instruments, robot: Robot, difficulty: Difficulty, s: Any
) -> None:
    s["inexact"] = instruments != Instruments()
    for name in ("soc_noise", "power_gain", "power_noise", "speed_noise", "grade_noise"):
        s[name] = getattr(instruments, name)
    _write_gauges(instruments, robot, s)
    s["soc_lag_decisions"] = instruments.soc_lag_s / s["decision_s"]
    s["soc_keeps"] = 0.0
    if instruments.soc_lag_s:
        s["soc_keeps"] = np.exp(-s["decision_s"] / instruments.soc_lag_s)
    fastest_mps = np.array([robot.max_speed_mps])
    driving_w = robot.usable_energy_j * fastest_mps / d_max(robot.without_cutoff(), fastest_mps)
    sensing_w = float(ancillary_power(robot, robot.max_sensing_hz) - ancillary_power(robot, 0.0))
    full_w = driving_w + sensing_w
    s["power_offset_w"] = instruments.power_offset * full_w[0]
    # A metered joule is 1 / (health * gain) of a joule by the file: mean and deviation to first
    # order.
    health = difficulty.health
    health_sd = health.deviation / health.mean
    s["soc_per_metered"] = (1.0 + health_sd**2) / health.mean
    deviation = float(s["soc_per_metered"]) * np.hypot(health_sd, instruments.power_gain / _SQRT_3)
    # Never zero: before anything is metered, only the prior is known.
    s["soc_prior"] = _CERTAIN
    if deviation > 0.0:
        variance = instruments.soc_variance + s["soc_error"] ** 2
        s["soc_prior"] = max(variance / deviation**2, 1.0 / _CERTAIN)


def _write_gauges(instruments: Instruments, robot: Robot, s: Any) -> None:
    """Write the gauges that a robot can have: those that map a voltage only if it changes with the
    charge."""
    fitting = [GAUGES[name] for name in instruments.gauges if suits(GAUGES[name], robot)]
    if not fitting:
        raise OptionError(
            f"instruments have the gauges {', '.join(instruments.gauges)}, but {robot.name!r} has a constant voltage; "
            "give its chemistry and cells_in_series, or another gauge"
        )
    lasts_s = robot.usable_energy_j / float(s["cruise_w"])
    s["soc_error"] = np.sqrt(
        np.mean([rms_error(gauge, robot, lasts_s, RISE) ** 2 for gauge in fitting])
    )
    s["resistance_ohm"] = resistance_ohm(robot)
    s["gauge_count"] = len(fitting)
    for gauge, record in zip(fitting, s["gauges"], strict=False):
        write_gauge(
            gauge,
            robot,
            instruments.soc_step,
            instruments.soc_lag_s,
            float(s["decision_s"]),
            record,
        )


def _decision_s(options: Options, robot: Robot, lasts_s: float) -> float:
    if options.decision_s is None:
        return float(f"{lasts_s / _DECISIONS:.1g}")
    least_s = float(f"{lasts_s / _MOST_DECISIONS:.2g}")
    most_s = float(f"{lasts_s / _FEWEST_DECISIONS:.2g}")
    if not least_s <= options.decision_s <= most_s:
        raise OptionError(
            f"decision_s = {options.decision_s:g} is not allowed; give {least_s:g} to {most_s:g} s, as the battery of "
            f"{robot.name!r} lasts {lasts_s:.0f} s: {_FEWEST_DECISIONS} to {_MOST_DECISIONS} decisions"
        )
    return options.decision_s


def _max_decisions(options: Options, robot: Robot, lasts_s: float, decision_s: float) -> int:
    if options.time_limit_s is None:
        return int(np.ceil(2.0 * lasts_s / decision_s))
    least_s, most_s = _FEWEST_DECISIONS * decision_s, _LONGEST * lasts_s
    if not least_s <= options.time_limit_s <= most_s:
        raise OptionError(
            f"time_limit_s = {options.time_limit_s:g} is not allowed; give {least_s:g} to {most_s:.0f} s: "
            f"{_FEWEST_DECISIONS} decisions to {_LONGEST:g} times the {lasts_s:.0f} s that the battery of "
            f"{robot.name!r} lasts"
        )
    return int(options.time_limit_s / decision_s * (1.0 + 1e-12))


def _check_route(
    route: Route, robot: Robot, mission: Mission, range_m: float, decision_s: float
) -> None:
    shortest_m = float(f"{robot.max_speed_mps * decision_s / _MOST_CROSSINGS:.1g}")
    if route.place_m < shortest_m:
        raise RouteError(
            f"route has {len(route.grade_rad)} places of {route.place_m:g} m; give places of at least {shortest_m:g} "
            f"m, so that {robot.name!r} crosses no more than {_MOST_CROSSINGS} in a decision of {decision_s:g} s"
        )
    longest_m = float(f"{mission.longest * range_m:.2g}")
    if route.length_m > longest_m:
        raise RouteError(
            f"route is {route.length_m:g} m long; give at most {longest_m:g} m, {mission.longest:g} times what "
            f"{robot.name!r} drives on one charge ({range_m:.0f} m)"
        )


def _write(route: Route, target: Any) -> None:
    count = len(route.grade_rad)
    if count > MAX_PLACES:
        raise OptionError(f"route has {count} places; give at most {MAX_PLACES}")
    places = target["places"][:count]
    places["sin_grade"] = np.sin(route.grade_rad)
    places["roughness"] = route.roughness
    places["interest"] = route.interest
    places["curvature_per_m"] = route.curvature_per_m
    places["east"] = np.cos(route.heading_rad)
    places["north"] = np.sin(route.heading_rad)
