"""Replay recordings of a robot as if live, and compare the companion's predictions with measurements.

`homeward watch RUN... --robot corrected.toml` replays each recording to a companion (docs/on_the_robot.md), which
predicts at each moment what the rest of the drive will consume. It prints, by the way left, how often the 90 % interval
contained the measured energy, and the error of the mean. DIR/watch.html shows this, DIR/watch.csv contains every
moment. RUN is a table or a ROS bag (read without ROS), with battery power, or voltage and current. From motor currents
alone the charge is predicted, with the corrected.toml of such recordings. A terminal shows the drive meanwhile.

`homeward watch --ros2 --robot corrected.toml` joins the ROS 2 network of a robot, without ROS, and advises live. It
subscribes to battery state, odometry and IMU, by the mappings for bags, and publishes whether the robot can reach home,
whether it must turn now, and the energy of the way home.
"""

from __future__ import annotations

import contextlib
import os
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pandas as pd
import tyro
from rich import box
from rich.padding import Padding
from rich.table import Table

from homeward import cli, installed, quantities
from homeward.companion import CompanionError, rules
from homeward.files import check_writable, no_formula, write_files
from homeward.logs import RecordingError, read_recording
from homeward.logs.plausible import within_top_speed
from homeward.physics import RobotError, load_robot
from homeward.watch.coverage import Row, rows_of
from homeward.watch.live import LiveView
from homeward.watch.page import verdict, watch_html
from homeward.watch.predictions import Watched
from homeward.watch.replay import run_all


@dataclass(frozen=True)
class Args:
    """Recordings or network, robot and output."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Recordings (.csv, .csv.gz, .tsv, .txt, .parquet, .bag, .mcap, .db3, .ulg, .bin or the folder of a ROS 2 bag), one
    run each; none with --ros2."""
    robot: str
    """Robot: preset name or TOML file, such as the corrected.toml of a diagnosis."""
    columns: str | None = None
    """Mapping of columns or, for bags, of topics, for recordings with other names: shipped name or TOML file."""
    soc: float | None = None
    """State of charge at the start, 0 to 1; by default as recorded, or full."""
    cutoff_v: float | None = None
    """Voltage at which the battery is cut off, V."""
    risk: float = rules.RISK
    """Accepted risk of not getting home, for the point of no return."""
    speed: float = 0.0
    """Speed of the view in a terminal as a multiple of real time; 0: as fast as possible."""
    quiet: bool = False
    """Show nothing during the replay."""
    out: Path = Path("runs/watch")
    """Folder for watch.html and watch.csv."""
    ros2: bool = False
    """Join a ROS 2 network instead of replaying; needs the extra ros2."""
    domain: int | None = None
    """With --ros2: number of its domain; by default ROS_DOMAIN_ID, or 0."""
    namespace: str = ""
    """With --ros2: subscribe only to topics below this, such as /robot1, and publish the advice below it."""
    home: tuple[float, float] | None = None
    """With --ros2: home in the frame of the odometry, m; by default the first position received."""
    state: Path | None = None
    """With --ros2: file of the state: read if it exists, and written every minute and at the end."""


def main(args: Args) -> list[Watched]:
    """Replay, print the table and write the page; or join a network.

    Raises:
        RobotError, RecordingError, CompanionError: The input cannot be used.
        OSError: The output folder cannot be written to.
    """
    if args.ros2:
        return _join(args)
    if args.namespace or any(one is not None for one in (args.domain, args.home, args.state)):
        raise CompanionError("--domain, --namespace, --home and --state are for --ros2")
    if not args.runs:
        raise RecordingError("no recording is given; name at least one file, or --ros2")
    robot = load_robot(args.robot)
    read = [read_recording(path, args.columns) for path in args.runs]
    recordings = [within_top_speed(one, robot.max_speed_mps) for one in read]
    check_writable(args.out)
    notes = [(Path(one.name).name, note) for one in recordings for note in one.notes]
    for said in notes:
        cli.remark(*said)
    console = cli.Terminal()
    keywords = {"soc": args.soc, "risk": args.risk, "cutoff_v": args.cutoff_v}
    with contextlib.ExitStack() as stack:
        show = None
        if console.is_terminal and not args.quiet:
            show = stack.enter_context(LiveView(console, robot.usable_energy_j, args.speed)).show
        runs = run_all(recordings, robot, show, **keywords)
    rows = rows_of(runs)
    console.show(table_of(rows))
    console.print(verdict(rows[-1]))
    for text in runs[0].rests_on:
        console.print(Padding(text, (0, 0, 0, 2)), style="dim")
    texts = {"watch.html": watch_html(runs, robot, notes=notes), "watch.csv": moments_of(runs).to_csv(index=False)}
    page = write_files(args.out, texts)[0]
    console.print(f"Page: {page}", soft_wrap=True)
    return runs


def _join(args: Args) -> list[Watched]:
    """Advise a robot on its network until it is interrupted; nothing to return."""
    if args.runs:
        raise RecordingError("--ros2 accepts no recordings: it subscribes to a robot's topics")
    domain = _domain(args.domain)
    if args.namespace and not args.namespace.startswith("/"):
        raise CompanionError(f"--namespace {args.namespace!r} is not allowed; give one with a leading slash")
    try:
        from homeward.watch.online.session import Session  # only now: it needs further packages
    except ModuleNotFoundError as error:
        raise CompanionError(f"--ros2 needs {error.name}: {installed.advice('ros2', 'cyclonedds rosbags')}") from None
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the state is saved then, too
    Session(
        load_robot(args.robot), domain, args.columns, args.namespace.rstrip("/"), args.home, args.state,
        soc=args.soc, risk=args.risk, cutoff_v=args.cutoff_v,
    ).run(cli.Terminal(), args.quiet)  # fmt: skip
    return []


def _domain(given: int | None) -> int:
    """Number of the domain."""
    text = os.environ.get("ROS_DOMAIN_ID", "") if given is None else str(given)
    if not text:
        return 0
    if not text.isdecimal() or int(text) > 232:
        raise CompanionError(f"ROS domain {text!r} is not allowed; give a number from 0 to 232")
    return int(text)


def table_of(rows: list[Row]) -> Table:
    """Coverage, bias and error by the way left; the last row is of all moments."""
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("way left", "moments", "in the 90 %\ninterval", "bias", "median\nerror", "half\ninterval"):
        table.add_column(heading, justify="left" if heading == "way left" else "right")
    for row in rows:
        if row is rows[-1]:
            table.add_section()
        low, high = (quantities.distance(metres) for metres in row.metres)
        table.add_row(
            "all" if row is rows[-1] else f"{high} to {low}", str(row.moments), f"{row.covered:.0%}",
            f"{row.bias:+.1%}", f"{row.error:.1%}", f"{row.width:.1%}",
        )  # fmt: skip
    return table


def moments_of(runs: list[Watched]) -> pd.DataFrame:
    """Every moment of every run, one row each."""
    names = ("time_s", "left_m", "took_j", "mean_j", "low_j", "high_j")
    tables = [
        pd.DataFrame({"run": no_formula(one.name), **{name: getattr(one, name) for name in names}}) for one in runs
    ]
    table = pd.concat(tables)
    of_charge = {name: name.replace("_j", "_as") for name in names if runs[0].unit == "A s"}
    return table.rename(columns=of_charge)


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    return cli.run(main, Args, __doc__, (RobotError, RecordingError, CompanionError))
