"""Diagnose the recordings of a fleet, robot by robot, several at once, on this machine or on a Ray
cluster.

`homeward fleet FOLDER --robot husky --jobs 2 --out runs/fleet`: every folder in FOLDER is a robot
and contains its recordings, and optionally its own robot file as robot.toml. A folder of tables in
it is one run, whose tables are joined. Each robot's diagnosis.json, report.html and corrected.toml
are written to OUT/NAME as soon as they are done, and OUT/fleet.csv lists all robots. The same
command again diagnoses only what is new or has changed.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich import box
from rich.table import Table

from homeward import Robot, RobotError, cli, load_robot
from homeward.diagnosis import Diagnosis, Recording, RecordingError, analyse, read_recording
from homeward.diagnosis.tell.report import write_outputs
from homeward.files import check_writable, csv_text, write_whole
from homeward.logs.bags import is_bag
from homeward.logs.plausible import within_top_speed
from homeward.logs.recordings import read_tables
from homeward.parallel import ClusterError, TaskError, check_workers, code_hash, run_tasks

ASSUMED = "husky"
"""Robot that is assumed for folders without a robot file."""
ROBOT = "robot.toml"
DIAGNOSIS = "diagnosis.json"
KEY = "inputs.sha256"


@dataclass(frozen=True)
class Args:
    """Recordings, robots and output."""

    fleet: Annotated[Path, tyro.conf.Positional]
    """Folder with one folder of recordings per robot."""
    robot: str | None = None
    """Robot of folders without a robot.toml: preset name or TOML file; by default husky, and a line
    says so."""
    columns: str | None = None
    """Mapping for recordings with other names: shipped name or TOML file."""
    out: Path = Path("runs/fleet")
    """Folder for one folder per robot, and fleet.csv."""
    seed: int = 0
    """Seed of the bootstrap draws, the same for every robot."""
    jobs: int = 1
    """Processes on this machine."""
    cluster: str | None = None
    """HOST:PORT of a Ray cluster to use instead; the recordings are sent there, and nothing has to
    be shared."""


@dataclass(frozen=True)
class Member:
    """One robot's diagnosis as a task, with everything that it needs on any machine."""

    recordings: tuple[Recording, ...]
    robot: Robot
    seed: int

    @property
    def key(self) -> str:
        """Hash of everything that determines the diagnosis."""
        inputs = (
            *(recording.sha256 for recording in self.recordings),
            self.robot.to_toml(),
            str(self.seed),
            code_hash(),
        )
        return hashlib.sha256("\n".join(inputs).encode()).hexdigest()


def main(args: Args) -> dict[str, Diagnosis]:
    """Diagnose every robot, write the outputs, print a table, and return the diagnoses by robot.

    Raises:
        RecordingError, RobotError: Input that cannot be used. Nothing has been diagnosed or, where
            that shows only then, the reports that say why are written nonetheless.
        TaskError: A diagnosis failed; finished ones are written, and the same command continues.
        ClusterError: The cluster cannot be reached.
        OSError: The output folder cannot be written to.
    """
    check_workers(args.jobs, args.cluster)
    cases = members_of(args)
    check_writable(args.out)

    def keep(name: str, files: dict[str, bytes]) -> None:
        for file, content in files.items():
            write_whole(args.out / name / file, content)
        write_whole(args.out / name / KEY, cases[name].key)  # last: it marks the others as complete

    due = {name: case for name, case in cases.items() if not _is_written(args.out / name, case)}
    run_tasks(diagnose_one, due, jobs=args.jobs, cluster=args.cluster, keep=keep, title="robots")
    diagnoses = {
        name: Diagnosis.from_json((args.out / name / DIAGNOSIS).read_text("utf-8"))
        for name in cases
    }
    write_whole(args.out / "fleet.csv", _csv(diagnoses))
    _print(diagnoses, len(cases) - len(due), args.out)
    if not any(diagnosis.recordings for diagnosis in diagnoses.values()):
        raise RecordingError(
            f"no recording of any robot can be used: {args.out / 'fleet.csv'} says why"
        )
    return diagnoses


def members_of(args: Args) -> dict[str, Member]:
    """Read all recordings and robot files, by the name of the robot's folder.

    Raises:
        RecordingError, RobotError: One is invalid, or there is none.
    """
    try:
        folders = [entry for entry in _visible(args.fleet) if entry.is_dir()]
    except OSError as error:
        raise RecordingError(
            f"cannot read {args.fleet}: {error.strerror}; give a folder of folders"
        ) from None
    if not folders:
        raise RecordingError(
            f"{args.fleet} contains no folder: give one with a folder of recordings per robot"
        )
    nominal = load_robot(args.robot or ASSUMED)
    if args.robot is None:
        _say_assumed([folder.name for folder in folders if not (folder / ROBOT).is_file()])
    return {folder.name: _member(folder, nominal, args) for folder in folders}


def _visible(folder: Path) -> list[Path]:
    """Entries of a folder in order, without those whose name begins with a dot."""
    return sorted(entry for entry in folder.iterdir() if entry.name[0] != ".")


def _say_assumed(folders: list[str]) -> None:
    """Say for which folders a robot is assumed, the first five by name."""
    if not folders:
        return
    named = ", ".join(folders[:5])
    if len(folders) > 5:
        named += ", ..."
    print(cli.printable(f"no --robot is given: {ASSUMED} is assumed for {named}"), file=sys.stderr)


def _member(folder: Path, nominal: Robot, args: Args) -> Member:
    """Read the recordings of a robot, and its file if it has one of its own."""
    files = [entry for entry in _visible(folder) if entry.name != ROBOT]
    if not files:
        raise RecordingError(
            f"{folder} contains no recording: remove it, or put the robot's recordings there"
        )
    robot = nominal
    if (folder / ROBOT).is_file():
        robot = load_robot(folder / ROBOT)
    recordings = tuple(
        within_top_speed(_read(file, args.columns), robot.max_speed_mps) for file in files
    )
    for file, recording in zip(files, recordings, strict=True):
        for note in recording.notes:
            cli.remark(f"{folder.name}/{file.name}", note)
    return Member(recordings, robot, args.seed)


def _read(entry: Path, columns: str | None) -> Recording:
    """A recording of a robot: a file or a bag, or a folder whose tables are those of one run."""
    if not entry.is_dir() or is_bag(entry):
        return read_recording(entry, columns)
    tables = _visible(entry)
    if not tables:
        raise RecordingError(
            f"{entry} contains no table of a run: remove it, or put the tables of one run there"
        )
    if len(tables) == 1:
        return read_recording(tables[0], columns)
    return read_tables(tables, columns)


def diagnose_one(case: Member) -> dict[str, bytes]:
    """Content of the output files of one robot, by name."""
    analysis = analyse(case.recordings, case.robot, seed=case.seed)
    with tempfile.TemporaryDirectory() as folder:
        return {file.name: file.read_bytes() for file in write_outputs(analysis, Path(folder))}


def _is_written(folder: Path, case: Member) -> bool:
    try:
        return (folder / KEY).read_text("utf-8") == case.key
    except OSError:
        return False


def _rows(diagnoses: dict[str, Diagnosis]) -> list[tuple[str, str, str, str]]:
    return [
        (
            name,
            diagnosis.verdict,
            " ".join(missing.effect for missing in diagnosis.missing_physics),
            diagnosis.summary,
        )
        for name, diagnosis in diagnoses.items()
    ]


def _csv(diagnoses: dict[str, Diagnosis]) -> str:
    return csv_text([("robot", "verdict", "missing_physics", "summary"), *_rows(diagnoses)])


def _print(diagnoses: dict[str, Diagnosis], finished: int, out: Path) -> None:
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("robot", "verdict", "missing", "summary"):
        table.add_column(heading, overflow="fold")
    for row in _rows(diagnoses):
        table.add_row(*row)
    console = cli.Terminal()
    console.print(table)
    earlier = ""
    if finished:
        earlier = f", {finished} of them before"
    console.print(f"{len(diagnoses)} robots diagnosed{earlier}: {out}", soft_wrap=True)


def run() -> int:
    """Run from the command line, see `homeward.cli.run`."""
    refused = (RecordingError, RobotError, TaskError, ClusterError)
    return cli.run(
        main,
        Args,
        __doc__,
        refused,
        interrupted="finished results are kept, the same command continues",
    )
