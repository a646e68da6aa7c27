"""The folder of a training run: its settings, whether it is finished, and its checkpoints."""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Iterator, Mapping
from enum import Enum, auto
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from homeward.agents.trained.policy_file import DESCRIPTION, WEIGHTS
from homeward.files import read_json, write_whole

RUN = "run.json"
LOCK = "run.lock"
CURVE = "curve.csv"
TENSORBOARD = "tensorboard"
WANDB = "wandb"
FIRST = "first"
LAST = "last"
"""Subfolders of the policies at the beginning and the end of training."""
CURVE_POLICIES = "curve"
"""Subfolder of the policies at the points of the learning curve, each in a folder named by its
steps."""
CHECKPOINT = "checkpoint.safetensors"
PREVIOUS = "checkpoint.previous.safetensors"


class TrainingError(ValueError):
    """A training run that cannot be made or continued; the message says what to change."""


class RunState(Enum):
    """What remains to be done in a run's folder."""

    NEW = auto()
    REPLACED = auto()
    CONTINUED = auto()
    FINISHED = auto()


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a run's folder against other trainings; the system releases the lock when the process
    ends, however it ends.

    Raises:
        TrainingError: The folder contains something other than a run, or another training uses it.
        OSError: The folder cannot be written to.
    """
    _refuse_strangers(folder)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        lock = FileLock(folder / LOCK).acquire(timeout=0)
    except Timeout:
        raise TrainingError(
            f"another training is using {folder}: wait for it, or choose another --out"
        ) from None
    with lock:
        yield


def _refuse_strangers(folder: Path) -> None:
    if (folder / RUN).is_file():
        _read(folder)
    elif any(path.name != LOCK for path in folder.glob("[!.]*")):
        raise TrainingError(
            f"{folder} is not empty and contains no training run: choose another --out"
        )


def open_run(
    folder: Path,
    settings: Mapping[str, Any],
    made_with: Mapping[str, str],
    *,
    resume: bool,
    replace: bool,
) -> RunState:
    """Begin a run in its folder, `locked` by the caller, or find the state of the same run in it.

    Args:
        folder: Folder of the run.
        settings: All settings, JSON; more `steps` than before continue the folder's run.
        made_with: Version and hashes of everything else that determines the result.
        resume: Whether to continue an unfinished run.
        replace: Whether to remove a run with other settings or of other code; never a longer one.

    Raises:
        TrainingError: The folder contains a run that must not be continued or replaced.
        OSError: The folder cannot be written to.
    """
    run: dict[str, Any] = json.loads(
        json.dumps({"settings": settings, "made_with": made_with, "extended_from": []})
    )
    if not (folder / RUN).is_file():
        return _write(folder, run, RunState.NEW)
    for leftover in folder.glob(".*.safetensors.*"):  # of a killed write
        leftover.unlink()
    if not any((folder / name).is_file() for name in (DESCRIPTION, CHECKPOINT, PREVIOUS)):
        return _write(folder, run, RunState.NEW)
    stored = _read(folder)
    difference = _difference(stored, run)
    if difference and replace:
        _keep_longer(folder, stored, run["settings"]["steps"])
        _remove(folder)
        return _write(folder, run, RunState.REPLACED)
    if difference:
        raise TrainingError(
            f"{folder} holds a run {difference}: choose another --out, or remove it and train anew with --replace"
        )
    return _go_on(folder, stored, run["settings"]["steps"], resume)


def _keep_longer(folder: Path, stored: Mapping[str, Any], steps: int) -> None:
    steps_of_policy = _steps_of_policy(folder)
    if steps_of_policy is not None and steps < max(steps_of_policy, stored["settings"]["steps"]):
        raise TrainingError(
            f"{folder} contains a policy trained on {steps_of_policy} steps, which a run of {steps} steps must not "
            "replace: choose another --out, or delete it first"
        )


def extended_from(folder: Path) -> list[int]:
    """Numbers of steps of the folder's run before it was extended; the learning rate had fallen at
    each."""
    return list(_read(folder)["extended_from"])


def _go_on(folder: Path, stored: dict[str, Any], steps: int, resume: bool) -> RunState:
    steps_of_policy = _steps_of_policy(folder)
    if steps_of_policy == steps:
        return RunState.FINISHED
    if not resume:
        run = f"this run, of {steps_of_policy} steps"
        if steps_of_policy is None:
            run = "this run unfinished"
        raise TrainingError(
            f"{folder} holds {run}: continue it with --resume, or choose another --out"
        )
    goal = stored["settings"]["steps"]
    if steps == goal:
        return RunState.CONTINUED
    if not any((folder / name).is_file() for name in (CHECKPOINT, PREVIOUS)):
        raise TrainingError(
            f"{folder} contains no checkpoint to continue from: choose another --out"
        )
    extended = {
        "settings": stored["settings"] | {"steps": steps},
        "extended_from": [*stored["extended_from"], goal],
    }
    return _write(folder, stored | extended, RunState.CONTINUED)


def _write(folder: Path, run: Mapping[str, Any], state: RunState) -> RunState:
    write_whole(folder / RUN, json.dumps(run, indent=2) + "\n")
    return state


def _read(folder: Path) -> dict[str, Any]:
    try:
        stored = read_json(folder / RUN)
        # A run of an early version holds its settings only: made with other code, as far as anyone
        # can tell.
        run: dict[str, Any] = {"made_with": {}, "extended_from": []} | stored
        has_both = all(isinstance(run[name], dict) for name in ("settings", "made_with"))
        if (
            has_both
            and isinstance(run["settings"].get("steps"), int)
            and isinstance(run["extended_from"], list)
        ):
            return run
    except (ValueError, KeyError, TypeError):
        pass
    raise TrainingError(f"{folder / RUN} does not describe a training run: choose another --out")


def _difference(stored: Mapping[str, Any], run: Mapping[str, Any]) -> str:
    """Difference between the folder's run and this one; more steps are no difference."""
    settings = stored["settings"]
    wanted = run["settings"]
    differing = [name for name in wanted if settings.get(name) != wanted[name]]
    if settings["steps"] < wanted["steps"]:
        differing = [name for name in differing if name != "steps"]
    if differing:
        texts = [f"{name} {settings.get(name)!r}" for name in differing]
        return f"with other settings ({', '.join(texts)})"
    changed = [
        name for name, value in run["made_with"].items() if stored["made_with"].get(name) != value
    ]
    if changed:
        return f"made before a change of {', '.join(changed)}"
    return ""


def _steps_of_policy(folder: Path) -> int | None:
    """Steps that the policy in the folder was trained on, before they were made up to whole
    updates."""
    try:
        return int(read_json(folder / DESCRIPTION)["training"]["steps"])
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        raise TrainingError(f"{folder / DESCRIPTION} is damaged: choose another --out") from None


def _remove(folder: Path) -> None:
    """Remove the files of a run, its description last: after a kill in between it is still another
    run."""
    for part in (TENSORBOARD, WANDB, FIRST, LAST, CURVE_POLICIES):
        shutil.rmtree(folder / part, ignore_errors=True)
    for name in (DESCRIPTION, WEIGHTS, CURVE, CHECKPOINT, PREVIOUS, RUN):
        (folder / name).unlink(missing_ok=True)


def write_checkpoint(folder: Path, content: bytes) -> None:
    """Write a checkpoint, keeping the one before; a kill at any moment leaves at least one intact.

    Raises:
        OSError: The folder cannot be written to; older checkpoints remain.
    """
    fresh = folder / "next.safetensors"
    write_whole(fresh, content)
    if (folder / CHECKPOINT).is_file():
        (folder / CHECKPOINT).replace(folder / PREVIOUS)
    fresh.replace(folder / CHECKPOINT)
