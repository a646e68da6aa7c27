"""Say which physics a robot's simulator lacks, from recordings of the robot.

`homeward diagnose RUN... --robot PRESET_OR_TOML [--columns MAP] --out DIR`, in a checkout also `python diagnose.py`,
writes DIR/diagnosis.json, DIR/report.html and DIR/corrected.toml. RUN is a table or a ROS bag, read without ROS.
Without RUN it diagnoses the recording that ships with the project.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from homeward import cli
from homeward.datasets import DATASETS, DatasetError, fetch, shipped_recording
from homeward.diagnosis import Analysis, RecordingError, analyse, terminal
from homeward.diagnosis.bags.files import is_bag
from homeward.diagnosis.chain import STAGES
from homeward.diagnosis.report import check_writable, write_outputs
from homeward.physics import RobotError


@dataclass(frozen=True)
class Args:
    """What to diagnose."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """Recordings (.csv, .csv.gz, .parquet, .bag, .mcap, .db3 or the folder of a ROS 2 bag), one run each; none: the one
    that ships with the project."""
    robot: str | None = None
    """Robot that the simulator uses: preset name or TOML file; the data set's own, or husky, if left out."""
    columns: str | None = None
    """Mapping for foreign recordings, of columns or, for bags, of topics: shipped name or TOML file."""
    dataset: str | None = None
    """Public data set to fetch instead of RUN, or a group of it, such as husky_borealtc/FLOORING."""
    out: Path = Path("runs/diagnosis")
    """Folder for diagnosis.json, report.html and corrected.toml."""
    seed: int = 0
    """Seed of the bootstrap draws."""


def main(args: Args) -> Analysis:
    """Diagnose, write the outputs and print the verdict.

    Raises:
        RecordingError, RobotError, DatasetError: Input that cannot be used.
        OSError: The output folder cannot be written to.
    """
    runs, robot, columns = _inputs(args)
    check_writable(args.out)
    console = Console(stderr=True)
    with Progress(
        TextColumn("{task.description:<22}"), BarColumn(), TimeElapsedColumn(), console=console, transient=True
    ) as bar:
        task = bar.add_task("starting", total=len(STAGES) + 1)

        def show(stage: str) -> None:
            bar.update(task, description=stage, completed=STAGES.index(stage))

        analysis = analyse(runs, robot, columns, args.seed, show)
        bar.update(task, description="writing", completed=len(STAGES))
        written = write_outputs(analysis, args.out)
    _print(analysis, written)
    return analysis


def _inputs(args: Args) -> tuple[list[Path], str, str | None]:
    if args.dataset is None:
        return list(args.runs) or [shipped_recording()], args.robot or "husky", args.columns
    if args.runs:
        raise RecordingError("give either RUN or --dataset, not both")
    name, _, group = args.dataset.partition("/")
    runs = fetch(name, group)
    robot = args.robot or DATASETS[name].robot
    if robot is None:
        raise DatasetError(f"{name}: no preset fits this robot; name one with --robot")
    return runs, robot, args.columns or DATASETS[name].columns


def _print(analysis: Analysis, written: list[Path]) -> None:
    for one in analysis.findings:
        if is_bag(Path(one.recording)) and not one.refused:
            print(f"{Path(one.recording).name}: {one.text}", file=sys.stderr)
    console = Console()
    terminal.show(analysis, console)
    report = next(path for path in written if path.suffix == ".html")
    console.print(f"Report: {report}", markup=False, highlight=False, soft_wrap=True)


def run() -> int:
    """Run from the command line: 0 for any verdict, 3 if a download fails, else see `homeward.cli.run`."""
    return cli.run(main, Args, __doc__, (RecordingError, RobotError, DatasetError))


if __name__ == "__main__":
    sys.exit(run())
