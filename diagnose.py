"""Find which physics a robot's simulator lacks, from recordings of the robot.

`homeward diagnose RUN... --robot PRESET_OR_TOML [--columns MAP] --out DIR`, in a checkout also
`python diagnose.py`, writes DIR/diagnosis.json, DIR/report.html, DIR/corrected.toml, and recorded
and predicted power over time as DIR/series.parquet and DIR/series.mcap. RUN is a table, a ROS bag
(read without ROS), or a log of PX4, ArduPilot or VESC Tool. Without RUN it diagnoses the synthetic
recording that is part of the package.

`--group NAME=RUNS --group NAME=RUNS` compares mean residuals, parameters and effects of groups of
runs and writes DIR/groups.json and DIR/groups.html.
"""

from __future__ import annotations

import sys
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import homeward  # noqa: F401 - first: it says in a line what is not installed

# isort: split
import tyro
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from homeward import cli
from homeward.datasets import DATASETS, DatasetError, fetch, shipped_recording
from homeward.diagnosis import Analysis, Recording, RecordingError, analyse, read_recording
from homeward.diagnosis.chain import STAGES
from homeward.diagnosis.result import Verdict
from homeward.diagnosis.tell import terminal
from homeward.diagnosis.tell.report import write_outputs
from homeward.diagnosis.tell.series import MCAP
from homeward.files import check_writable
from homeward.groups.comparison import Comparison
from homeward.groups.inputs import Grouped, grouped_runs
from homeward.groups.report import show_groups, write_groups
from homeward.groups.runs import compare_driving, compare_standing
from homeward.groups.standing import stands
from homeward.installed import advice
from homeward.logs.bags import is_bag
from homeward.logs.plausible import within_top_speed
from homeward.own_effects import VARIABLE, own_file
from homeward.physics import RobotError, load_robot

ASSUMED = "husky"
"""Robot that is assumed for recordings without --robot."""
SHIPPED_ROBOT = "husky"
"""Robot of the shipped recording."""
EXIT_CODES: dict[Verdict, int] = {
    "missing_physics": 10, "unknown_physics": 11, "parameters_off": 12, "no_mismatch": 13, "not_testable": 14,
}  # fmt: skip
"""Exit codes by verdict with --exit-code, in the order of precedence."""


@dataclass(frozen=True)
class Args:
    """Recordings, robot and output."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """Recordings (.csv, .csv.gz, .txt, .parquet, .bag, .mcap, .db3, .ulg, .bin or the folder of a
    ROS 2 bag), one run each; by default the one that is part of the package."""
    group: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """NAME=RUNS: a group to compare with others, once per group or run. RUNS are paths or patterns
    separated by commas, or a group of a data set, such as EE2=turtlebot3_tactics/EE2."""
    standing: bool = False
    """The robot stood while it recorded: a recording without a motion channel then gives its
    ancillary power."""
    robot: str | None = None
    """Robot of the simulator: preset name or TOML file; by default that of the data set, or husky,
    and a line says so."""
    columns: str | None = None
    """Mapping of columns or, for bags, of topics, for recordings with other names: shipped name or
    TOML file."""
    effects: Path | None = None
    """Python file with an effect of your own, which is run: a hypothesis like the others
    (docs/extending.md)."""
    dataset: str | None = None
    """Public data set to fetch instead of RUN, or a group of it, such as
    husky_borealtc/FLOORING."""
    out: Path = Path("runs/diagnosis")
    """Folder for diagnosis.json, report.html, corrected.toml and series; for groups also
    groups.json and groups.html."""
    seed: int = 0
    """Seed of the bootstrap draws."""
    exit_code: bool = False
    """Exit with a code for the verdict: 10 missing_physics, 11 unknown_physics, 12 parameters_off,
    13 no_mismatch, 14 not_testable."""


def main(args: Args, without: Collection[str] = ()) -> Analysis | Comparison:
    """Diagnose, or compare groups; write the outputs and print the verdict.

    An experiment runs `without` some conditions under which an effect is named.

    Raises:
        RecordingError, RobotError, DatasetError: The input cannot be used. If that is found only
            after reading all of it, the report with the reason is written nonetheless.
        OSError: The output folder cannot be written to.
    """
    if args.effects is not None and own_file() != args.effects.absolute():
        raise RecordingError(
            f"--effects is read when a command starts; in Python set {VARIABLE} before the import"
        )
    if args.group:
        return _compare(args)
    paths, robot, columns = _inputs(args)
    check_writable(args.out)
    recordings = _read([(path, columns) for path in paths], args.standing)
    analysis = _diagnose(recordings, robot, args, without)
    if all(stands(recording) for recording in recordings):
        level = compare_standing(recordings, ["these runs"] * len(recordings))
        write_groups(level, args.out)
        show_groups(level, cli.Terminal())
    if not analysis.diagnosis.recordings:
        raise RecordingError(f"{analysis.diagnosis.summary} (report in {args.out})")
    return analysis


def _compare(args: Args) -> Comparison:
    if args.exit_code:
        raise RecordingError(
            "--exit-code is for one verdict, and --group compares several; give one of them"
        )
    if args.runs or args.dataset:
        raise RecordingError(
            "give either --group or RUN and --dataset, not both; --group takes NAME=DATASET/GROUP"
        )
    groups = grouped_runs(args.group, args.columns)
    check_writable(args.out)
    recordings = _read(
        [(path, columns) for group in groups for path, columns in group.runs], args.standing
    )
    labels = [group.name for group in groups for _ in group.runs]
    _refuse_twice(recordings, labels)
    if all(stands(recording) for recording in recordings):
        comparison = compare_standing(recordings, labels)
    else:
        analysis = _diagnose(recordings, _robot_of(args, groups), args, ())
        comparison = compare_driving(analysis, recordings, labels)
    page = write_groups(comparison, args.out)[-1]
    console = cli.Terminal()
    show_groups(comparison, console)
    console.print(f"Page: {page}", soft_wrap=True)
    return comparison


def _read(paths: list[tuple[Path, str | None]], standing: bool) -> list[Recording]:
    recordings = [read_recording(path, columns, standing=standing) for path, columns in paths]
    drives = [recording.name for recording in recordings if not stands(recording)]
    if standing and drives:
        raise RecordingError(
            f"{drives[0]}: its motion channel shows that it drives; leave out --standing"
        )
    return recordings


def _refuse_twice(recordings: list[Recording], labels: list[str]) -> None:
    seen: dict[str, str] = {}
    for recording, label in zip(recordings, labels, strict=True):
        if recording.sha256 in seen:
            raise RecordingError(
                f"{recording.name} ({label}) is the same recording as {seen[recording.sha256]}; a run counts once"
            )
        seen[recording.sha256] = f"{recording.name} ({label})"


def _robot_of(args: Args, groups: list[Grouped]) -> str | None:
    datasets = [group.dataset for group in groups if group.dataset is not None]
    if args.robot:
        return args.robot
    if datasets:
        return _robot_of_dataset(datasets[0])
    return None


def _robot_of_dataset(name: str) -> str:
    robot = DATASETS[name].robot
    if robot is None:
        raise DatasetError(f"{name}: no preset fits this robot; name one with --robot")
    return robot


def _diagnose(
    recordings: list[Recording], robot: str | None, args: Args, without: Collection[str]
) -> Analysis:
    if robot is None:
        print(
            f"no --robot is given: {ASSUMED} is assumed; name yours, a preset or a TOML file",
            file=sys.stderr,
        )
    top_mps = load_robot(robot or ASSUMED).max_speed_mps
    recordings = [within_top_speed(recording, top_mps) for recording in recordings]
    console = cli.Terminal(stderr=True)
    with Progress(
        TextColumn("{task.description:<22}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
    ) as bar:
        task = bar.add_task("starting", total=len(STAGES) + 1)

        def show(stage: str) -> None:
            bar.update(task, description=stage, completed=STAGES.index(stage))

        analysis = analyse(
            recordings, robot or ASSUMED, seed=args.seed, progress=show, without=without
        )
        bar.update(task, description="writing", completed=len(STAGES))
        written = write_outputs(analysis, args.out)
    _print(analysis, recordings, written)
    return analysis


def _inputs(args: Args) -> tuple[list[Path], str | None, str | None]:
    """Paths of the recordings, the robot if it is known, and the mapping."""
    if args.dataset is None:
        if args.runs:
            return list(args.runs), args.robot or None, args.columns
        return [shipped_recording()], args.robot or SHIPPED_ROBOT, args.columns
    if args.runs:
        raise RecordingError("give either RUN or --dataset, not both")
    name, _, group = args.dataset.partition("/")
    runs = fetch(name, group)
    robot = args.robot or _robot_of_dataset(name)
    columns = args.columns or DATASETS[name].columns
    return runs, robot, columns


def _print(analysis: Analysis, recordings: list[Recording], written: list[Path]) -> None:
    how_read = {(recording.name, note) for recording in recordings for note in recording.notes}
    for finding in analysis.findings:
        says_how_read = (
            is_bag(Path(finding.recording)) or (finding.recording, finding.text) in how_read
        )
        if says_how_read and not finding.refused:
            cli.remark(Path(finding.recording).name, finding.text)
    console = cli.Terminal()
    terminal.show(analysis, console)
    if analysis.evidence is not None and not any(path.name == MCAP for path in written):
        print(f"no {MCAP}, which needs rosbags: {advice('logs', 'rosbags')}", file=sys.stderr)
    report = next(path for path in written if path.suffix == ".html")
    console.print(f"Report: {report}", soft_wrap=True)


def run() -> int:
    """Run from the command line: 0 for any verdict, or its code of `EXIT_CODES` if asked for; 3 if
    a download fails, otherwise see `homeward.cli.run`."""
    codes: list[int] = []

    def noting_the_verdict(args: Args) -> None:
        result = main(args)
        if args.exit_code and isinstance(result, Analysis):
            codes.append(EXIT_CODES[result.diagnosis.verdict])

    code = cli.run(noting_the_verdict, Args, __doc__, (RecordingError, RobotError, DatasetError))
    if code == 0 and codes:
        return codes[0]
    return code


if __name__ == "__main__":
    sys.exit(run())
