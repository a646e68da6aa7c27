"""List routes, or measure and draw one.

`homeward routes` lists the shipped routes. `homeward routes track.gpx --robot husky` reads a route
of your own (a GPX or FIT track, or a CSV file, as for `--route` of the environments), and prints
its length, its slopes and the share of that robot's battery that it consumes.
`homeward routes generated` prints statistics of the routes that the environments draw.
`--plot route.png` draws the profile.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from numpy.typing import NDArray
from rich import box
from rich.table import Table

from homeward import Robot, RobotError, cli, installed, load_robot, quantities
from homeward.envs.options import OptionError
from homeward.envs.routes import load_route, route_names
from homeward.envs.routes.route import GENERATED, HIDDEN_WIND, Route, RouteError
from homeward.envs.state import MAX_PLACES
from homeward.files import write_whole
from homeward.physics import d_max, optimal_speed

# requested place length; chosen: so short that each route is cut as finely as possible
_FINEST_M = 0.01


@dataclass(frozen=True)
class Args:
    """Route."""

    route: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[ROUTE]")] = None
    """Name of a shipped route, or path of a .gpx, .fit or .csv file; by default a table of the
    shipped ones is printed."""
    robot: str = "rusti_computer"
    """Robot that drives it: preset name or TOML file. The length of generated routes depends on
    it."""
    draws: int = 200
    """Number of generated routes to measure."""
    seed: int = 0
    """Seed of the first of them."""
    plot: Path | None = None
    """Plot of the profile to write (.png, .svg or .pdf)."""


def main(args: Args) -> None:
    """Print the table, or measure and draw one route.

    Raises:
        RouteError, RobotError, OptionError: The route or robot does not exist, or an argument is
            invalid.
        OSError: The picture cannot be written.
    """
    console = cli.Terminal()
    if args.route is None:
        console.print(_table())
        return
    if args.plot is not None and args.plot.suffix not in (".png", ".svg", ".pdf"):
        raise OptionError(f"--plot {args.plot}: give a file that ends in .png, .svg or .pdf")
    if args.draws < 1 or args.seed < 0:
        raise OptionError(
            f"--draws {args.draws} --seed {args.seed}: give at least 1 draw and a seed of 0 or more"
        )
    robot = load_robot(args.robot)
    if args.route in (GENERATED, HIDDEN_WIND):
        routes = generated_routes(robot, args.route, args.draws, args.seed)
        title = f"{args.route} for {robot.name}, {args.draws} draws: median (5 to 95 %)"
    else:
        routes = [load_route(args.route, _FINEST_M)]
        title = f"{args.route}, cut into {len(routes[0].grade_rad)} places"
    table = Table(title=title, box=box.SIMPLE_HEAD, show_header=False, title_justify="left")
    for name, (values, unit) in figures(routes, robot).items():
        table.add_row(name, _spread(values, unit))
    console.print(table)
    if args.plot is not None:
        installed.needed("plot", "matplotlib")
        from homeward.commands.route_plot import routes_picture

        write_whole(args.plot, routes_picture(routes, args.route, args.plot.suffix))
        console.print(f"Written to {args.plot}")


def figures(routes: list[Route], robot: Robot) -> dict[str, tuple[NDArray[np.float64], str]]:
    """Statistics of routes, one value each, with its unit.

    Args:
        routes: The routes.
        robot: Its own model gives the energy.
    """
    speed_mps = float(optimal_speed(robot))
    robot = robot.without_cutoff()  # so that a range tells what a metre consumes
    rows = []
    for route in routes:
        rise = route.place_m * np.sin(route.grade_rad)
        charge_out = float((route.place_m / d_max(robot, speed_mps, route.grade_rad)).sum())
        charge_back = float((route.place_m / d_max(robot, speed_mps, -route.grade_rad)).sum())
        grade_deg = np.degrees(route.grade_rad)
        rows.append(
            {
                ("length", "m"): route.length_m,
                ("climb on the way out", "m"): rise[rise > 0.0].sum(),
                ("descent on the way out", "m"): np.abs(rise[rise < 0.0]).sum(),
                ("steepest climb", "°"): max(grade_deg.max(), 0.0),
                ("steepest descent", "°"): max(0.0, -grade_deg.min()),
                ("mean interest", ""): route.interest.mean(),
                ("air temperature", "°C"): route.temperature_c,
                ("wind", "m/s"): route.wind_mps,
                (f"energy there, {robot.name} at {speed_mps:.2f} m/s", "% of a charge"): 100.0
                * charge_out,
                ("energy back, without wind", "% of a charge"): 100.0 * charge_back,
            }
        )
    return {name: (np.array([row[name, unit] for row in rows]), unit) for name, unit in rows[0]}


def generated_routes(robot: Robot, kind: str, count: int, seed: int) -> list[Route]:
    """Routes as the environments draw them.

    Args:
        robot: It determines their length.
        kind: `generated` or `hidden_wind`.
        count: Number of routes.
        seed: Seed of the first; the others follow.
    """
    from homeward.envs.vector import HomewardVectorEnv  # only now: it compiles

    env = HomewardVectorEnv(
        count, mission="OutAndBack", robot=robot, route=kind, difficulty="uncertain"
    )
    env.reset(seed=seed)
    shared = env.batch.known.shared[0]
    drawn = env.batch.routes["places"][:, : int(shared["places"])]
    return [
        Route(
            place_m=float(shared["place_m"]),
            grade_rad=np.arcsin(places["sin_grade"].astype(np.float64)),
            roughness=places["roughness"],
            interest=places["interest"],
            heading_rad=np.arctan2(places["north"], places["east"]),
            temperature_c=mission["temperature_c"],
            wind_mps=mission["wind_mps"],
            wind_from_rad=mission["wind_from_rad"],
        )
        for places, mission in zip(drawn, env.batch.records, strict=True)
    ]


def _table() -> Table:
    table = Table(box=box.SIMPLE_HEAD, caption=f"any route is cut into at most {MAX_PLACES} places")
    for heading in ("route", "length", "grade", "what it is"):
        table.add_column(heading, no_wrap=heading == "route")
    table.add_row(
        GENERATED,
        "as suits\nthe robot",
        "varied",
        "hills, rough patches, hot spots and weather, anew each time",
    )
    table.add_row(
        HIDDEN_WIND,
        "",
        "",
        "the same, with a wind that helps on the way out and hurts on the way home",
    )
    for name in route_names():
        if name not in (GENERATED, HIDDEN_WIND):
            route = load_route(name, _FINEST_M)
            low = float(np.degrees(route.grade_rad.min()))
            high = float(np.degrees(route.grade_rad.max()))
            grade = f"{low:.2f} to {high:.2f}°"
            if high - low < 0.005:  # which is less than what is printed
                grade = f"{low:.2f}°"
            table.add_row(name, f"{route.length_m:.2f} m", grade, _first_comment(name))
    return table


def _first_comment(name: str) -> str:
    text = (files("homeward") / "routes" / f"{name}.csv").read_text(encoding="utf-8")
    return next((line.strip("# ") for line in text.splitlines() if line.startswith("#")), "")


def _spread(values: NDArray[np.float64], unit: str) -> str:
    quantiles = np.quantile(values, (0.05, 0.5, 0.95))
    low, median, high = [quantities.count(float(value)) for value in quantiles]
    if low == high:
        return f"{median} {unit}"
    return f"{median} ({low} to {high}) {unit}"


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    return cli.run(main, Args, __doc__, (RouteError, RobotError, OptionError))
