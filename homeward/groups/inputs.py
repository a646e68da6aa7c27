"""Groups of runs as the command line names them: NAME=RUNS, with paths, patterns or a data set's group."""

from __future__ import annotations

import glob
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from homeward.datasets import DATASETS, fetch
from homeward.logs import RecordingError
from homeward.logs.joined import tables_of_run

_NAME = re.compile(r"[\w.+ -]{1,40}")


@dataclass(frozen=True)
class Grouped:
    """Runs of a group, each with the mapping of its columns, and the data set that they come from."""

    name: str
    runs: tuple[tuple[Path, str | None], ...]
    dataset: str | None


def grouped_runs(requests: Sequence[str], columns: str | None) -> list[Grouped]:
    """The groups in the order given, those of one name put together.

    Args:
        requests: Each NAME=RUNS.
        columns: Mapping for all; by default data sets use their own.

    Raises:
        RecordingError: Fewer than two groups, an invalid name, or a pattern that matches no file.
        DatasetError: A data set's group is unknown or not available.
    """
    groups: dict[str, Grouped] = {}
    for group in requests:
        name, equals, values = group.partition("=")
        if not equals or not _NAME.fullmatch(name) or not values.strip(", "):
            raise RecordingError(f"--group {group!r} is not NAME=RUNS, such as before=a1.csv,a2.csv or after='b*.csv'")
        collected = groups.get(name, Grouped(name, (), None))
        for value in filter(None, values.split(",")):
            runs, dataset = _runs(value, columns)
            collected = Grouped(name, (*collected.runs, *runs), dataset or collected.dataset)
        groups[name] = collected
    if len(groups) < 2:
        raise RecordingError(f"one group only, {next(iter(groups))}; a comparison needs --group at least twice")
    if len({group.dataset for group in groups.values()} - {None}) > 1:
        raise RecordingError("the groups are of different data sets, and so of different robots; compare groups of one")
    return list(groups.values())


def _runs(value: str, columns: str | None) -> tuple[list[tuple[Path, str | None]], str | None]:
    dataset, _, group = value.partition("/")
    if dataset in DATASETS and not Path(value).is_file():
        return [(path, columns or DATASETS[dataset].columns) for path in fetch(dataset, group)], dataset
    joined = len(tables_of_run(Path(value))) > 1
    paths = [value] if joined or Path(value).exists() else sorted(glob.glob(value))
    if not paths:
        raise RecordingError(f"{value}: no such file, and no file matches it as a pattern")
    return [(Path(path), columns) for path in paths], None
