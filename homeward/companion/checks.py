"""Checks of a companion's arguments; an invalid one is a `CompanionError` of one line."""

from __future__ import annotations

import math
import numbers
from typing import Any

from homeward import rules as shared
from homeward.companion.readings import CompanionError, checked_position


def check_number(name: str, value: Any, low: float, high: float) -> None:
    """Check that a value is a number within bounds."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real) or not low <= float(value) <= high:
        raise CompanionError(f"{name} = {value!r} is not allowed; give a number in [{low:.4g}, {high:.4g}]")


def check_route(route: Any) -> None:
    """Check that a route, if given, consists of places."""
    if route is not None and not all(hasattr(route, name) for name in ("place_m", "grade_rad", "heading_rad")):
        raise CompanionError(f"route = {route!r} is not a route; give what homeward.envs.routes.load_route returns")


def check_home(home: Any) -> None:
    """Check that home, if given, is `(east, north)` or `"here"`."""
    if home is not None and home != "here" and not isinstance(checked_position("home", home), tuple):
        raise CompanionError(f"home = {home!r} is not allowed; give (east, north) in metres, or 'here'")


def check_wind(forecast_mps: Any) -> None:
    """Check that a forecast of the wind, if given, is `(east, north)` and of a plausible strength."""
    if forecast_mps is not None:
        wind = checked_position("forecast_mps", forecast_mps)
        if not isinstance(wind, tuple) or math.hypot(*wind) > shared.MOST_WIND_MPS:
            raise CompanionError(f"forecast_mps = {forecast_mps!r} is not allowed; give (east, north) in m/s")
