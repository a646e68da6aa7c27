"""`homeward range ROBOT --route ROUTE`: energy and range with intervals, and the probability of
getting home."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich import box
from rich.padding import Padding
from rich.table import Table

from homeward import quantities
from homeward.cli import Terminal
from homeward.companion import Advice, Companion, HomeOption, UncertainValue
from homeward.companion.advice import HOME
from homeward.companion.home_estimator import best_first
from homeward.companion.readings import Position
from homeward.companion.way import RouteLike
from homeward.estimation import WAY_DTYPE
from homeward.physics import Robot

Array = NDArray[np.float64]

_POINTS = 60
"""Points of the plot on the way there and back. Chosen: the line looks smooth."""
# of a point of the plot, by which the point of no return is found; chosen: metres on any route
_HALVINGS = 10
_QUANTILES = (0.05, 0.5, 0.95)  # median and the 90 % interval that the companion shows


@dataclass(frozen=True)
class RouteForecast:
    """Prediction for a route before it is driven; arrays of shape (points,).

    Attributes:
        advice: The companion's advice at home, with a full battery.
        driven_m: Distance driven, there and back, m.
        left_j: Quantiles of the energy left, 5, 50 and 95 %, J, shape (points, 3).
        there_j: Energy of the way to the end, J.
        both_j: Energy of the way there and back, J.
        range_m: Quantiles of the distance driven there and back, as of `left_j`, m; infinite if the
            energy is enough.
        turn_m: Point of no return: farthest position on the route from which home or a dock is
            reachable at the accepted risk, m.
        homes: With docks: home and the docks as of the end of the route, the advised one first; the
            margin is what is left there of a full battery.
    """

    advice: Advice
    driven_m: Array
    left_j: Array
    there_j: UncertainValue
    both_j: UncertainValue
    range_m: tuple[float, ...]
    turn_m: float
    homes: tuple[HomeOption, ...] = ()


def forecast_along(
    robot: Robot,
    route: RouteLike,
    speed_mps: float | None,
    risk: float,
    docks: Mapping[str, Position] | None = None,
) -> RouteForecast:
    """Predict the energy of a route at a speed, m/s, or that with the longest range.

    Args:
        robot: The robot.
        route: The route.
        speed_mps: Speed, m/s; None: that with the longest range.
        risk: Accepted probability of not getting home.
        docks: Other homes and docks by name: metres along the route, or `(east, north)` in metres
            from its start.

    Raises:
        CompanionError: An argument is invalid.
    """
    companion = Companion(
        robot,
        home=(0.0, 0.0) if docks else None,
        route=route,
        cruise_mps=speed_mps,
        risk=risk,
        soc=1.0,
        docks=docks,
    )
    advice = companion.update(0.0, position=0.0)
    out = _ways(route, companion.vehicle.cruise_mps)
    back = out[::-1].copy()
    for name in ("sine", "east", "north"):
        back[name] *= -1.0
    there_and_back = np.concatenate((out, back))
    total_m = float(there_and_back["way_m"].sum())
    driven_m = np.linspace(0.0, total_m, _POINTS + 1)
    ends = np.cumsum(there_and_back["way_m"])
    left_j = np.zeros((len(driven_m), len(_QUANTILES)))
    for point, way_m in enumerate(driven_m):
        energy_left = companion.after(_beginning(there_and_back, ends, float(way_m)))
        left_j[point] = [energy_left.quantile(share) for share in _QUANTILES]
    range_m = tuple(_empty_m(driven_m, quantile_j) for quantile_j in left_j.T)
    standing_j = companion.vehicle.idle_w / companion.vehicle.cruise_mps * 0.5 * total_m
    there_j = companion.ahead(out, standing_j)
    both_j = companion.ahead(there_and_back, 2.0 * standing_j)
    length_m = 0.5 * total_m
    turn_m = min(advice.turn_in_m, length_m)
    if not docks:
        return RouteForecast(advice, driven_m, left_j, there_j, both_j, range_m, turn_m)
    homes = _from_end(companion, out, {HOME: 0.0, **docks})
    turn_m = max(turn_m, _farthest_m(companion, out, docks, turn_m))
    return RouteForecast(advice, driven_m, left_j, there_j, both_j, range_m, turn_m, homes)


def _from_end(
    companion: Companion, out: NDArray[np.void], places: Mapping[str, Position]
) -> tuple[HomeOption, ...]:
    """Homes and docks as of the end of the route, the best first."""
    end_m = float(out["way_m"].sum())
    ways = {name: companion.way_to(place, end_m) for name, place in places.items()}
    reached = {name: companion.arrives(np.concatenate((out, way))) for name, way in ways.items()}
    options = []
    for name in best_first(reached):
        way_m = float(ways[name]["way_m"].sum())
        standing_j = companion.vehicle.idle_w / companion.vehicle.cruise_mps * way_m
        energy_j = companion.ahead(ways[name], standing_j)
        options.append(reached[name].option(name, way_m)._replace(energy_j=energy_j))
    return tuple(options)


def _farthest_m(
    companion: Companion, out: NDArray[np.void], docks: Mapping[str, Position], safe_m: float
) -> float:
    """Farthest position on the route up to which some dock is reachable, m, from a position known
    as safe."""
    ends = np.cumsum(out["way_m"])

    def is_safe(position_m: float) -> bool:
        driven = _beginning(out, ends, position_m)
        ways = (
            np.concatenate((driven, companion.way_to(place, position_m)))
            for place in docks.values()
        )
        return any(companion.arrives(way).reachable for way in ways)

    for over_m in np.linspace(safe_m, float(ends[-1]), _POINTS + 1)[1:]:
        if not is_safe(over_m):
            break
        safe_m = float(over_m)
    else:
        return safe_m
    for _ in range(_HALVINGS):
        middle_m = 0.5 * (safe_m + over_m)
        if is_safe(middle_m):
            safe_m = middle_m
        else:
            over_m = middle_m
    return float(safe_m)


def _ways(route: RouteLike, speed_mps: float) -> NDArray[np.void]:
    ways = np.zeros(len(route.grade_rad), WAY_DTYPE)
    ways["way_m"] = route.place_m
    ways["sine"] = np.sin(route.grade_rad)
    ways["speed_mps"] = speed_mps
    ways["east"] = np.cos(route.heading_rad)
    ways["north"] = np.sin(route.heading_rad)
    return ways


def _beginning(ways: NDArray[np.void], ends: Array, way_m: float) -> NDArray[np.void]:
    """The first metres of a way."""
    count = int(np.searchsorted(ends, way_m - 1e-6)) + 1
    part = ways[:count].copy()
    part["way_m"][-1] -= ends[count - 1] - way_m
    return np.asarray(part[part["way_m"] > 0.0])


def _empty_m(driven_m: Array, left_j: Array) -> float:
    """Distance at which the energy is used up, m; infinite if it is not."""
    below = np.flatnonzero(left_j < 0.0)
    if not len(below):
        return float("inf")
    point = int(below[0])
    return float(
        np.interp(0.0, [left_j[point], left_j[point - 1]], [driven_m[point], driven_m[point - 1]])
    )


def show(
    console: Terminal, robot: Robot, route_name: str, length_m: float, forecast: RouteForecast
) -> None:
    """Print the prediction."""
    advice = forecast.advice
    assert advice.chance_there_and_back is not None
    console.print(
        f"{robot.name} on {quantities.distance(length_m)} out and back: probability of getting there and back "
        f"{advice.chance_there_and_back:.1%}",
        style="bold",
    )
    console.print(f"Route: {route_name}")
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("", "expected", "90 % interval"):
        table.add_column(heading, justify="right" if heading else "left")
    rows = {
        "in the battery": advice.energy_left_j,
        "there": forecast.there_j,
        "there and back": forecast.both_j,
    }
    for name, spread in rows.items():
        table.add_row(name, quantities.energy(spread.mean), _interval(spread))
    low, median, high = (_far(range_m) for range_m in forecast.range_m)
    table.add_row("range on this way", median, low if low == high else f"{low} to {high}")
    console.show(table)
    if forecast.homes:
        console.show(_homes_table(forecast.homes))
        advised = forecast.homes[0]
        if advised.reachable:
            console.print(f"Advised at its end: {advised.name}.")
        else:
            console.print("None is reachable from its end at that risk.")
    turn = quantities.distance(forecast.turn_m)
    end = ", which is its end" if math.isclose(forecast.turn_m, length_m) else ""
    console.print(f"Point of no return at a risk of {advice.risk:g}: {turn} from home{end}.")
    for text in advice.rests_on:
        if not text.startswith(("energy by", "neither", "no power", "no position", "no heading")):
            console.print(Padding(text, (0, 0, 0, 2)), style="dim")


def _homes_table(homes: tuple[HomeOption, ...]) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    for heading in (
        "from the end to",
        "way",
        "expected",
        "90 % interval",
        "probability\nof getting there",
    ):
        table.add_column(heading, justify="left" if heading == "from the end to" else "right")
    for option in homes:
        way = quantities.distance(option.way_m)
        mean = quantities.energy(option.energy_j.mean)
        table.add_row(option.name, way, mean, _interval(option.energy_j), f"{option.chance:.2%}")
    return table


def _interval(energy: UncertainValue) -> str:
    return f"{quantities.energy(max(energy.low, 0.0))} to {quantities.energy(energy.high)}"


def _far(metres: float) -> str:
    return quantities.distance(metres) if np.isfinite(metres) else "there and back"


def picture(robot: Robot, length_m: float, forecast: RouteForecast, suffix: str) -> bytes:
    """Energy left over the way there and back as a fan, with the point of no return.

    Args:
        robot: The robot.
        length_m: Length of the route, m.
        forecast: The prediction.
        suffix: `.png`, `.svg` or `.pdf`.
    """
    figure = Figure(figsize=(7.5, 4.2), layout="constrained")
    axis = figure.subplots()
    driven_km = forecast.driven_m / 1000.0
    low_kj, median_kj, high_kj = np.maximum(forecast.left_j / 1000.0, 0.0).T
    axis.fill_between(driven_km, low_kj, high_kj, color="#56b4e9", alpha=0.4,
                      linewidth=0.0, label="energy left, 5 to 95 %")  # fmt: skip
    axis.plot(driven_km, median_kj, color="#0072b2", label="median")
    axis.axvline(
        length_m / 1000.0, color="black", linewidth=0.8, linestyle=":", label="end of the route"
    )
    turn_m = forecast.turn_m
    level = float(np.interp(turn_m, forecast.driven_m, forecast.left_j[:, 1])) / 1000.0
    axis.plot(
        [turn_m / 1000.0],
        [level],
        "o",
        color="#d55e00",
        label=f"point of no return, risk {forecast.advice.risk:g}",
    )
    axis.set_xlabel("driven, there and back, km")
    axis.set_ylabel("energy left, kJ")
    axis.set_ylim(bottom=0.0)
    axis.legend(frameon=False, fontsize=9)
    axis.spines[["top", "right"]].set_visible(False)
    axis.grid(alpha=0.25, linewidth=0.6)
    figure.suptitle(
        f"{robot.name}: probability of getting there and back {forecast.advice.chance_there_and_back:.1%}",
        fontsize=11,
    )
    buffer = io.BytesIO()
    figure.savefig(buffer, format=suffix.removeprefix("."), dpi=150)
    return buffer.getvalue()
