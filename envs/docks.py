"""Docks: charging places along a route. A robot that stands at one is connected to its charger."""

from __future__ import annotations

import numbers
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.envs.features import DOCK_FEATURES, LIMIT
from homeward.envs.state import MOST_DOCKS
from homeward.physics.jit import inline

Docks = tuple[tuple[float, float], ...]
"""Position along the route (m) and power of the charger (W) of each dock."""

ON_BORDER = 1e-6
"""Share of a place within which a dock is on a border between places. Chosen: above rounding, and
no distance."""


class DockError(ValueError):
    """Docks that cannot be used; the message says what is allowed."""


def docks_of(text: str) -> Docks:
    """Docks as a command line gives them.

    Raises:
        DockError: The text is not of the form `POSITION:POWER,...`.

    >>> docks_of("0:60,120:45.5")
    ((0.0, 60.0), (120.0, 45.5))
    """
    pairs = [dock.split(":") for dock in text.split(",")] if text else []
    try:
        return tuple((float(position_m), float(charger_w)) for position_m, charger_w in pairs)
    except ValueError:
        raise DockError(
            f"docks = {text!r} is not allowed; give POSITION:POWER,... in metres along the route and watts, such as "
            "0:60,120:45"
        ) from None


def checked(docks: Any) -> Docks:
    """Docks by increasing position.

    Args:
        docks: Pairs of position (m) and power (W), or their text (`docks_of`).

    Raises:
        DockError: They are no pairs of numbers, too many, two are at one position, or a number is
            not allowed.
    """
    if isinstance(docks, str):
        docks = docks_of(docks)
    pairs = (
        [tuple(dock) for dock in docks] if _is_list(docks) and all(map(_is_list, docks)) else None
    )
    if pairs is None or not all(len(dock) == 2 and all(map(_is_number, dock)) for dock in pairs):
        raise DockError(
            f"docks = {docks!r} is not allowed; give pairs of position (m) and power of the charger (W)"
        )
    if len(pairs) > MOST_DOCKS:
        raise DockError(f"{len(pairs)} docks are given; give at most {MOST_DOCKS}")
    for position_m, charger_w in pairs:
        if not 0.0 <= position_m < np.inf:
            raise DockError(f"a dock at {position_m:g} m is not on the route; home is 0 m")
        if not 0.0 < charger_w < np.inf:
            raise DockError(
                f"the charger of the dock at {position_m:g} m has {charger_w:g} W; give a power above 0 W"
            )
    positions_m = [position_m for position_m, _ in pairs]
    if len(set(positions_m)) < len(positions_m):
        raise DockError(
            f"two docks are at one position, of {', '.join(f'{at_m:g}' for at_m in positions_m)} m"
        )
    return tuple(sorted((float(position_m), float(charger_w)) for position_m, charger_w in pairs))


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def write_docks(docks: Docks, idle_w: float, shared: Any) -> None:
    """Write docks into the shared record, which has the route's length; one beside a border is on
    it.

    Args:
        docks: The docks.
        idle_w: Power of the robot at a stand with nothing sensed, W.
        shared: Shared record.

    Raises:
        DockError: One is beyond the end of the route, or its charger is weaker than the robot's
            electronics.
    """
    length_m = float(shared["length_m"])
    place_m = float(shared["place_m"])
    shared["dock_count"] = len(docks)
    for (position_m, charger_w), record in zip(docks, shared["docks"], strict=False):
        border = round(position_m / place_m)
        if abs(position_m / place_m - border) < ON_BORDER:
            position_m = border * place_m
        if position_m > max(length_m, shared["places"] * place_m):
            raise DockError(
                f"a dock at {position_m:g} m is not on the route, which ends at {length_m:g} m"
            )
        if charger_w <= idle_w:
            raise DockError(
                f"the charger of the dock at {position_m:g} m has {charger_w:g} W, which charges no battery; give more "
                f"than the {idle_w:.3g} W that the robot consumes at a stand"
            )
        record["position_m"] = position_m
        record["charger_w"] = charger_w


@inline
def charger_w(mission: Any, shared: Any) -> Any:
    """Power of the charger where the robot is, W; 0 where there is none."""
    for k in range(shared.dock_count):
        if mission.position_m == shared.docks[k].position_m:
            return shared.docks[k].charger_w
    return 0.0


@inline
def next_dock_m(mission: Any, shared: Any) -> Any:
    """Position of the next dock in the direction of travel, m, which may be here; infinite if there
    is none."""
    nearest_m = np.inf
    position_m = np.inf
    for k in range(shared.dock_count):
        ahead_m = mission.direction * (shared.docks[k].position_m - mission.position_m)
        if 0.0 <= ahead_m < nearest_m:
            nearest_m = ahead_m
            position_m = shared.docks[k].position_m
    return position_m


def observe_docks(
    records: NDArray[np.void], routes: NDArray[np.void], shared: Any, features: NDArray[np.float32]
) -> None:
    """Write `homeward.envs.features.DOCK_FEATURES` of missions.

    Args:
        records: `MISSION_DTYPE`, shape (n,).
        routes: `ROUTE_DTYPE`, shape (n,).
        shared: Shared record.
        features: Written, shape (n, len(DOCK_FEATURES)).
    """
    position_m = records["position_m"]
    place_m = float(shared["place_m"])
    ground_here = records["here"]
    home_cost_j = (
        ground_here["home_cost_j"]
        + (position_m - records["place"] * place_m) * ground_here["home_j_per_m"]
    )
    out_m = np.full(len(records), np.inf)
    back_m = position_m.copy()
    back_j = home_cost_j.astype(np.float64)
    # By increasing position: the last one behind is the nearest there, and the first one ahead the
    # nearest ahead.
    for dock in shared["docks"][: int(shared["dock_count"])]:
        away_m = dock["position_m"] - position_m
        place = min(int(dock["position_m"] / place_m), int(shared["places"]) - 1)
        ground = routes["places"][:, place]
        cost_j = (
            ground["home_cost_j"] + (dock["position_m"] - place * place_m) * ground["home_j_per_m"]
        )
        back_m = np.where(away_m <= 0.0, np.abs(away_m), back_m)
        back_j = np.where(away_m <= 0.0, home_cost_j - cost_j, back_j)
        out_m = np.where(away_m >= 0.0, np.minimum(out_m, away_m), out_m)
    columns = (
        out_m * shared["per_reach_m"],
        back_m * shared["per_reach_m"],
        np.maximum(back_j, 0.0) * shared["per_usable_j"],
        records["supplied_j"] * shared["per_usable_j"],
        records["charged"],
    )
    for column, (values, _) in enumerate(zip(columns, DOCK_FEATURES, strict=True)):
        features[:, column] = np.minimum(values, LIMIT)


def text_of(docks: Docks | str) -> str:
    """Docks as `docks_of` reads them.

    >>> text_of(((0.0, 60.0), (120.0, 45.5)))
    '0:60,120:45.5'
    """
    return ",".join(
        f"{position_m:.12g}:{charger_w:.12g}" for position_m, charger_w in checked(docks)
    )
