"""Public recordings of real robots, downloaded once with a checksum and kept in a cache, or read
from a local folder."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import pooch
from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn

LOCAL_FOLDER = "HOMEWARD_DATA"
"""Environment variable with a folder of data sets, used instead of the network."""


class DatasetError(OSError):
    """A data set that is unknown or not available; the message says what to do."""


class DownloadError(DatasetError):
    """A failed download, with an exit code of its own, so that a script can continue without it."""

    exit_code = 3


@dataclass(frozen=True)
class Dataset:
    """Source of a data set, with its mapping and robot."""

    name: str
    base_url: str
    columns: str  # shipped mapping file
    robot: str | None  # preset that drove it
    licence: str
    # index of the folder that names a file's group; a number before it, as in 3_EE2, is removed
    group_folder: int = 0


DATASETS = {
    dataset.name: dataset
    for dataset in (
        Dataset(
            "husky_borealtc",
            "https://raw.githubusercontent.com/norlab-ulaval/BorealTC/2e64df4074f28f7e037b22eb4dc0f26843e24e69/data/borealtc/",
            "husky_borealtc",
            "husky",
            "CC0 1.0, LaRocque et al., IROS 2024",
        ),
        Dataset(
            "f1tenth_frictionmaps",
            "https://raw.githubusercontent.com/AhmadAmine998/FrictionMaps/e747ecacea6ec47697919ca616f9f4f5b406d516/DataSets/DS5/",
            "f1tenth_frictionmaps",
            "f1tenth",
            "MIT, (c) 2022 AhmadAmine998",
        ),
        Dataset(
            "turtlebot3_tactics",
            "https://raw.githubusercontent.com/S2-group/msr-2021-robotics-green-architectural-tactics-replication-package/ec92e17a86d2a472b3f2c91f793bd101db8984da/RQ2_data/raw_data_experiment/",
            "turtlebot3_tactics",
            None,
            "MIT, S2-group, MSR 2021",
            group_folder=1,
        ),
        Dataset(
            "ase_rover",
            "https://raw.githubusercontent.com/S2-group/greens-2026-ase-rover-rep-pkg/",
            "ase_rover",
            None,
            "MIT, S2-group, GREENS 2026",
        ),
    )
}
"""The data sets, by name. Addresses of files carry the commit, so that the files cannot change."""


def fetch(name: str, group: str = "", *, progress: bool = True) -> list[Path]:
    """Paths of a data set's recordings, downloaded at the first call.

    Args:
        name: One of `DATASETS`.
        group: Only the files of this group, such as `FLOORING`.
        progress: Show a progress bar per file.

    Raises:
        DownloadError: The download failed.
        DatasetError: Unknown name or group, a file that differs from its checksum, or a cache that
            cannot be written.
    """
    if name not in DATASETS:
        raise DatasetError(f"unknown data set {name!r}; known: {', '.join(DATASETS)}")
    registry = _registry(name)
    wanted = [file for file in registry if not group or _group(name, file) == group]
    if not wanted:
        raise DatasetError(
            f"{name} has no group {group!r}; groups: {', '.join(groups_of(name)) or 'none'}"
        )
    local = os.environ.get(LOCAL_FOLDER)
    if local:
        return [_local(Path(local) / name, file, registry[file]) for file in wanted]
    return _downloaded(name, wanted, registry, progress)


def _downloaded(
    name: str, wanted: list[str], registry: dict[str, str], progress: bool
) -> list[Path]:
    """Paths of files in the cache, downloaded where they are not there yet; arguments and errors as
    of `fetch`."""
    source = pooch.create(
        path=pooch.os_cache("homeward") / name, base_url=DATASETS[name].base_url, registry=registry,
        urls={file: url_of(name, file) for file in registry}, retry_if_failed=2,
    )  # fmt: skip
    bar = _Bar() if progress else False
    downloader = pooch.HTTPDownloader(progressbar=bar, timeout=30)
    pooch.get_logger().setLevel("WARNING")
    import requests  # only now, as in pooch: it is slow to load

    paths = []
    for file in wanted:
        try:
            paths.append(Path(source.fetch(file, downloader=downloader)))
        except ValueError as error:
            raise DatasetError(
                f"{name}: {file} differs from its checksum; delete {source.path} and retry"
            ) from error
        except requests.exceptions.RequestException as error:
            raise DownloadError(
                f"{name}: {file} cannot be downloaded ({type(error).__name__}); without network set {LOCAL_FOLDER} "
                f"to a folder that contains {name}/, or use the recording that is part of the package"
            ) from error
        except OSError as error:
            raise DatasetError(
                f"{name}: {source.path} cannot be written ({error.strerror or error}); set XDG_CACHE_HOME to a folder "
                f"with enough space, or {LOCAL_FOLDER} to one that contains {name}/"
            ) from error
    return paths


def files_of(name: str) -> list[str]:
    """Files of a data set, by their paths in it.

    Args:
        name: One of `DATASETS`.
    """
    return list(_registry(name))


def groups_of(name: str) -> list[str]:
    """Groups of a data set's files, sorted.

    Args:
        name: One of `DATASETS`.

    >>> groups_of("turtlebot3_tactics")
    ['EE1', 'EE2', 'EE3', 'EE4', 'baseline', 'combined']
    """
    return sorted({_group(name, file) for file in _registry(name)} - {""})


def url_of(name: str, file: str) -> str:
    """Address of a file of a data set.

    Args:
        name: One of `DATASETS`.
        file: Its path in the data set.
    """
    elsewhere = {line[1]: line[2] for line in _lines(name) if len(line) == 3}
    return DATASETS[name].base_url + elsewhere.get(file, file)


def shipped_recording() -> Path:
    """The recording that is part of the package: synthetic, of a Husky that differs from the preset
    `husky`."""
    return Path(str(files("homeward") / "recordings" / "synthetic_husky.csv.gz"))


class _Bar:
    """A rich progress bar with the interface that pooch expects: one per file, removed when it is
    complete."""

    def __init__(self) -> None:
        self.total = 0

    def update(self, count: int) -> None:
        """Count received bytes, or those pooch adds at the end so that the bar is full."""
        self._bar.update(self._task, total=self.total or None, advance=count)

    def reset(self) -> None:
        """Start a new file."""
        columns = (TextColumn("fetching recordings"), BarColumn(), DownloadColumn())
        self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
        self._task = self._bar.add_task("", total=None)
        self._bar.start()

    def close(self) -> None:
        """End the bar."""
        self._bar.stop()


def _group(name: str, file: str) -> str:
    folders = file.split("/")[:-1]
    index = DATASETS[name].group_folder
    if index >= len(folders):
        return ""
    return re.sub(r"^\d+_", "", folders[index])


def _registry(name: str) -> dict[str, str]:
    """Files of a data set and their SHA-256."""
    return {file: digest for digest, file, *_ in _lines(name)}


def _lines(name: str) -> list[list[str]]:
    """SHA-256, path and, where it differs, the path at the source, of each file."""
    text = (files("homeward") / "recordings" / f"{name}.sha256").read_text(encoding="utf-8")
    return [line.split() for line in text.splitlines() if line and not line.startswith("#")]


def _local(folder: Path, file: str, digest: str) -> Path:
    """A file of a local copy, by its path in the data set or by the name that prefixes it with the
    folder."""
    paths = [path for path in (folder / file, *folder.glob(f"*_{file}")) if path.is_file()]
    if not paths:
        raise DatasetError(f"{LOCAL_FOLDER}: {folder / file} does not exist")
    path = paths[0]
    if pooch.file_hash(str(path)) != digest:
        raise DatasetError(f"{LOCAL_FOLDER}: {path} differs from its checksum")
    return path
