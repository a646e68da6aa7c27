"""Groups of runs as the command line names them: NAME=RUNS, with paths, patterns or a data set's
group."""

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
    """Runs of a group, each with the mapping of its columns, and the data set that they come
    from."""

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
    for request in requests:
        name, equals, sources = request.partition("=")
        if not equals or not _NAME.fullmatch(name) or not sources.strip(", "):
            raise RecordingError(
                f"--group {request!r} is not NAME=RUNS, such as before=a1.csv,a2.csv or after='b*.csv'"
            )
        group = groups.get(name, Grouped(name, (), None))
        for source in sources.split(","):
            if source:
                runs, dataset = _runs(source, columns)
                group = Grouped(name, (*group.runs, *runs), dataset or group.dataset)
        groups[name] = group
    if len(groups) < 2:
        raise RecordingError(
            f"one group only, {next(iter(groups))}; a comparison needs --group at least twice"
        )
    datasets = {group.dataset for group in groups.values() if group.dataset is not None}
    if len(datasets) > 1:
        raise RecordingError(
            "the groups are of different data sets, and so of different robots; compare groups of one"
        )
    return list(groups.values())


def _runs(source: str, columns: str | None) -> tuple[list[tuple[Path, str | None]], str | None]:
    """Runs of a data set's group, of a file, or of a pattern, each with its mapping, and the name
    of the data set."""
    dataset, _, group = source.partition("/")
    if dataset in DATASETS and not Path(source).is_file():
        mapping = columns or DATASETS[dataset].columns
        return [(path, mapping) for path in fetch(dataset, group)], dataset
    is_run_of_tables = len(tables_of_run(Path(source))) > 1
    is_run = is_run_of_tables or Path(source).exists()
    paths = [source] if is_run else sorted(glob.glob(source))
    if not paths:
        raise RecordingError(f"{source}: no such file, and no file matches it as a pattern")
    return [(Path(path), columns) for path in paths], None
