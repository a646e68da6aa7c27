"""Training: it learns, is reproducible, survives a kill, and says what is wrong."""

import dataclasses
import io
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.numpy import save
from stable_baselines3.common.save_util import save_to_zip_file

import homeward
from homeward import load_robot
from homeward.agents.evaluation import learning_curve
from homeward.agents.evaluation.learning_curve import measure, read_curve
from homeward.agents.learning.settings import PPOSettings, TrainingError
from homeward.agents.registry import AGENTS, Request
from homeward.agents.trained import provenance
from homeward.agents.trained.inputs import COLUMNS
from homeward.agents.trained.policy_file import DESCRIPTION, WEIGHTS, load_policy
from homeward.agents.trained.run_folder import (
    CHECKPOINT,
    CURVE,
    CURVE_POLICIES,
    FIRST,
    LAST,
    LOCK,
    PREVIOUS,
    RUN,
    TENSORBOARD,
    locked,
)
from homeward.envs.features import NAMES
from homeward.envs.options import Options, known_of
from train import Args, main, run

pytestmark = pytest.mark.usefixtures("short_curves")

TINY = PPOSettings(start="scratch", n_envs=32, n_steps=16, batch_size=128, epochs=2, hidden=16)
STEPS = 8 * TINY.rollout


def tiny(out: Path, **changes: Any) -> Args:
    return dataclasses.replace(
        Args(out=out, steps=STEPS, ppo=TINY, decision_s=120.0, curve=2, checkpoints=8), **changes
    )


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, short_curves: None) -> Path:
    return main(tiny(tmp_path_factory.mktemp("finished") / "run"))


def test_a_run_leaves_a_policy_checkpoints_and_logs(finished: Path) -> None:
    assert {entry.name for entry in finished.iterdir()} == {
        RUN, LOCK, CHECKPOINT, PREVIOUS, TENSORBOARD, WEIGHTS, DESCRIPTION, CURVE, CURVE_POLICIES, FIRST, LAST
    }  # fmt: skip
    assert any((finished / TENSORBOARD).iterdir())
    description = load_policy(finished).description
    assert description["env"] == "homeward/Survey-v0"
    assert description["steps"] == STEPS
    assert description["training"]["discount"] == TINY.discount
    assert description["decision_s"] == 120.0
    assert description["made_with"] == json.loads((finished / RUN).read_text())["made_with"]
    assert {"homeward", "torch", "stable-baselines3"} <= set(description["versions"])


def test_the_learning_curve_goes_from_first_to_last_and_the_best_after_the_first_is_kept(
    finished: Path,
) -> None:
    curve = read_curve(finished)
    assert [point.steps for point in curve] == [0, STEPS // 2, STEPS]
    assert 0.0 == curve[0].steps < curve[1].trained_s < curve[2].trained_s
    known = known_of(Options("Survey", decision_s=120.0))
    best = max(curve[1:], key=lambda point: (point.score, point.steps))
    policy = load_policy(finished, known)
    assert policy.description["after_steps"] == best.steps
    assert [load_policy(finished / name).description["after_steps"] for name in (FIRST, LAST)] == [
        0,
        STEPS,
    ]
    kept = measure(policy, Options("Survey", decision_s=120.0), STEPS, 0.0)
    assert kept.score == pytest.approx(best.score, rel=1e-5)


def test_a_finished_run_is_left_alone(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = contents(finished)
    for resume in (False, True):
        assert main(tiny(finished, resume=resume)) == finished
        assert "finished: nothing to do" in capsys.readouterr().err.replace("\n", " ")
    assert contents(finished) == before


def test_the_seed_decides_everything(finished: Path, tmp_path: Path) -> None:
    weights = (finished / WEIGHTS).read_bytes()
    assert (main(tiny(tmp_path / "same")) / WEIGHTS).read_bytes() == weights
    assert (main(tiny(tmp_path / "other", seed=1)) / WEIGHTS).read_bytes() != weights


def command(out: Path) -> list[str]:
    options = (
        "--start scratch --n-envs 32 --n-steps 16 --batch-size 128 --epochs 2 --hidden 16 --curve 2"
    )
    more = ("--steps", str(STEPS), "--decision-s", "120", "--checkpoints", "8")
    return [sys.executable, "train.py", "--out", str(out), *options.split(), *more]


def test_a_killed_run_goes_on_and_ends_as_one_that_was_not(
    finished: Path, tmp_path: Path, root: Path
) -> None:
    out = tmp_path / "run"
    script = (
        f"from homeward.agents.evaluation import learning_curve; learning_curve.EPISODES = {learning_curve.EPISODES}; "
        "import train; train.run()"
    )
    short = [sys.executable, "-c", script, *command(out)[2:]]
    process = subprocess.Popen(
        short, cwd=root, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
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
    assert load_policy(out / LAST).description["after_steps"] == STEPS
    # none twice, none left out
    assert logged_steps(out) == [TINY.rollout * update for update in range(1, 9)]
    assert [point.steps for point in read_curve(out)] == [0, STEPS // 2, STEPS]
    for weights in (Path(WEIGHTS), Path(LAST, WEIGHTS)):
        assert (out / weights).read_bytes() == (finished / weights).read_bytes()
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
    assert load_policy(tmp_path / LAST).description["after_steps"] == STEPS


def test_damaged_checkpoints_alone_are_refused(finished: Path, tmp_path: Path) -> None:
    (tmp_path / RUN).write_bytes((finished / RUN).read_bytes())
    (tmp_path / CHECKPOINT).write_bytes(b"not a checkpoint")
    with pytest.raises(TrainingError, match="no checkpoint that can be read"):
        main(tiny(tmp_path, resume=True))


class Trap:
    """Pickled, a call of `os.mkdir` on reading."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self._folder),)


def pickled_by_torch(trap: Trap) -> bytes:
    content = io.BytesIO()
    torch.save(trap, content)
    return content.getvalue()


def as_stable_baselines_writes_it(trap: Trap) -> bytes:
    """A zip file with a pickle in base 64, which its own reader runs."""
    content = io.BytesIO()
    save_to_zip_file(content, {"num_timesteps": trap})
    return content.getvalue()


def within_safetensors(trap: Trap) -> bytes:
    """A checkpoint in all but what its header holds."""
    return save(
        {"policy.torch": np.frombuffer(pickle.dumps(trap), np.uint8)},
        {"homeward": pickle.dumps(trap, 0).decode()},
    )


@pytest.mark.parametrize(
    ("written", "name"),
    [
        (lambda trap: pickle.dumps(trap), CHECKPOINT),
        (pickled_by_torch, CHECKPOINT),
        (as_stable_baselines_writes_it, CHECKPOINT),
        (within_safetensors, CHECKPOINT),
        (as_stable_baselines_writes_it, "checkpoint.zip"),
    ],
)
def test_a_planted_pickle_is_not_run(
    finished: Path,
    tmp_path: Path,
    written: Callable[[Trap], bytes],
    name: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = copied(finished, tmp_path / "run", RUN, PREVIOUS)
    (out / name).write_bytes(written(Trap(tmp_path / "sprung")))
    main(tiny(out, resume=True))
    assert not (tmp_path / "sprung").exists()
    assert (f"{CHECKPOINT} cannot be read" in capsys.readouterr().err) == (name == CHECKPOINT)
    assert load_policy(out / LAST).description["after_steps"] == STEPS


@pytest.mark.parametrize("content", ["", "steps\nmany\n"])
def test_a_damaged_curve_is_one_line(finished: Path, tmp_path: Path, content: str) -> None:
    out = copied(finished, tmp_path / "run", RUN, CHECKPOINT)
    (out / CURVE).write_text(content)
    if not content:  # a curve without points
        main(tiny(out, resume=True))
    else:
        with pytest.raises(TrainingError, match=f"{CURVE} is damaged"):
            main(tiny(out, resume=True))


def test_nothing_is_replaced_by_what_cannot_be_trained(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = copied(finished, tmp_path / "run")
    before = contents(out)
    monkeypatch.delitem(sys.modules, "homeward.agents.learning.ppo")
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    with pytest.raises(TrainingError, match="training needs tensorboard"):
        main(tiny(out, seed=1, replace=True))
    assert contents(out) == before


def test_two_trainings_do_not_share_a_folder(finished: Path, tmp_path: Path, root: Path) -> None:
    out = tmp_path / "run"
    with locked(out):
        second = subprocess.run(command(out), cwd=root, capture_output=True, text=True)
    said = f"train.py: another training is using {out}: wait for it, or choose another --out\n"
    assert (second.returncode, second.stderr) == (2, said)
    assert [entry.name for entry in out.iterdir()] == [LOCK]
    assert (main(tiny(out)) / WEIGHTS).read_bytes() == (finished / WEIGHTS).read_bytes()


def test_resuming_an_empty_folder_begins(tmp_path: Path, finished: Path) -> None:
    main(tiny(tmp_path, resume=True))
    assert (tmp_path / WEIGHTS).read_bytes() == (finished / WEIGHTS).read_bytes()


def test_other_settings_need_another_folder(finished: Path) -> None:
    with pytest.raises(
        TrainingError,
        match=r"other settings \(difficulty 'uncertain', seed 0\): choose another --out",
    ):
        main(tiny(finished, seed=1, difficulty="known"))
    with pytest.raises(TrainingError, match=rf"other settings \(steps {STEPS}\)"):
        main(tiny(finished, steps=STEPS - 1, resume=True))


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def copied(finished: Path, out: Path, *names: str) -> Path:
    """Some files of a finished run, by default all, in another folder."""
    shutil.copytree(finished, out)
    for entry in list(out.iterdir()) if names else []:
        if entry.name not in names:
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
    return out


@pytest.fixture
def changed_physics(monkeypatch: pytest.MonkeyPatch) -> None:
    code = provenance._code()
    monkeypatch.setattr(provenance, "_code", lambda: code | {"physics": "changed"})


@pytest.mark.usefixtures("changed_physics")
@pytest.mark.parametrize("names", [(), (RUN, LOCK, CHECKPOINT)], ids=["finished", "unfinished"])
@pytest.mark.parametrize("resume", [False, True])
def test_a_run_of_other_code_is_neither_reused_nor_continued(
    finished: Path, tmp_path: Path, names: tuple[str, ...], resume: bool
) -> None:
    out = copied(finished, tmp_path / "run", *names)
    before = contents(out)
    with pytest.raises(
        TrainingError,
        match=r"made before a change of physics: choose another --out, or .* --replace",
    ):
        main(tiny(out, resume=resume))
    assert contents(out) == before


@pytest.mark.usefixtures("changed_physics")
def test_replacing_trains_anew_once_and_says_so(
    finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = copied(finished, tmp_path / "run")
    (out / "notes.txt").write_text("mine")
    for expected in (
        "contained a run with other settings or of other code: removed, training anew",
        "nothing to do",
    ):
        main(tiny(out, resume=True, replace=True))
        assert expected in capsys.readouterr().err
    assert (out / WEIGHTS).read_bytes() == (finished / WEIGHTS).read_bytes()
    assert len(list((out / TENSORBOARD).iterdir())) == 1
    assert (out / "notes.txt").read_text() == "mine"
    assert load_policy(out).description["made_with"]["physics"] == "changed"


def test_a_robot_file_that_changed_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, out = tmp_path / "robot.toml", tmp_path / "run"
    robot.write_text(load_robot("rusti_computer").to_toml())
    main(tiny(out, robot=str(robot), steps=1))
    robot.write_text(robot.read_text().replace('description = "', 'description = "Renamed. '))
    main(tiny(out, robot=str(robot), steps=1))
    heavier = dataclasses.replace(load_robot("rusti_computer"), mass_kg=1.0)
    robot.write_text(heavier.to_toml())
    with pytest.raises(TrainingError, match="made before a change of robot: choose"):
        main(tiny(out, robot=str(robot), steps=1))


@pytest.mark.parametrize(
    ("file", "part"),
    [
        ("physics/model.py", "physics"),
        ("envs/reward.py", "envs"),
        ("agents/learning/ppo.py", "learner"),
        ("agents/belief.py", "learner"),
        ("estimation/filter.py", "learner"),
    ],
)
def test_an_edit_of_the_code_changes_its_hash(
    tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch, file: str, part: str
) -> None:
    package = tmp_path / "homeward"
    shutil.copytree(
        root / "homeward", package, ignore=shutil.ignore_patterns("__pycache__", "recordings")
    )
    monkeypatch.setattr(homeward, "__file__", str(package / "__init__.py"))
    before = provenance._code.__wrapped__()
    with (package / file).open("a") as source:
        source.write("# edited\n")
    after = provenance._code.__wrapped__()
    assert [name for name in before if before[name] != after[name]] == [part]


def test_more_steps_continue_a_finished_run(tmp_path: Path) -> None:
    half = STEPS // 2
    main(tiny(tmp_path, steps=half))
    short = (tmp_path / WEIGHTS).read_bytes()
    with pytest.raises(
        TrainingError, match=f"holds this run, of {half} steps: continue it with --resume"
    ):
        main(tiny(tmp_path))
    main(tiny(tmp_path, resume=True))
    assert (tmp_path / WEIGHTS).read_bytes() != short
    description = load_policy(tmp_path).description
    assert (description["steps"], description["extended_from"]) == (STEPS, [half])
    # none twice, none left out
    assert logged_steps(tmp_path) == [TINY.rollout * update for update in range(1, 9)]
    main(tiny(tmp_path))  # finished


def test_a_run_killed_before_its_policy_was_written_writes_it(
    finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = copied(finished, tmp_path / "run", RUN, CHECKPOINT)
    main(tiny(out, resume=True))
    assert (out / WEIGHTS).read_bytes() == (finished / WEIGHTS).read_bytes()
    assert "nan" not in capsys.readouterr().err


def test_ctrl_c_takes_one_line_and_the_run_goes_on(
    tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    # A shell lets what it starts in the background ignore Ctrl-C, and children inherit that; a
    # handler they do not.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setenv("PYTHONFAULTHANDLER", "1")  # a crash says where
    try:
        process = subprocess.Popen(
            [*command(tmp_path / "run"), "--steps", "10_000_000", "--checkpoints", "5000"], cwd=root,
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
    finally:
        signal.signal(signal.SIGINT, before)
    deadline = time.monotonic() + 120.0
    while (
        not (tmp_path / "run" / CHECKPOINT).is_file()
        and time.monotonic() < deadline
        and process.poll() is None
    ):
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60.0)
    assert (process.returncode, error) == (130, "train.py: interrupted: continue with --resume\n")


def test_a_run_from_dmax_begins_with_the_rule_and_ends_with_what_sees_beliefs(
    tmp_path: Path,
) -> None:
    args = tiny(
        tmp_path, env="homeward/OutAndBack-v0", steps=1, ppo=dataclasses.replace(TINY, start="dmax")
    )
    options = Options("OutAndBack", decision_s=120.0)
    first = load_policy(main(args) / FIRST, known_of(options))
    rule = AGENTS["dmax_belief"](Request(known_of(options)))
    ours, theirs = (measure(policy, options, 0, 0.0) for policy in (first, rule))
    assert ours.score == pytest.approx(theirs.score, rel=0.05)
    assert len(load_policy(tmp_path / LAST).layers[0][0].T) == len(NAMES) + len(COLUMNS)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            "--env homeward/Nowhere-v0",
            "unknown env 'homeward/Nowhere-v0'; choose from homeward/OutAndBack-v0",
        ),
        (
            "--difficulty easy",
            "difficulty = 'easy' is not allowed; choose from known, uncertain, harsh",
        ),
        (
            "--instruments perfect",
            "instruments = 'perfect'; choose exact, meter, gauge, any_gauge or name a TOML file",
        ),
        ("--instruments no/such.toml", "no/such.toml"),
        ("--weather windy", "weather = 'windy' is not allowed; choose from still, changing"),
        ("--randomise wide", "randomise = 'wide' is not allowed; choose from generic, file"),
        ("--robot nobody", "nobody"),
        ("--route nowhere", "route 'nowhere' is neither a known route nor a file"),
        ("--steps 0", "steps = 0 is not allowed; give at least 1"),
        ("--seed -1", "seed = -1 is not allowed; give a whole number from 0 to 4294967295"),
        ("--seed 4294967296", "seed = 4294967296 is not allowed"),
        (
            "--n-envs 1099511627776",
            "n_envs * n_steps = 70368744177664 is not allowed; give at most 16,777,216",
        ),
        ("--checkpoints 0", "checkpoints = 0 is not allowed"),
        ("--batch-size 1000", "batch_size = 1000 does not divide"),
        ("--n-envs 0", "n_envs = 0 is not allowed"),
        ("--learning-rate nan", "learning_rate = nan is not allowed"),
        ("--entropy 2", "entropy = 2.0 is not allowed; give a number in [0, 1]"),
        ("--stranding-cost -1", "stranding_cost = -1.0 is not allowed"),
        ("--start planner", "start = 'planner' is not allowed; choose from scratch, dmax"),
        ("--curve 0", "curve = 0 is not allowed; give at least 1"),
        (
            "--action-type flat",
            "action_type = 'flat' is for learners of one list of actions; train with 'discrete'",
        ),
        ("--discount 1.5", "discount = 1.5 is not allowed"),
    ],
)
def test_bad_input_is_one_line(
    arguments: str,
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        sys, "argv", ["train.py", "--out", str(tmp_path / "run"), *arguments.split()]
    )
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


@pytest.mark.parametrize("missing", ["torch", "stable_baselines3", "tensorboard"])
def test_a_missing_library_says_what_to_install(
    missing: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in [name for name in sys.modules if name.startswith("homeward.agents.learning.ppo")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, missing, None)
    monkeypatch.setattr(sys, "argv", ["train.py", "--out", str(tmp_path / "run")])
    assert run() == 2
    assert (
        capsys.readouterr().err
        == f"train.py: training needs {missing}: pip install 'homeward[train]'\n"
    )


def test_it_learns_to_come_home(tmp_path: Path) -> None:
    ppo = PPOSettings(start="scratch", n_envs=128, n_steps=32, batch_size=512, epochs=8)
    args = Args(
        env="homeward/OutAndBack-v0",
        out=tmp_path,
        difficulty="known",
        steps=64_000,
        decision_s=120.0,
        ppo=ppo,
    )
    main(args)
    first, last = (np.mean(home_rates(tmp_path)[part]) for part in (slice(0, 3), slice(-3, None)))
    assert last > 0.9 > 0.7 > first


def logged(folder: Path, name: str) -> list[Any]:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(folder / TENSORBOARD))
    events.Reload()
    scalars: list[Any] = events.Scalars(name)
    return scalars


def home_rates(folder: Path) -> list[float]:
    return [event.value for event in logged(folder, "missions/home_rate")]


def logged_steps(folder: Path) -> list[int]:
    # Files of one second are read in the order of their processes' numbers.
    return sorted(event.step for event in logged(folder, "time/fps"))


def test_settings_are_written_with_the_run(finished: Path) -> None:
    settings = json.loads((finished / RUN).read_text())["settings"]
    assert settings["n_envs"] == TINY.n_envs
    assert settings["robot"] == "rusti_computer"
