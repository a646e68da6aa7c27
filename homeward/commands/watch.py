"""Replay recordings of a robot as if live, and compare the companion's predictions with
measurements.

`homeward watch RUN... --robot corrected.toml` replays each recording to a companion
(docs/on_the_robot.md), which predicts at each moment what the rest of the drive will consume. It
prints, by the way left, how often the 90 % interval contained the measured energy, and the error of
the mean. DIR/watch.html shows this, DIR/watch.csv contains every moment. RUN is a table or a ROS
bag (read without ROS), with battery power, or voltage and current. From motor currents alone the
charge is predicted, with the corrected.toml of such recordings. A terminal shows the drive
meanwhile.

`homeward watch --ros2 --robot corrected.toml` joins the ROS 2 network of a robot, without ROS, and
advises live. It subscribes to battery state, odometry and IMU, by the mappings for bags, and
publishes whether the robot can reach home, whether it must turn now, and the energy of the way
home.

`homeward watch --mavlink udpin:127.0.0.1:14550 --robot corrected.toml` does the same for a vehicle
with an autopilot (ArduPilot, PX4): it sends texts (STATUSTEXT) and numbers (NAMED_VALUE_FLOAT).

With `--foxglove` the advice on a live robot is shown in Foxglove too, and `--mcap FILE` writes the
same to a file, of a replay as well.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import pandas as pd
import tyro
from rich import box
from rich.padding import Padding
from rich.table import Table

from homeward import cli, installed, quantities
from homeward.companion import Advice, CompanionError, thresholds
from homeward.companion.checks import docks_of
from homeward.files import check_writable, no_formula, write_files
from homeward.logs import RecordingError, read_recording
from homeward.logs.plausible import within_top_speed
from homeward.physics import Robot, RobotError, load_robot
from homeward.watch.live import LiveView

# the replay needs the diagnosis, with its libraries; a robot as it drives does not
if TYPE_CHECKING:
    from homeward.watch.coverage import Row
    from homeward.watch.foxglove.stream import Stream
    from homeward.watch.online.link import Output
    from homeward.watch.predictions import Watched


@dataclass(frozen=True)
class Args:
    """Recordings or network, robot and output."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Recordings (.csv, .csv.gz, .tsv, .txt, .parquet, .bag, .mcap, .db3, .ulg, .bin or the folder
    of a ROS 2 bag), one run each; none for a live robot (--ros2, --mavlink, --stdin)."""
    robot: str
    """Robot: preset name or TOML file, such as the corrected.toml of a diagnosis."""
    columns: str | None = None
    """Mapping of columns or, for bags, of topics, for recordings with other names: shipped name or
    TOML file."""
    soc: float | None = None
    """State of charge at the start, 0 to 1; by default as recorded, or full."""
    cutoff_v: float | None = None
    """Voltage at which the battery is cut off, V; by default that of the robot's file, or what is
    usual for its cells."""
    capacity_j: float | None = None
    """Energy that this battery gave when it was last discharged from full to the cut-off, J; by
    default unknown, as of ageing batteries."""
    cruise_mps: float | None = None
    """Speed on the way home, m/s; by default that at which its ground was driven on the way out."""
    risk: float = thresholds.RISK
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
    """With --ros2 or --stdin: subscribe only to topics below this, such as /robot1, and publish the
    advice below it."""
    home: tuple[float, float] | None = None
    """With --ros2 or --stdin: home in the frame of the odometry, m; by default the first position
    received."""
    docks: tuple[str, ...] = ()
    """With --ros2 or --stdin: other homes and charging docks, NAME=EAST,NORTH in the frame of the
    odometry, m. The one with the best margin is advised."""
    mavlink: str | None = None
    """Advise a vehicle on MAVLink instead of replaying: udpin:HOST:PORT, udpout:HOST:PORT,
    tcp:HOST:PORT or a serial port; needs the extra logs."""
    stdin: bool = False
    """Read a robot's messages as JSON lines, and write the advice so, as the node of ROS 2 in ros2/
    does; needs the extra logs."""
    foxglove: bool = False
    """Of a live robot: stream the advice to Foxglove too; needs the extra foxglove."""
    foxglove_address: str = "127.0.0.1:8765"
    """With --foxglove: HOST:PORT of its server. By default only this computer reaches it; there is
    no password."""
    mcap: Path | None = None
    """Write the advice to this MCAP file, for Foxglove; needs the extra foxglove."""
    state: Path | None = None
    """Of a live robot: file of the state: read if it exists, and written every minute and at the
    end."""


def main(args: Args) -> list[Watched]:
    """Replay, print the table and write the page; or join a network.

    Raises:
        RobotError, RecordingError, CompanionError: The input cannot be used.
        OSError: The output folder cannot be written to.
    """
    live = _live_option(args)
    if live is None:
        if not args.runs:
            raise RecordingError(
                "no recording is given; name at least one file, or --ros2, --mavlink or --stdin"
            )
        return _replay(args)
    if args.runs:
        raise RecordingError(f"{live} accepts no recordings: it receives a robot's messages")
    _advise(args)
    return []


def _live_option(args: Args) -> str | None:
    """Name of the option for a live robot, None for a replay.

    Raises:
        CompanionError: There are two, or another option does not go with it.
    """
    ways = {"--ros2": args.ros2, "--mavlink": args.mavlink is not None, "--stdin": args.stdin}
    live = [name for name, is_given in ways.items() if is_given]
    if len(live) > 1:
        raise CompanionError(f"{' and '.join(live)} do not go together; give one of them")
    if not args.ros2 and args.domain is not None:
        raise CompanionError("--domain is for --ros2")
    has_place = bool(args.namespace) or args.home is not None or bool(args.docks)
    if has_place and not (args.ros2 or args.stdin):
        raise CompanionError("--namespace, --home and --docks are for --ros2 and --stdin")
    if not live and args.state is not None:
        raise CompanionError("--state is for a live robot: --ros2, --mavlink or --stdin")
    if not live and args.foxglove:
        raise CompanionError(
            "--foxglove is for a live robot; --mcap FILE writes the advice of a replay for Foxglove"
        )
    if args.namespace and not args.namespace.startswith("/"):
        raise CompanionError(
            f"--namespace {args.namespace!r} is not allowed; give one with a leading slash"
        )
    if not live:
        return None
    return live[0]


def _advise(args: Args) -> None:
    """Advise a live robot until it is interrupted."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the state is saved then, too
    robot = load_robot(args.robot)
    with _streamed(args, robot) as outputs:
        if args.mavlink is not None:
            _advise_vehicle(args, args.mavlink, robot, outputs)
        elif args.stdin:
            _advise_by_lines(args, robot, outputs)
        else:
            _join(args, robot, outputs)


def _replay(args: Args) -> list[Watched]:
    """Replay, print the table and write the page."""
    installed.needed("diagnose", *installed.DIAGNOSE)
    from homeward.watch.coverage import rows_of
    from homeward.watch.page import verdict, watch_html
    from homeward.watch.replay import run_all
    from homeward.watch.scores import missing

    robot = load_robot(args.robot)
    read = [read_recording(path, args.columns) for path in args.runs]
    recordings = [within_top_speed(recording, robot.max_speed_mps) for recording in read]
    check_writable(args.out)
    notes = [
        (Path(recording.name).name, note) for recording in recordings for note in recording.notes
    ]
    for name, note in notes:
        cli.remark(name, note)
    console = cli.Terminal()
    with _shown(args, robot, console) as show:
        runs = run_all(recordings, robot, show, **_of_companion(args))
    if runs[0].unit != "J":
        _say_unused(args)
    rows = rows_of(runs)
    of_all = rows[-1]
    expendable: tuple[str, ...] = ()
    if of_all.crps is not None:
        expendable = ("interval\nscore",)
    console.show(table_of(rows), expendable)
    console.print(verdict(of_all))
    lacking = missing()
    if lacking is not None:
        console.print(Padding(lacking, (0, 0, 0, 2)), style="dim", soft_wrap=True)
    for text in runs[0].rests_on:
        console.print(Padding(text, (0, 0, 0, 2)), style="dim")
    texts = {
        "watch.html": watch_html(runs, robot, notes=notes),
        "watch.csv": moments_of(runs).to_csv(index=False),
    }
    page = write_files(args.out, texts)[0]
    console.print(f"Page: {page}", soft_wrap=True)
    return runs


Show = Callable[[str, Advice, float, float], None]
"""What shows an advice: name of the recording, advice, time since its start, s, and its duration,
s."""


@contextlib.contextmanager
def _shown(args: Args, robot: Robot, console: cli.Terminal) -> Iterator[Show | None]:
    """What shows the advice of a replay: in a terminal and for Foxglove, as asked for; None for
    neither."""
    with contextlib.ExitStack() as stack:
        views: list[Show] = []
        if console.is_terminal and not args.quiet:
            views.append(
                stack.enter_context(LiveView(console, robot.usable_energy_j, args.speed)).show
            )
        for stream in stack.enter_context(_streamed(args, robot)):
            views.append(stream.replay(robot.usable_energy_j))

        def show(name: str, advice: Advice, since_s: float, duration_s: float) -> None:
            for view in views:
                view(name, advice, since_s, duration_s)

        if views:
            yield show
        else:
            yield None


def _say_unused(args: Args) -> None:
    """Say which options motor currents cannot use."""
    of_battery = {"--soc": args.soc, "--cutoff-v": args.cutoff_v, "--capacity-j": args.capacity_j}
    unused = [name for name, value in of_battery.items() if value is not None]
    if unused:
        cli.remark(", ".join(unused), "not used: motor currents alone say nothing of the battery")
    if args.mcap is not None:
        cli.remark(str(args.mcap), "holds no advice: motor currents alone give none")


def _of_companion(args: Args) -> dict[str, Any]:
    """Arguments of the companion that every way of watching takes."""
    return {
        "soc": args.soc, "risk": args.risk, "cutoff_v": args.cutoff_v, "capacity_j": args.capacity_j,
        "cruise_mps": args.cruise_mps,
    }  # fmt: skip


@contextlib.contextmanager
def _streamed(args: Args, robot: Robot) -> Iterator[list[Stream]]:
    """What the advice goes to for Foxglove: nothing, or one stream."""
    if not args.foxglove and args.mcap is None:
        yield []
        return
    try:
        # only now: it needs a further package
        from homeward.watch.foxglove.stream import LAYOUT, Stream, address_of
    except ModuleNotFoundError:
        option = "--foxglove" if args.foxglove else "--mcap"
        advice = installed.advice("foxglove", "foxglove-sdk")
        raise CompanionError(f"{option} needs foxglove-sdk: {advice}") from None
    address = None
    if args.foxglove:
        address = address_of(args.foxglove_address)
    with contextlib.closing(Stream(robot.name, address, args.mcap)) as stream:
        if stream.url is not None:
            cli.remark(
                "Foxglove", f"open a connection to {stream.url}, and import the layout {LAYOUT}"
            )
        yield [stream]


def _join(args: Args, robot: Robot, outputs: Sequence[Output]) -> None:
    """Advise a robot on its ROS 2 network until it is interrupted."""
    domain = _domain(args.domain)
    try:
        from homeward.watch.online.session import Session  # only now: they need further packages
        from homeward.watch.ros2.network import Network
    except ModuleNotFoundError as error:
        raise CompanionError(
            f"--ros2 needs {error.name}: {installed.advice('ros2', 'cyclonedds rosbags')}"
        ) from None
    network = Network(domain, args.namespace.rstrip("/"))
    Session(
        robot, network, f"{robot.name} on domain {domain}", args.columns, args.home, args.state, outputs,
        docks=docks_of(args.docks), **_of_companion(args),
    ).run(cli.Terminal(), args.quiet)  # fmt: skip


def _advise_vehicle(args: Args, address: str, robot: Robot, outputs: Sequence[Output]) -> None:
    """Advise a vehicle with an autopilot until it is interrupted."""
    try:
        from homeward.watch.mavlink.vehicle import Vehicle  # only now: they need further packages
        from homeward.watch.online.session import Session
    except ModuleNotFoundError as error:
        raise CompanionError(
            f"--mavlink needs {error.name}: {installed.advice('logs', 'pymavlink rosbags')}"
        ) from None
    vehicle = Vehicle(address)
    met = vehicle.meet(lambda text: cli.remark(address, text))
    for text in met.said():
        cli.remark(address, text)
    Session(
        robot, vehicle, f"{robot.name} on {address}", args.columns or "any_robot", met.home, args.state, outputs,
        forecast_mps=met.wind_mps, **_of_companion(args),
    ).run(cli.Terminal(), args.quiet)  # fmt: skip


def _advise_by_lines(args: Args, robot: Robot, outputs: Sequence[Output]) -> None:
    """Advise a robot whose messages another process writes, until that closes its end."""
    try:
        from homeward.watch.online.lines import Lines  # only now: they need further packages
        from homeward.watch.online.session import Session
    except ModuleNotFoundError as error:
        raise CompanionError(
            f"--stdin needs {error.name}: {installed.advice('logs', 'rosbags')}"
        ) from None
    lines = Lines(sys.stdin.fileno(), sys.stdout.fileno(), args.namespace.rstrip("/"))
    Session(
        robot, lines, f"{robot.name} by standard input", args.columns, args.home, args.state, outputs,
        docks=docks_of(args.docks), **_of_companion(args),
    ).run(cli.Terminal(stderr=True), args.quiet, lambda: lines.ended)  # fmt: skip


def _domain(domain_id: int | None) -> int:
    """Number of the domain."""
    text = str(domain_id)
    if domain_id is None:
        text = os.environ.get("ROS_DOMAIN_ID", "")
    if not text:
        return 0
    if not text.isdecimal() or int(text) > 232:
        raise CompanionError(f"ROS domain {text!r} is not allowed; give a number from 0 to 232")
    return int(text)


def table_of(rows: list[Row]) -> Table:
    """Coverage, bias and error by the way left; the last row is of all moments."""
    table = Table(box=box.SIMPLE_HEAD)
    scored = rows[-1].crps is not None
    headings = ["moments", "in the 90 %\ninterval", "bias", "median\nerror", "half\ninterval"]
    if scored:
        headings += ["CRPS", "interval\nscore"]
    table.add_column("way left")
    for heading in headings:
        table.add_column(heading, justify="right")
    for row in rows:
        nearest_m, furthest_m = row.metres
        way_left = f"{quantities.distance(furthest_m)} to {quantities.distance(nearest_m)}"
        if row is rows[-1]:
            way_left = "all"
            table.add_section()
        scores = [f"{score:.1%}" for score in (row.crps, row.interval_score) if score is not None]
        table.add_row(
            way_left, str(row.moments), f"{row.covered:.0%}", f"{row.bias:+.1%}", f"{row.error:.1%}",
            f"{row.width:.1%}", *scores,
        )  # fmt: skip
    return table


def moments_of(runs: list[Watched]) -> pd.DataFrame:
    """Every moment of every run, one row each."""
    names = ("time_s", "left_m", "took_j", "mean_j", "low_j", "high_j")
    tables = []
    for run in runs:
        columns = {name: getattr(run, name) for name in names}
        tables.append(pd.DataFrame({"run": no_formula(run.name), **columns}))
    table = pd.concat(tables)
    if runs[0].unit == "A s":  # a charge
        table = table.rename(columns={name: name.replace("_j", "_as") for name in names})
    return table


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    return cli.run(main, Args, __doc__, (RobotError, RecordingError, CompanionError))
