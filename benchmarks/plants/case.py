"""What a concealed case consists of, and how the part the tool may see is kept apart from the truth."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from homeward.files import write_whole
from homeward.physics import Robot

Array = NDArray[np.float64]
Kind = Literal["single", "pair", "outside", "invisible", "exact", "misset"]
Noise = Literal["low", "middle", "high"]


@dataclass(frozen=True)
class Run:
    """One recording: channels of the recording schema, and when the hidden effect was at work; arrays of shape (n,)."""

    channels: Mapping[str, Array]
    affected: NDArray[np.bool_]


@dataclass(frozen=True)
class Case:
    """Recordings of a robot whose file lacks `truth`; controls lack nothing (`exact`) or are `misset`."""

    name: str  # says nothing of the truth: "case_017"
    source: str  # "rover", "cell" or "plant"
    kind: Kind
    truth: tuple[str, ...]  # effect ids; what it is in words for `outside`; () for controls
    noise: Noise
    seed: int
    robot: Robot  # the nominal file, all that the tool knows of the robot
    runs: tuple[Run, ...]
    noise_rms: float  # of what was observed, W or A: the floor that no model can go below


@dataclass(frozen=True)
class Truth:
    """What the scorer knows of a case and the tool does not; `affected` holds one array per run, of shape (n,)."""

    name: str
    source: str
    kind: Kind
    truth: tuple[str, ...]
    noise: Noise
    seed: int
    noise_rms: float
    affected: tuple[NDArray[np.bool_], ...]


def anonymous(source: str, number: int) -> str:
    """Name of a case that neither says nor sorts by what is hidden in it.

    >>> anonymous("plant", 17) == anonymous("plant", 17) != anonymous("cell", 17)
    True
    """
    return "case_" + hashlib.blake2b(f"{source} {number}".encode(), digest_size=4).hexdigest()


def write(case: Case, seen: Path, truth: Path) -> tuple[Path, ...]:
    """Write recordings and nominal robot into seen/NAME/, and what is hidden in them into truth/NAME.json and .npz.

    Args:
        case: The case.
        seen: Folder that the tool may open.
        truth: Folder that only the scorer opens.

    Returns:
        Paths of the recordings in order.

    Raises:
        ValueError: The truth would lie where the tool may see it.
        OSError: A folder cannot be written to.
    """
    if truth.resolve().is_relative_to(seen.resolve()) or seen.resolve().is_relative_to(truth.resolve()):
        raise ValueError(f"truth folder {truth} and seen folder {seen} contain each other; name two separate folders")
    folder = seen / case.name
    write_whole(folder / "robot.toml", case.robot.to_toml())
    paths = tuple(folder / f"run_{number}.csv.gz" for number in range(1, len(case.runs) + 1))
    for path, run in zip(paths, case.runs, strict=True):
        table = pd.DataFrame(dict(run.channels)).to_csv(index=False, float_format="%.7g")
        write_whole(path, gzip.compress(table.encode(), compresslevel=4, mtime=0))  # same bytes for the same seed
    labels = {"name": case.name, "source": case.source, "kind": case.kind, "truth": list(case.truth),
              "noise": case.noise, "seed": case.seed, "noise_rms": case.noise_rms}  # fmt: skip
    masks = io.BytesIO()
    np.savez_compressed(masks, **{path.name: run.affected for path, run in zip(paths, case.runs, strict=True)})  # type: ignore[arg-type]
    write_whole(truth / f"{case.name}.json", json.dumps(labels, indent=1) + "\n")
    write_whole(truth / f"{case.name}.npz", masks.getvalue())
    return paths


def read_truth(truth: Path, name: str) -> Truth:
    """Read what `write` kept from the tool about one case.

    Raises:
        OSError: There is no such case in the folder.
    """
    labels = json.loads((truth / f"{name}.json").read_text(encoding="utf-8"))
    with np.load(truth / f"{name}.npz") as masks:
        affected = tuple(masks[run] for run in masks.files)
    return Truth(**{**labels, "truth": tuple(labels["truth"])}, affected=affected)
