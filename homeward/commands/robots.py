"""List the shipped robots, or print the file of one.

`homeward robots` lists key figures of all presets. `homeward robots husky > mine.toml` prints a
robot file with the source of every number. Change what differs, and give its path wherever a robot
is expected.

`homeward robots --from-urdf robot.urdf > mine.toml` begins a robot file with what a URDF says
(mass, track, wheels), and names what is left to be filled in.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import tyro
from rich import box
from rich.table import Table
from rich.text import Text

from homeward import Robot, RobotError, cli, load_robot, quantities
from homeward.physics import ancillary_power, d_max, optimal_speed
from homeward.physics.robot import preset_names
from homeward.urdf import left_to_fill_in, read_urdf, robot_file


@dataclass(frozen=True)
class Args:
    """Robot."""

    robot: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[ROBOT]")] = None
    """Preset name or path of a robot file to print; by default a table of all presets is
    printed."""

    from_urdf: Path | None = None
    """URDF to begin a robot file from, which is printed; xacro is to be expanded first."""


def main(args: Args) -> None:
    """Print the table, or one file.

    Raises:
        RobotError: The robot does not exist, or its file is invalid.
    """
    if args.from_urdf is not None:
        if args.robot is not None:
            raise RobotError(f"give {args.robot!r} or --from-urdf, not both")
        described = read_urdf(args.from_urdf)
        for text in [*described.said, *left_to_fill_in(described)]:
            cli.remark(str(args.from_urdf), text)
        print(robot_file(described), end="")
        return
    if args.robot is not None:
        load_robot(args.robot)  # checks the file
        print(_text_of(args.robot), end="")
        return
    table = Table(
        box=box.SIMPLE_HEAD,
        caption="range: on the flat at the optimal speed, nothing sensed",
        padding=(0, 2, 0, 0),
    )
    table.add_column("robot", no_wrap=True)
    for heading in (
        "mass\nkg",
        "battery\nkJ",
        "speed\nm/s",
        "drive\n%",
        "idle\nW",
        "range\nkm",
        "lasts\nh",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for name in preset_names():
        table.add_row(name, *_figures(load_robot(name)))
    console = cli.Terminal()
    console.show(table, ("idle\nW", "drive\n%", "lasts\nh", "battery\nkJ", "speed\nm/s"))
    for name in preset_names():
        console.print(Text.assemble((name, "bold"), f": {load_robot(name).description}"))


def _text_of(robot: str) -> str:
    """Text of a robot's file, by preset name or path."""
    if robot in preset_names():
        return (files("homeward") / "robots" / f"{robot}.toml").read_text(encoding="utf-8")
    return Path(robot).read_text(encoding="utf-8")


def _figures(robot: Robot) -> tuple[str, ...]:
    speed_mps = float(optimal_speed(robot))
    range_m = float(d_max(robot))
    return (
        f"{robot.mass_kg:.3g}",
        quantities.count(robot.usable_energy_j / 1000.0),
        f"{robot.max_speed_mps:.3g}",
        f"{100.0 * robot.traction_efficiency:.1f}",
        f"{float(ancillary_power(robot, 0.0)):.3g}",
        f"{range_m / 1000.0:.2f}",
        f"{range_m / speed_mps / 3600.0:.1f}",
    )


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    return cli.run(main, Args, __doc__, (RobotError,))
