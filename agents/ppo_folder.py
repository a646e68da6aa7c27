"""The folder of a training run: which run it holds, whether it is finished, and its checkpoints."""

from __future__ import annotations

import json
from collections.abc import Mapping
from enum import Enum, auto
from pathlib import Path
from typing import Any

from homeward.agents.policy_file import DESCRIPTION
from homeward.agents.ppo_settings import TrainingError
from homeward.files import write_whole

RUN, CHECKPOINT, PREVIOUS, TENSORBOARD = "run.json", "checkpoint.zip", "checkpoint.previous.zip", "tensorboard"


class RunState(Enum):
    """What is to be done in a run's folder."""

    NEW = auto()
    CONTINUED = auto()
    FINISHED = auto()


def open_run(folder: Path, settings: Mapping[str, Any], resume: bool) -> RunState:
    """Make the folder of a run, or find what it already holds of this very run.

    Args:
        folder: Of the run; made where it is missing.
        settings: All that the result depends on, JSON.
        resume: Whether an unfinished run is to be continued.

    Raises:
        TrainingError: The folder holds something else, or an unfinished run that is not to be continued.
        OSError: The folder cannot be written to.
    """
    settings = json.loads(json.dumps(settings))
    if not (folder / RUN).is_file():
        if folder.is_dir() and any(not entry.name.startswith(".") for entry in folder.iterdir()):
            raise TrainingError(f"{folder} is not empty and holds no training run: choose another --out")
        return _begin(folder, settings)
    for leftover in folder.glob(".*.zip.*"):  # of a write that was killed
        leftover.unlink()
    if not any((folder / name).is_file() for name in (DESCRIPTION, CHECKPOINT, PREVIOUS)):
        return _begin(folder, settings)
    _check_settings(folder, settings)
    if (folder / DESCRIPTION).is_file():
        return RunState.FINISHED
    if not resume:
        raise TrainingError(f"{folder} holds this run unfinished: continue it with --resume, or choose another --out")
    return RunState.CONTINUED


def _begin(folder: Path, settings: Mapping[str, Any]) -> RunState:
    write_whole(folder / RUN, json.dumps({"settings": settings}, indent=2) + "\n")
    return RunState.NEW


def _check_settings(folder: Path, settings: Mapping[str, Any]) -> None:
    try:
        known = json.loads((folder / RUN).read_text("utf-8"))["settings"]
        differing = [f"{name} {known.get(name)!r}" for name in settings if known.get(name) != settings[name]]
    except (ValueError, KeyError, TypeError, AttributeError):
        raise TrainingError(f"{folder / RUN} does not describe a training run: choose another --out") from None
    if differing:
        raise TrainingError(f"{folder} holds a run with other settings ({', '.join(differing)}): choose another --out")


def write_checkpoint(folder: Path, content: bytes) -> None:
    """Write a checkpoint, keeping the one before; a kill at any moment leaves at least one whole.

    Raises:
        OSError: The folder cannot be written to; the older checkpoints are still there.
    """
    fresh = folder / "next.zip"
    write_whole(fresh, content)
    if (folder / CHECKPOINT).is_file():
        (folder / CHECKPOINT).replace(folder / PREVIOUS)
    fresh.replace(folder / CHECKPOINT)
