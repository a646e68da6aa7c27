"""Checks of a companion's arguments; an invalid one is a `CompanionError` of one line.

Numbers may be of any type, such as those of numpy; what is returned are floats, so that a saved
state holds nothing else.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from homeward import thresholds as shared
from homeward.companion import thresholds
from homeward.companion.advice import HOME
from homeward.companion.readings import CompanionError, Position, as_float, checked_position


def checked_number(name: str, value: Any, low: float, high: float) -> float:
    """A number within bounds."""
    if (
        isinstance(value, bool)
        or not isinstance(value, numbers.Real)
        or not low <= as_float(value) <= high
    ):
        raise CompanionError(
            f"{name} = {value!r} is not allowed; give a number in [{low:.4g}, {high:.4g}]"
        )
    return as_float(value)


def checked_if_given(name: str, value: Any, low: float, high: float) -> float | None:
    """A number within bounds; None if it is not given."""
    if value is None:
        return None
    return checked_number(name, value, low, high)


def check_route(route: Any, most_m: float) -> None:
    """Check that a route, if given, consists of places, and that the robot can drive it.

    Args:
        route: The route.
        most_m: Longest way that the robot can drive, m.
    """
    if route is None:
        return
    if not all(hasattr(route, name) for name in ("place_m", "grade_rad", "heading_rad")):
        raise CompanionError(
            f"route = {route!r} is not a route; give what homeward.envs.routes.load_route returns"
        )
    try:
        grades = np.asarray(route.grade_rad, dtype=np.float64)
        headings = np.asarray(route.heading_rad, dtype=np.float64)
        length_m = as_float(route.place_m) * len(grades)
    except (TypeError, ValueError):
        raise CompanionError(
            "the places of the route are no numbers; give what load_route returns"
        ) from None
    if not 0.0 < length_m <= most_m:
        raise CompanionError(
            f"the route is {length_m:.4g} m long; the robot can drive {most_m:.4g} m at most, "
            f"{thresholds.RANGES:g} charges"
        )
    if len(grades) != len(headings):
        raise CompanionError(
            f"the route has {len(grades)} slopes and {len(headings)} headings; give one of each a place"
        )
    steepest_rad = float(np.abs(grades).max())
    largest_heading_rad = float(np.abs(headings).max())
    if not steepest_rad <= shared.STEEPEST_RAD:
        raise CompanionError(
            f"the route has slopes up to {steepest_rad:.3g} rad; up to {shared.STEEPEST_RAD:g} are allowed"
        )
    if not largest_heading_rad <= shared.MOST_HEADING_RAD:
        raise CompanionError(
            f"the route has headings up to {largest_heading_rad:.3g}; give radians"
        )


def checked_home(home: Any) -> tuple[float, float] | str | None:
    """Home, if given: `(east, north)` on the earth, or `"here"`."""
    if home is None:
        return None
    if isinstance(home, str) and home == "here":
        return "here"
    place = checked_position("home", home)
    if not isinstance(place, tuple) or not math.hypot(*place) <= thresholds.EARTH_M:
        raise CompanionError(
            f"home = {home!r} is not allowed; give (east, north) in metres, or 'here'"
        )
    return place


def docks_of(texts: Sequence[str]) -> dict[str, Position]:
    """Docks as a command line gives them: `NAME=EAST,NORTH` or `NAME=METRES`.

    >>> docks_of(["bay=40,-12.5", "hut=1200"])
    {'bay': (40.0, -12.5), 'hut': 1200.0}
    """
    docks: dict[str, Position] = {}
    for text in texts:
        name, _, place = text.partition("=")
        try:
            numbers_m = [float(number) for number in place.split(",")]
        except ValueError:
            numbers_m = []
        if not all(map(math.isfinite, numbers_m)) or len(numbers_m) not in (1, 2):
            raise CompanionError(
                f"--docks {text!r} is not allowed; give NAME=EAST,NORTH or NAME=METRES"
            )
        if name in docks:
            raise CompanionError(f"--docks names {name!r} twice; give each dock another name")
        if len(numbers_m) == 1:
            docks[name] = numbers_m[0]
        else:
            east_m, north_m = numbers_m
            docks[name] = (east_m, north_m)
    return docks


def checked_docks(
    docks: Any, home: Any, route_m: float | None, most_m: float
) -> dict[str, Position]:
    """Docks by their names, each a place that the robot can come to.

    Args:
        docks: Places by name, as given.
        home: Home, as given and checked.
        route_m: Length of the route, m; None without one.
        most_m: Longest way home that is possible, m.
    """
    if docks is None:
        return {}
    if not isinstance(docks, Mapping):
        raise CompanionError(
            f"docks = {docks!r} is not allowed; give places by name, such as {{'bay': (40.0, -12.0)}}"
        )
    return {
        str(name): _checked_dock(name, place, home, route_m, most_m)
        for name, place in docks.items()
    }


def _checked_dock(
    name: Any, place: Any, home: Any, route_m: float | None, most_m: float
) -> Position:
    if not isinstance(name, str) or not name.strip() or name == HOME:
        raise CompanionError(
            f"a dock named {name!r} is not allowed; give it another name than '', and than {HOME!r}"
        )
    dock = checked_position(f"dock {name!r}", place)
    takes_metres = home is None or route_m is not None
    takes_coordinates = home is not None
    farthest_m = most_m
    if route_m is not None:
        farthest_m = route_m
    if isinstance(dock, float):
        possible = takes_metres and 0.0 <= dock <= farthest_m
    elif dock is None or not takes_coordinates:
        possible = False
    elif isinstance(home, tuple):
        possible = math.dist(dock, home) <= most_m
    else:
        possible = math.hypot(*dock) <= thresholds.EARTH_M
    if not possible:
        allowed = []
        if takes_metres:
            allowed.append(f"metres from home along the way, 0 to {farthest_m:.4g}")
        if takes_coordinates:
            allowed.append(f"(east, north) in the frame of home, within {most_m:.4g} m of it")
        raise CompanionError(
            f"dock {name!r} = {place!r} is not allowed; give {' or '.join(allowed)}"
        )
    assert dock is not None
    return dock


def checked_wind(forecast_mps: Any) -> tuple[float, float] | None:
    """A forecast of the wind, if given: `(east, north)`, of a plausible strength."""
    if forecast_mps is None:
        return None
    wind = checked_position("forecast_mps", forecast_mps)
    if not isinstance(wind, tuple) or math.hypot(*wind) > shared.MOST_WIND_MPS:
        raise CompanionError(
            f"forecast_mps = {forecast_mps!r} is not allowed; give (east, north) in m/s"
        )
    return wind
