"""Range of a robot on one battery charge, and the energy by cause.

`homeward range rusti --grade 5.71 --duty 0.367` prints the estimate of Tiwari, Xiao and Chong (IROS
2018, Eq. 8) for their robot on their incline, moving 36.7 % of the time, with each part's share.
ROBOT is a preset (`homeward robots`) or your own TOML file. If it has effects that the paper omits,
the compiled model drives until the battery is empty instead. `--plot range.png` shows range and
shares over the speed.

With `--route track.gpx` it prints the energy that the route consumes there and back with a 90 %
interval, and the probability of getting there and back; `--plot fan.png` shows the energy left on
the way, and the point of no return. With `--docks bay=1200 hut=40,-12` it compares the ways from
the end of the route to other homes and docks, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich import box
from rich.table import Table
from rich.text import Text

from homeward import RobotError, cli, installed, load_robot, quantities
from homeward.commands.range_parts import Mission
from homeward.companion import thresholds
from homeward.companion.checks import docks_of
from homeward.companion.readings import CompanionError
from homeward.envs.routes import RouteError
from homeward.files import write_whole
from homeward.physics import d_max, optimal_speed

_PLACES = 160.0
"""Places per d_max, over which slopes of a route are averaged. Chosen: hills of 1 % of a charge are
resolved."""


@dataclass(frozen=True)
class Args:
    """Robot and drive."""

    robot: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ROBOT")]
    """Preset name, or path of a robot file."""
    grade: float = 0.0
    """Slope, degrees, uphill above 0."""
    duty: float = 1.0
    """Duty cycle: share of the time spent moving, above 0 and at most 1. Standing consumes power
    too."""
    speed_mps: float | None = None
    """Speed while moving, m/s; by default the one with the longest range."""
    sensing_hz: float = 0.0
    """Sensing rate, Hz."""
    route: str | None = None
    """Track (.gpx, .fit, .csv) or profile to drive there and back instead, with the uncertainty of
    robot and wind."""
    docks: tuple[str, ...] = ()
    """With --route: other homes and charging docks, NAME=METRES from its start along the route, or
    NAME=EAST,NORTH in metres from its start. The one with the best margin at the end of the route
    is advised."""
    risk: float = thresholds.RISK
    """Accepted risk of not getting home, for the point of no return with --route."""
    plot: Path | None = None
    """Plot to write (.png, .svg or .pdf): range, and energy per metre by part, over the speed; with
    --route the energy left on the way there and back."""


class RangeError(ValueError):
    """An invalid argument."""


def main(args: Args) -> None:
    """Print the estimate, and plot it if requested.

    Raises:
        RobotError: The robot does not exist, or its file is invalid.
        RangeError, RouteError, CompanionError: Another argument is invalid.
        OSError: The picture cannot be written.
    """
    mission = _mission(args)
    if args.route is not None:
        _on_route(args, args.route, mission)
        return
    if args.docks:
        raise RangeError("--docks is for --route: the way to a dock leads along the route")
    robot = mission.robot
    speed_mps = float(optimal_speed(robot, mission.grade_rad, mission.duty, mission.sensing_hz))
    speed_note = "the speed with the longest range"
    if args.speed_mps is not None:
        speed_note = f"{speed_mps:.2f} m/s would go furthest"
        speed_mps = args.speed_mps
    range_m = mission.range_m(speed_mps)
    far = "any distance: the slope drives it without power"
    lasts = "ever"
    if math.isfinite(range_m):
        far = quantities.distance(range_m)
        lasts = quantities.duration(range_m / (speed_mps * mission.duty))
    slope = _slope(args.grade)
    console = cli.Terminal()
    console.print(
        Text.assemble(
            (f"{cli.printable(robot.name)}: {far}", "bold"), f" on one charge, in {lasts}"
        ),
        f"at {speed_mps:.2f} m/s ({speed_note}), {slope}, moving {mission.duty:.1%} of the time, "
        f"sensing at {mission.sensing_hz:g} Hz",
        sep="\n",
    )
    console.show(_table(mission, speed_mps), ("of a charge", "mean power"))
    method = "Eq. 8"
    accuracy = " The paper found such estimates 66 to 91 % accurate."
    beyond_paper = list(robot.active_effects)
    if robot.has_cutoff:
        beyond_paper.append(f"a cut-off at {robot.cutoff_v:g} V")
    if beyond_paper:
        method = f"the model with {', '.join(beyond_paper)}"
        accuracy = ""
    console.print(
        f"By {method}: {quantities.energy(robot.usable_energy_j)} usable, "
        f"drive efficiency {robot.traction_efficiency:.2%}.{accuracy}",
        highlight=False,
    )
    if args.plot is not None:
        installed.needed("plot", "matplotlib")
        from homeward.commands.range_plot import range_picture

        write_whole(args.plot, range_picture(mission, speed_mps, args.plot.suffix))
        console.print(f"Written to {args.plot}")


def _slope(grade_deg: float) -> str:
    if grade_deg == 0.0:
        return "on the flat"
    direction = "uphill" if grade_deg > 0.0 else "downhill"
    return f"{abs(grade_deg):g}° {direction}"


def _on_route(args: Args, name: str, mission: Mission) -> None:
    from homeward.envs.routes import load_route
    from homeward.watch import route_forecast

    if args.grade != 0.0 or args.duty != 1.0 or args.sensing_hz != 0.0:
        raise RangeError(
            "--grade, --duty and --sensing-hz are not allowed with --route: slopes are those of the route"
        )
    route = load_route(name, float(d_max(mission.robot)) / _PLACES)
    forecast = route_forecast.forecast_along(
        mission.robot, route, args.speed_mps, args.risk, docks_of(args.docks)
    )
    console = cli.Terminal()
    route_forecast.show(console, mission.robot, name, route.length_m, forecast)
    if args.plot is not None:
        write_whole(
            args.plot,
            route_forecast.picture(mission.robot, route.length_m, forecast, args.plot.suffix),
        )
        console.print(f"Written to {args.plot}")


def _mission(args: Args) -> Mission:
    robot = load_robot(args.robot)
    for name, value, allowed, low, high in (
        ("--grade", args.grade, "degrees between -45 and 45", -45.0, 45.0),
        ("--duty", args.duty, "a share of the time, 0.001 to 1", 1e-3, 1.0),
        (
            "--sensing-hz",
            args.sensing_hz,
            f"0 to {robot.max_sensing_hz:g} Hz",
            0.0,
            robot.max_sensing_hz,
        ),
        ("--speed-mps", args.speed_mps, "0.001 to 100 m/s", 1e-3, 100.0),
    ):
        if value is not None and not low <= value <= high:
            raise RangeError(f"{name} {value:g} is not allowed; give {allowed}")
    if args.plot is not None and args.plot.suffix not in (".png", ".svg", ".pdf"):
        raise RangeError(f"--plot {args.plot}: give a file that ends in .png, .svg or .pdf")
    return Mission(robot, math.radians(args.grade), args.duty, args.sensing_hz)


def _table(mission: Mission, speed_mps: float) -> Table:
    """Energy by part: mean power, energy of a metre and of a charge, and share of the total; and
    what stays of the charge below a cut-off."""
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("part")
    for heading in ("mean power", "per metre", "of a charge", "share"):
        table.add_column(heading, justify="right")
    parts = mission.parts_j_per_m(speed_mps)
    total_j_per_m = sum(parts.values())
    range_m = mission.range_m(speed_mps)

    def add_row(name: str, j_per_m: float) -> None:
        mean_power = quantities.power(j_per_m * speed_mps * mission.duty)
        of_a_charge = ""
        if math.isfinite(range_m):
            of_a_charge = quantities.energy(j_per_m * range_m)
        share = ""
        if total_j_per_m:
            share = f"{j_per_m / total_j_per_m:.1%}"
        table.add_row(name, mean_power, f"{j_per_m:.3g} J", of_a_charge, share)

    for name, j_per_m in parts.items():
        add_row(name, j_per_m)
    table.add_section()
    add_row("total", total_j_per_m)
    if mission.robot.has_cutoff:
        kept_j = mission.below_cutoff_j(speed_mps)
        table.add_row("below_cutoff", "", "", quantities.energy(kept_j), "")
    return table


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    return cli.run(main, Args, __doc__, (RobotError, RangeError, CompanionError, RouteError))
