"""What an environment is made with: keyword arguments, checked, and the constants that follow from them."""

from __future__ import annotations

import dataclasses
import difflib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.difficulty import DIFFICULTIES
from homeward.envs.routes import GENERATED, HIDDEN_WIND, Route, load_route
from homeward.envs.state import INVERSES, MAX_PLACES, OUT_AND_BACK, PATROL, ROUTE_DTYPE, SHARED_DTYPE, SURVEY
from homeward.physics import Robot, d_max, load_robot, optimal_speed

MISSIONS = {"OutAndBack": OUT_AND_BACK, "Survey": SURVEY, "Patrol": PATROL}
ACTION_TYPES = ("discrete", "continuous")
SHAPINGS = ("dmax", "none")

_PLACES, _PATROL_PLACES = 32, 4
_DECISIONS = 200
"""Decisions in which a robot that senses nothing drives its battery empty."""
_REACH = 0.625
"""Distance scale and length of generated routes over d_max: a quarter more than half of it."""
_TYPICAL_INTEREST = 1.23
"""Mean interest of generated routes, measured over 2,000 of them."""


class OptionError(ValueError):
    """A keyword argument of an environment that cannot be used; the message says what is allowed."""


class RenderModeError(OptionError, TypeError):
    """A render mode that there is not; a `TypeError` too, from which stable-baselines3 goes on without rendering."""


@dataclass(frozen=True)
class Options:
    """Keyword arguments of the environments.

    Attributes:
        mission: `OutAndBack`, `Survey` or `Patrol`; the id says which.
        robot: Preset name, path of a robot file, or a `Robot`.
        route: `generated`, `hidden_wind` (generated, with a wind that helps on the way out and hurts on the way home),
            the name or path of a CSV profile, or a `Route`. Wind is felt by robots with the effect `wind`: from
            `uncertain` on, by all.
        difficulty: `known` (as in the files, route seen), `uncertain` (battery health, rolling resistance, payload and
            headwind hidden, route seen a little ahead) or `harsh` (also rough patches and a biased fuel gauge).
        action_type: `discrete` (`MultiDiscrete`) or `continuous` (`Box`).
        shaping: `dmax` (potential-based, from d_max) or `none` (the score on coming home, and nothing else).
        discount: Discount factor that the shaping is consistent with, in (0, 1].
        decision_s: Time between decisions, s; by default a 200th of the time that the battery lasts at cruise.
    """

    mission: str
    robot: str | Path | Robot = "rusti_computer"
    route: str | Path | Route = GENERATED
    difficulty: str = "uncertain"
    action_type: str = "discrete"
    shaping: str = "dmax"
    discount: float = 0.9995
    decision_s: float | None = None

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("mission", self.mission, tuple(MISSIONS)),
            ("difficulty", self.difficulty, DIFFICULTIES),
            ("action_type", self.action_type, ACTION_TYPES),
            ("shaping", self.shaping, SHAPINGS),
        ):
            if not isinstance(value, str) or value not in allowed:
                raise OptionError(f"{name} = {value!r} is not allowed; choose from {', '.join(allowed)}")
        _check_number("discount", self.discount, 0.0, 1.0)
        if self.decision_s is not None:
            _check_number("decision_s", self.decision_s, 0.0, 1e6)


def parse_options(keywords: dict[str, Any], others: tuple[str, ...] = ()) -> Options:
    """Make `Options` from keyword arguments.

    Args:
        keywords: Names and values.
        others: Further keywords that the caller takes, to be named among those allowed.

    Raises:
        OptionError: A keyword is unknown or a value is not allowed.
    """
    known = [field.name for field in dataclasses.fields(Options) if field.name != "mission"]
    for name in keywords:
        if name not in (*known, "mission"):
            close = difflib.get_close_matches(name, known, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise OptionError(f"unknown keyword {name!r}{hint}; allowed: {', '.join((*known, *others))}")
    return Options(**keywords)


def _check_number(name: str, value: Any, low: float, high: float) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low < value <= high:
        raise OptionError(f"{name} = {value!r} is not allowed; give a number in ({low:g}, {high:g}]")


@dataclass(frozen=True)
class Setting:
    """An environment's constants: the robot, `SHARED_DTYPE` record (1,), a given route and its day."""

    robot: Robot
    shared: NDArray[np.void]
    fixed: NDArray[np.void]  # (1,), `ROUTE_DTYPE`
    day: NDArray[np.float64]  # (3,): temperature, wind, its direction


def settle(options: Options) -> Setting:
    """Work out the constants of an environment.

    Everything scales with the robot: distances with its d_max, time with how long its battery lasts, information and
    memory with its fastest sensing rate, so that a mission takes a few hundred decisions with any robot.

    Raises:
        RobotError, RouteError, OptionError: An option cannot be used.
    """
    robot = load_robot(options.robot)
    mission = MISSIONS[options.mission]
    cruise = float(optimal_speed(robot))
    range_m = float(d_max(robot))
    if not np.isfinite(range_m):
        raise OptionError(f"robot {robot.name!r} never runs empty on the flat; check what its effects give back")
    lasts_s = range_m / cruise
    decision_s = options.decision_s or float(f"{lasts_s / _DECISIONS:.1g}")
    generated = isinstance(options.route, str) and options.route in (GENERATED, HIDDEN_WIND)
    reach_m = _REACH * range_m

    length_m = 4.0 * cruise * decision_s if mission == PATROL else reach_m
    places = _PATROL_PLACES if mission == PATROL else _PLACES
    fixed, day, interest = np.zeros(1, ROUTE_DTYPE), np.array([20.0, 0.0, 0.0]), _TYPICAL_INTEREST
    if not generated:
        route = options.route if isinstance(options.route, Route) else load_route(options.route, length_m / places)
        _write(route, fixed)
        places, length_m, interest = len(route.grade_rad), route.length_m, float(route.interest.mean())
        day = np.array([route.temperature_c, route.wind_mps, route.wind_from_rad])
    pit_stop_s = 0.5 * length_m / cruise if mission == PATROL else 0.0

    shared = np.zeros(1, SHARED_DTYPE)
    s = shared[0]
    s["mission"], s["difficulty"] = mission, DIFFICULTIES.index(options.difficulty)
    s["generated"], s["hidden_wind"] = generated, generated and options.route == HIDDEN_WIND
    s["shaped"], s["discrete"] = options.shaping == "dmax", options.action_type == "discrete"
    s["max_decisions"] = int(np.ceil(2.0 * lasts_s / decision_s))
    s["decision_s"], s["discount"] = decision_s, options.discount
    s["min_speed_mps"], s["max_speed_mps"] = robot.min_speed_mps, robot.max_speed_mps
    s["max_sensing_hz"] = robot.max_sensing_hz
    s["places"], s["length_m"], s["place_m"], s["reach_m"] = places, length_m, length_m / places, reach_m
    s["usable_j"], s["cruise_mps"] = robot.usable_energy_j, cruise
    s["saturation_per_m"] = 0.25 * robot.max_sensing_hz / cruise
    s["backlog_limit"] = 0.1 * robot.max_sensing_hz * lasts_s
    s["radio_hz"], s["link_m"] = 0.25 * robot.max_sensing_hz, 0.25 * reach_m
    s["pit_stop_s"] = pit_stop_s
    s["drag_j_per_m"] = robot.drag_ns2_per_m2 / robot.traction_efficiency
    # At half of the fastest sensing rate a metre yields two thirds of its information.
    s["information_per_m"] = interest * 2.0 / 3.0
    sensing_hz = 0.5 * robot.max_sensing_hz if mission == SURVEY else 0.0
    duty = length_m / (length_m + cruise * pit_stop_s)
    mission_range_m = float(d_max(robot, cruise, duty=duty, sensing_hz=sensing_hz))
    s["energy_per_m"] = robot.usable_energy_j / mission_range_m
    half_m = 0.5 * mission_range_m
    if mission == SURVEY and interest <= 0.0:
        raise OptionError(
            "route has no interest anywhere, so a survey cannot score; give some place an interest above 0"
        )
    s["score_scale"] = (half_m, half_m * s["information_per_m"], half_m / length_m)[mission]
    for inverse, name in INVERSES.items():
        s[inverse] = 1.0 / s[name]
    return Setting(robot, shared, fixed, day)


def _write(route: Route, target: NDArray[np.void]) -> None:
    count = len(route.grade_rad)
    if count > MAX_PLACES:
        raise OptionError(f"route has {count} places; give at most {MAX_PLACES}")
    places = target["places"][0, :count]
    places["sin_grade"] = np.sin(route.grade_rad)
    places["roughness"], places["interest"] = route.roughness, route.interest
    places["curvature_per_m"], places["heading_rad"] = route.curvature_per_m, route.heading_rad
