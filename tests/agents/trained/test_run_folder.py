"""The folder of a training run: what is begun, continued, replaced or refused, and that a kill
leaves a checkpoint."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from homeward.agents.trained.policy_file import DESCRIPTION, WEIGHTS
from homeward.agents.trained.run_folder import (
    CHECKPOINT,
    CURVE,
    FIRST,
    LAST,
    LOCK,
    PREVIOUS,
    RUN,
    TENSORBOARD,
    WANDB,
    RunState,
    TrainingError,
    extended_from,
    locked,
    open_run,
    write_checkpoint,
)

STEPS = 1000
SETTINGS = {"difficulty": "uncertain", "seed": 0, "steps": STEPS}
CODE = {"homeward": "0.1.0", "physics": "a hash"}


def opened(
    folder: Path,
    code: dict[str, str] = CODE,
    *,
    resume: bool = False,
    replace: bool = False,
    **changes: Any,
) -> RunState:
    with locked(folder):
        return open_run(folder, SETTINGS | changes, code, resume=resume, replace=replace)


@pytest.fixture
def unfinished(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    assert opened(folder) is RunState.NEW
    write_checkpoint(folder, b"numbers")
    return folder


@pytest.fixture
def finished(unfinished: Path) -> Path:
    (unfinished / WEIGHTS).touch()
    (unfinished / DESCRIPTION).write_text(json.dumps({"training": SETTINGS}))
    return unfinished


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def refused(folder: Path, match: str, **arguments: Any) -> None:
    """The run is refused in one line, and its folder stays as it is."""
    before = contents(folder)
    with pytest.raises(TrainingError, match=match) as caught:
        opened(folder, **arguments)
    assert "\n" not in str(caught.value)
    assert contents(folder) == before


def test_a_new_run_holds_its_settings(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "run"
    assert opened(folder) is RunState.NEW
    run = json.loads((folder / RUN).read_text())
    assert run == {"settings": SETTINGS, "made_with": CODE, "extended_from": []}


@pytest.mark.parametrize("resume", [False, True])
def test_a_run_killed_before_its_first_checkpoint_begins_anew(tmp_path: Path, resume: bool) -> None:
    opened(tmp_path)
    leftover = tmp_path / ".next.safetensors.part"
    leftover.touch()
    assert opened(tmp_path, resume=resume, seed=1) is RunState.NEW
    assert json.loads((tmp_path / RUN).read_text())["settings"]["seed"] == 1
    assert not leftover.exists()


def test_an_unfinished_run_goes_on_when_asked(unfinished: Path) -> None:
    refused(unfinished, "holds this run unfinished: continue it with --resume")
    assert opened(unfinished, resume=True) is RunState.CONTINUED


@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize("replace", [False, True])
def test_a_finished_run_is_left_alone(finished: Path, resume: bool, replace: bool) -> None:
    before = contents(finished)
    assert opened(finished, resume=resume, replace=replace) is RunState.FINISHED
    assert contents(finished) == before


def test_more_steps_extend_a_run_the_folder_remembers_and_an_interruption_leaves_it_open(
    finished: Path,
) -> None:
    for _ in range(2):
        refused(
            finished,
            f"holds this run, of {STEPS} steps: continue it with --resume",
            steps=2 * STEPS,
        )
        assert opened(finished, steps=2 * STEPS, resume=True) is RunState.CONTINUED
        assert extended_from(finished) == [STEPS]


def test_a_run_without_checkpoint_is_not_extended(finished: Path) -> None:
    (finished / CHECKPOINT).unlink()
    refused(
        finished,
        "contains no checkpoint to continue from: choose another --out",
        steps=2 * STEPS,
        resume=True,
    )


@pytest.mark.parametrize("resume", [False, True])
def test_other_settings_need_another_folder(finished: Path, resume: bool) -> None:
    changes: dict[str, Any] = {"seed": 1, "difficulty": "known"}
    refused(
        finished,
        r"with other settings \(difficulty 'uncertain', seed 0\): choose",
        resume=resume,
        **changes,
    )
    refused(
        finished, rf"with other settings \(steps {STEPS}\): choose", resume=resume, steps=STEPS - 1
    )


@pytest.mark.parametrize("resume", [False, True])
def test_other_code_needs_another_folder(finished: Path, resume: bool) -> None:
    code = CODE | {"physics": "another"}
    refused(
        finished,
        "made before a change of physics: choose another --out, or .* --replace",
        code=code,
    )


def test_a_run_of_an_early_version_was_made_with_other_code(finished: Path) -> None:
    (finished / RUN).write_text(json.dumps({"settings": SETTINGS}))
    refused(finished, "made before a change of homeward, physics")


@pytest.mark.parametrize("changes", [{"seed": 1}, {"code": CODE | {"physics": "another"}}])
def test_to_replace_removes_the_files_of_a_run_and_nothing_else(
    finished: Path, changes: dict[str, Any]
) -> None:
    for part in (TENSORBOARD, WANDB, FIRST, LAST):
        (finished / part).mkdir()
        (finished / part / "file").touch()
    for name in (CURVE, PREVIOUS, "notes.txt"):
        (finished / name).touch()
    assert opened(finished, replace=True, **changes) is RunState.REPLACED
    assert {entry.name for entry in finished.iterdir()} == {RUN, LOCK, "notes.txt"}
    assert opened(finished, **changes) is RunState.NEW


@pytest.mark.parametrize("changes", [{}, {"seed": 1}])
def test_fewer_steps_never_replace_a_longer_finished_run(
    finished: Path, changes: dict[str, Any]
) -> None:
    says = f"trained on {STEPS} steps, which a run of 1 steps must not replace"
    refused(finished, says, steps=1, resume=True, replace=True, **changes)


def test_fewer_steps_never_replace_a_run_that_is_being_extended(finished: Path) -> None:
    opened(finished, steps=3 * STEPS, resume=True)
    refused(
        finished,
        "which a run of 2000 steps must not replace",
        steps=2 * STEPS,
        replace=True,
        seed=1,
    )


@pytest.mark.parametrize("replace", [False, True])
@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("notes.txt", "", "not empty and contains no training run"),
        (RUN, "{}", "does not describe"),
        (RUN, "\x00", "does not"),
        (RUN, '{"settings": {"steps": "many"}}', "does not describe"),
        (RUN, '{"settings": {"steps": 1}, "extended_from": 5}', "does not describe"),
    ],
)
def test_a_foreign_folder_is_left_alone(
    tmp_path: Path, name: str, content: str, message: str, replace: bool
) -> None:
    (tmp_path / name).write_text(content)
    (tmp_path / CHECKPOINT).touch()
    refused(tmp_path, message, replace=replace)
    assert not (tmp_path / LOCK).exists()


@pytest.mark.parametrize("name", [RUN, DESCRIPTION])
@pytest.mark.parametrize(
    "content", ["[" * 100_000, '{"training": {"steps": 1e400}}', " " * 2_000_000]
)
def test_hostile_json_is_one_line(finished: Path, name: str, content: str) -> None:
    (finished / name).write_text(content)
    refused(finished, f"{name} (is damaged|does not describe a training run)", resume=True)


def test_a_pipe_is_no_run(finished: Path) -> None:
    (finished / DESCRIPTION).unlink()
    os.mkfifo(finished / DESCRIPTION)
    refused(finished, f"{DESCRIPTION} is damaged", resume=True)


def test_two_trainings_do_not_share_a_folder(tmp_path: Path) -> None:
    second = (
        "import sys; from pathlib import Path; from homeward.agents.trained.run_folder import TrainingError, locked\n"
        "try:\n    locked(Path(sys.argv[1])).__enter__()\nexcept TrainingError as error:\n    print(error)"
    )
    with locked(tmp_path):
        run = subprocess.run(
            [sys.executable, "-c", second, tmp_path], capture_output=True, text=True, check=True
        )
    assert (
        run.stdout
        == f"another training is using {tmp_path}: wait for it, or choose another --out\n"
    )
    with locked(tmp_path):  # free again
        pass


def test_a_lock_is_free_again_after_an_error(tmp_path: Path) -> None:
    for _ in range(2):
        with pytest.raises(KeyError), locked(tmp_path):
            raise KeyError


def test_the_checkpoint_before_is_kept(tmp_path: Path) -> None:
    for number in range(3):
        write_checkpoint(tmp_path, bytes([number]))
    assert contents(tmp_path) == {CHECKPOINT: b"\x02", PREVIOUS: b"\x01"}


def test_a_checkpoint_that_cannot_be_written_leaves_those_before(tmp_path: Path) -> None:
    for number in range(2):
        write_checkpoint(tmp_path, bytes([number]))
    (tmp_path / "next.safetensors").mkdir()  # in the way of the new one
    with pytest.raises(OSError):
        write_checkpoint(tmp_path, b"\x02")
    assert contents(tmp_path) == {CHECKPOINT: b"\x01", PREVIOUS: b"\x00"}
