"""Training: it learns, is reproducible, survives a kill, and says what is wrong."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from homeward.agents.policy_file import DESCRIPTION, WEIGHTS, load_policy
from homeward.agents.ppo_folder import CHECKPOINT, PREVIOUS, RUN, TENSORBOARD
from homeward.agents.ppo_settings import PPOSettings, TrainingError
from train import Args, main, run

TINY = PPOSettings(n_envs=32, n_steps=16, batch_size=128, epochs=2, hidden=16)
STEPS = 8 * TINY.rollout


def tiny(out: Path, **changes: Any) -> Args:
    return dataclasses.replace(Args(out=out, steps=STEPS, ppo=TINY, decision_s=120.0), **changes)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return main(tiny(tmp_path_factory.mktemp("finished") / "run", checkpoint_s=0.0))


def test_a_run_leaves_a_policy_checkpoints_and_logs(finished: Path) -> None:
    assert {entry.name for entry in finished.iterdir()} == {
        RUN, CHECKPOINT, PREVIOUS, TENSORBOARD, WEIGHTS, DESCRIPTION
    }  # fmt: skip
    assert any((finished / TENSORBOARD).iterdir())
    description = load_policy(finished).description
    assert description["env"] == "homeward/Survey-v0"
    assert description["steps"] == STEPS
    assert description["training"]["discount"] == TINY.discount
    assert {"homeward", "torch", "stable-baselines3"} <= set(description["versions"])


def test_a_finished_run_is_left_alone(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path: path.read_bytes() for path in finished.rglob("*") if path.is_file()}
    for resume in (False, True):
        assert main(tiny(finished, resume=resume)) == finished
        assert "finished: nothing to do" in capsys.readouterr().err.replace("\n", " ")
    assert before == {path: path.read_bytes() for path in finished.rglob("*") if path.is_file()}


def test_the_seed_decides_everything(finished: Path, tmp_path: Path) -> None:
    weights = (finished / WEIGHTS).read_bytes()
    assert (main(tiny(tmp_path / "same")) / WEIGHTS).read_bytes() == weights
    assert (main(tiny(tmp_path / "other", seed=1)) / WEIGHTS).read_bytes() != weights


def command(out: Path) -> list[str]:
    options = "--n-envs 32 --n-steps 16 --batch-size 128 --epochs 2 --hidden 16 --decision-s 120 --checkpoint-s 0"
    return [sys.executable, "train.py", "--out", str(out), "--steps", str(STEPS), *options.split()]


def test_a_killed_run_goes_on_as_if_it_had_not_stopped(finished: Path, tmp_path: Path, root: Path) -> None:
    out = tmp_path / "run"
    process = subprocess.Popen(command(out), cwd=root, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120.0
    while not (out / PREVIOUS).is_file() and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.001)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert (out / CHECKPOINT).is_file() or (out / PREVIOUS).is_file()
    if not (out / DESCRIPTION).is_file():  # else it was faster than the kill
        with pytest.raises(TrainingError, match="unfinished: continue it with --resume"):
            main(tiny(out))
    main(tiny(out, resume=True))
    assert (out / WEIGHTS).read_bytes() == (finished / WEIGHTS).read_bytes()
    assert not [entry.name for entry in out.iterdir() if entry.name.startswith(".")]


@pytest.mark.parametrize("latest", ["damaged", "missing"])
def test_the_checkpoint_before_serves_where_the_latest_cannot(
    finished: Path, tmp_path: Path, latest: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in (RUN, PREVIOUS):
        (tmp_path / name).write_bytes((finished / name).read_bytes())
    if latest == "damaged":
        (tmp_path / CHECKPOINT).write_bytes((finished / CHECKPOINT).read_bytes()[:1000])
    main(tiny(tmp_path, resume=True))
    assert (f"{CHECKPOINT} cannot be read" in capsys.readouterr().err) == (latest == "damaged")
    assert (tmp_path / WEIGHTS).read_bytes() == (finished / WEIGHTS).read_bytes()


def test_damaged_checkpoints_alone_are_refused(finished: Path, tmp_path: Path) -> None:
    (tmp_path / RUN).write_bytes((finished / RUN).read_bytes())
    (tmp_path / CHECKPOINT).write_bytes(b"not a checkpoint")
    with pytest.raises(TrainingError, match="no checkpoint that can be read"):
        main(tiny(tmp_path, resume=True))


def test_resuming_an_empty_folder_begins(tmp_path: Path, finished: Path) -> None:
    main(tiny(tmp_path, resume=True))
    assert (tmp_path / WEIGHTS).read_bytes() == (finished / WEIGHTS).read_bytes()


def test_other_settings_need_another_folder(finished: Path) -> None:
    with pytest.raises(TrainingError, match=r"other settings \(difficulty 'uncertain', seed 0\): choose another --out"):
        main(tiny(finished, seed=1, difficulty="known"))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("notes.txt", "", "not empty and holds no training run"),
        (RUN, "{}", "does not describe"),
        (RUN, "\x00", "does not"),
    ],
)
def test_a_foreign_folder_is_left_alone(tmp_path: Path, name: str, content: str, message: str) -> None:
    (tmp_path / name).write_text(content)
    (tmp_path / CHECKPOINT).touch()
    with pytest.raises(TrainingError, match=message):
        main(tiny(tmp_path))
    assert {entry.name for entry in tmp_path.iterdir()} == {name, CHECKPOINT}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--env homeward/Nowhere-v0", "unknown env 'homeward/Nowhere-v0'; choose from homeward/OutAndBack-v0"),
        ("--difficulty easy", "difficulty = 'easy' is not allowed; choose from known, uncertain, harsh"),
        ("--robot nobody", "nobody"),
        ("--route nowhere", "route 'nowhere' is neither a known route nor a file"),
        ("--steps 0", "steps = 0 is not allowed; give at least 1"),
        ("--seed -1", "seed = -1 is not allowed; give at least 0"),
        ("--checkpoint-s nan", "checkpoint_s = nan is not allowed"),
        ("--batch-size 1000", "batch_size = 1000 does not divide"),
        ("--n-envs 0", "n_envs = 0 is not allowed"),
        ("--learning-rate nan", "learning_rate = nan is not allowed"),
        ("--entropy -1", "entropy = -1.0 is not allowed"),
        ("--discount 1.5", "discount = 1.5 is not allowed"),
        ("--device tpu", "device = 'tpu' is not allowed; choose from cpu, cuda, auto"),
    ],
)
def test_bad_input_is_one_line(
    arguments: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["train.py", "--out", str(tmp_path / "run"), *arguments.split()])
    assert run() == 2
    error = capsys.readouterr().err
    assert error.startswith("train.py: ") and error.count("\n") == 1
    assert message in error
    assert not (tmp_path / "run").exists()


def test_an_unwritable_folder_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(sys, "argv", ["train.py", "--out", str(tmp_path / "file" / "run")])
    assert run() == 2
    error = capsys.readouterr().err
    assert error.startswith("train.py: cannot write ") and error.endswith("choose another --out\n")


def test_missing_torch_says_what_to_install(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith("homeward.agents.ppo")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setattr(sys, "argv", ["train.py", "--out", str(tmp_path / "run")])
    assert run() == 2
    assert capsys.readouterr().err == "train.py: training needs torch: pip install 'homeward[train]'\n"


def test_it_learns_to_come_home(tmp_path: Path) -> None:
    ppo = PPOSettings(n_envs=128, n_steps=32, batch_size=512, epochs=8)
    args = Args(
        env="homeward/OutAndBack-v0", out=tmp_path, difficulty="known", steps=100_000, decision_s=120.0, ppo=ppo
    )
    main(args)
    first, last = (np.mean(home_rates(tmp_path)[part]) for part in (slice(0, 3), slice(-3, None)))
    assert last > 0.9 > 0.7 > first


def home_rates(folder: Path) -> list[float]:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(folder / TENSORBOARD))
    events.Reload()
    return [event.value for event in events.Scalars("missions/home_rate")]


def test_settings_are_written_with_the_run(finished: Path) -> None:
    settings = json.loads((finished / RUN).read_text())["settings"]
    assert settings["n_envs"] == TINY.n_envs
    assert settings["robot"] == "rusti_computer"
