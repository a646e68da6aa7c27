"""Drive robots with faulty battery gauges until the companion says to turn, and count who gets
home.

`python -m benchmarks.on_the_robot.gauges --drives 200 --seed 1 --out runs/gauges.csv`
"""

from __future__ import annotations

import dataclasses
import math
import platform
import sys
import time
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Literal

import tyro
from joblib import Parallel, delayed
from rich.console import Console
from tyro.conf import FlagCreatePairsOff

from benchmarks.on_the_robot.gauges import pybamm_pack, report, score
from benchmarks.on_the_robot.gauges.battery import Engine
from benchmarks.on_the_robot.gauges.drive import Case, Drive, run_drive
from benchmarks.on_the_robot.gauges.gauge import Gauge
from benchmarks.on_the_robot.gauges.robots import Curve, accepted_curve, refusal
from benchmarks.on_the_robot.gauges.sizes import Sizes, read_sizes

Robot = Literal["husky", "turtlebot3", "f1tenth"]
Chemistry = Literal["nmc", "lipo", "lfp", "lead_acid", "flat"]
WIDTH = 170  # chosen: characters, so that a figure with its interval stays in a line


@dataclass(frozen=True)
class Args:
    """What to run."""

    drives: int = 200
    """Drives; gauges and chemistries are spread evenly over them."""
    seed: int = 1
    """Seed of everything drawn. A drive depends on it, on the drive's number, and on the choices
    below."""
    robots: tuple[Robot, ...] = ("husky", "turtlebot3", "f1tenth")
    """Robots."""
    chemistries: tuple[Chemistry, ...] = ("nmc", "lipo", "lfp", "lead_acid", "flat")
    """Chemistries."""
    gauges: tuple[Gauge, ...] = (
        "counter", "linear_voltage", "pieces_voltage", "coarse", "late", "reset", "stuck", "none",
    )  # fmt: skip
    """Battery gauges."""
    current: FlagCreatePairsOff[bool] = False
    """Only robots that record voltage and current. Without this and the next, half of them do."""
    no_current: FlagCreatePairsOff[bool] = False
    """Only robots that do not record current."""
    engine: Engine = "circuit"
    """What gives the voltage: the simulator's own circuit, or PyBaMM, stepped through every drive
    (nmc, lipo and lfp only)."""
    curve: Curve | None = None
    """What the robot file says of the open-circuit voltage; None: what the installed version
    accepts."""
    charged: FlagCreatePairsOff[bool] = False
    """The user charges the battery and says so: `Companion(soc=1.0)`. By default the gauge's first
    reading counts."""
    positions_m: float | None = None
    """Noise of all positions, m; None: as drawn."""
    jobs: int = 2
    """Processes."""
    out: Path | None = None
    """File for a row a drive, CSV."""


def main(args: Args) -> list[Drive]:
    """Drive, print the tables, and write the rows."""
    console = Console()
    console.width = max(console.width, WIDTH)  # a log file has no width of its own
    sizes = read_sizes()
    if args.positions_m is not None:
        # As many as before, so that everything else is drawn alike.
        noises_m = [args.positions_m] * len(sizes.instruments.position_noises_m)
        instruments = dataclasses.replace(sizes.instruments, position_noises_m=noises_m)
        sizes = dataclasses.replace(sizes, instruments=instruments)
    if args.engine == "pybamm":
        lacking = pybamm_pack.missing()
        if lacking is None and args.curve == "measured":
            lacking = "--curve measured: its curve is that of the circuit; give chemistry or none with --engine pybamm"
        if lacking is None and not _driven(args):
            cells = ", ".join(pybamm_pack.PARAMETER_SETS)
            lacking = f"--engine pybamm has cells of {cells}; give --chemistries of them"
        if lacking is not None:
            console.print(lacking)
            sys.exit(1)
        left_out = [name for name in args.chemistries if name not in pybamm_pack.PARAMETER_SETS]
        if left_out:
            console.print(f"Left out, as PyBaMM has no cell of them: {', '.join(left_out)}.")
    curve = accepted_curve(args.chemistries, sizes) if args.curve is None else args.curve
    for chemistry in args.chemistries:
        refused = refusal(curve, chemistry, sizes)
        if refused is not None:
            console.print(f"--curve {curve}: {refused}")
            sys.exit(1)
    cases = make_cases(args, curve, sizes)

    start_s = time.perf_counter()
    runs = (delayed(run_drive)(case, sizes) for case in cases)
    drives: list[Drive] = Parallel(n_jobs=args.jobs)(runs)
    wall_s = time.perf_counter() - start_s

    title = (
        f"{len(drives)} drives, seed {args.seed}, {args.engine}, curve {curve}; {_versions(args)}"
    )
    show(drives, sizes, title, console)
    console.print(_times(drives, wall_s, args.jobs))
    if args.out is not None:
        report.write_rows(drives, args.out)
        console.print(f"A row a drive: {args.out}")
    return drives


def make_cases(args: Args, curve: Curve, sizes: Sizes) -> list[Case]:
    """Spread gauges, chemistries, robots, packs and electrical readings evenly over the drives."""
    cells = list(product(args.gauges, _driven(args)))
    both = args.current == args.no_current
    currents = [True, False] if both else [args.current]
    conditions = list(product(sizes.truth.pack_shares, currents, args.robots))
    # From one round to the next, a cell moves on by this many conditions. Without a common divisor,
    # it meets every condition in time.
    stride = len(cells) + 1
    while math.gcd(stride, len(conditions)) > 1:
        stride += 1
    cases = []
    for number in range(args.drives):
        rounds, cell = divmod(number, len(cells))
        gauge, chemistry = cells[cell]
        pack_share, with_current, robot = conditions[(cell + stride * rounds) % len(conditions)]
        cases.append(
            Case(
                number=number,
                seed=args.seed,
                robot=robot,
                chemistry=chemistry,
                gauge=gauge,
                with_current=with_current,
                pack_share=pack_share,
                curve=curve,
                told_soc=1.0 if args.charged else None,
                engine=args.engine,
            )
        )
    return cases


def _driven(args: Args) -> list[Chemistry]:
    """Chemistries that the engine has."""
    return [
        name
        for name in args.chemistries
        if args.engine == "circuit" or name in pybamm_pack.PARAMETER_SETS
    ]


def show(drives: list[Drive], sizes: Sizes, title: str, console: Console) -> None:
    """Print all tables."""
    console.print(report.stranded_table(drives, sizes, title))
    console.print(report.left_table(drives, sizes, title))
    console.print(report.paired_table(drives, title))
    console.print(report.coverage_table(drives, sizes, title))
    console.print(report.error_table(drives, sizes, title))
    lacking = score.missing()
    console.print(report.crps_table(drives, title) if lacking is None else lacking)
    lines = report.trouble_lines(drives)
    console.print("\n".join(lines) if lines else "No crash, and no inconsistent advice.")


def _times(drives: list[Drive], wall_s: float, jobs: int) -> str:
    """Computing times, in a line."""
    updates = sum(drive.updates for drive in drives)
    companion_s = sum(drive.companion_s for drive in drives)
    return (
        f"{wall_s:.0f} s in {jobs} processes, {wall_s / len(drives):.2f} s a drive; "
        f"{1e3 * companion_s / max(updates, 1):.2f} ms an update of the companion."
    )


def _versions(args: Args) -> str:
    """Versions of what was used."""
    packages = ["homeward", "numpy", "numba"]
    if args.engine == "pybamm":
        packages.append("pybamm")
    if find_spec("scoringrules") is not None:
        packages.append("scoringrules")
    return ", ".join([f"Python {platform.python_version()}", *map(_version, packages)])


def _version(package: str) -> str:
    """Name and version of a package."""
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return f"{package}, not installed as a package"


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
