"""Checks of a companion's arguments; an invalid one is a `CompanionError` of one line."""

from __future__ import annotations

import math
import numbers
from typing import Any

import numpy as np

from homeward import thresholds as shared
from homeward.companion import thresholds
from homeward.companion.readings import CompanionError, as_float, checked_position


def check_number(name: str, value: Any, low: float, high: float) -> None:
    """Check that a value is a number within bounds."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real) or not low <= as_float(value) <= high:
        raise CompanionError(f"{name} = {value!r} is not allowed; give a number in [{low:.4g}, {high:.4g}]")


def check_route(route: Any, most_m: float) -> None:
    """Check that a route, if given, consists of places, and that the robot can drive it.

    Args:
        route: The route.
        most_m: Longest way that the robot can drive, m.
    """
    if route is None:
        return
    if not all(hasattr(route, name) for name in ("place_m", "grade_rad", "heading_rad")):
        raise CompanionError(f"route = {route!r} is not a route; give what homeward.envs.routes.load_route returns")
    try:
        grades, headings = (np.asarray(values, dtype=np.float64) for values in (route.grade_rad, route.heading_rad))
        length_m = as_float(route.place_m) * len(grades)
    except (TypeError, ValueError):
        raise CompanionError("the places of the route are no numbers; give what load_route returns") from None
    if not 0.0 < length_m <= most_m:
        raise CompanionError(
            f"the route is {length_m:.4g} m long; the robot can drive {most_m:.4g} m at most, "
            f"{thresholds.RANGES:g} charges"
        )
    if len(grades) != len(headings):
        raise CompanionError(
            f"the route has {len(grades)} slopes and {len(headings)} headings; give one of each a place"
        )
    steepest_rad, farthest_rad = (float(np.abs(values).max()) for values in (grades, headings))
    if not steepest_rad <= shared.STEEPEST_RAD:
        raise CompanionError(
            f"the route has slopes up to {steepest_rad:.3g} rad; up to {shared.STEEPEST_RAD:g} are allowed"
        )
    if not farthest_rad <= shared.MOST_HEADING_RAD:
        raise CompanionError(f"the route has headings up to {farthest_rad:.3g}; give radians")


def check_home(home: Any) -> None:
    """Check that home, if given, is `(east, north)` on the earth, or `"here"`."""
    if home is None or home == "here":
        return
    place = checked_position("home", home)
    if not isinstance(place, tuple) or not math.hypot(*place) <= thresholds.EARTH_M:
        raise CompanionError(f"home = {home!r} is not allowed; give (east, north) in metres, or 'here'")


def check_wind(forecast_mps: Any) -> None:
    """Check that a forecast of the wind, if given, is `(east, north)` and of a plausible strength."""
    if forecast_mps is not None:
        wind = checked_position("forecast_mps", forecast_mps)
        if not isinstance(wind, tuple) or math.hypot(*wind) > shared.MOST_WIND_MPS:
            raise CompanionError(f"forecast_mps = {forecast_mps!r} is not allowed; give (east, north) in m/s")
