"""Sweeps and fleets: the same results in one process and in several, and resumed where they
stopped."""

from __future__ import annotations

import csv
import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from homeward import __main__ as command
from homeward import load_robot
from homeward.agents.evaluation.learning_curve import Point, read_curve, write_curve
from homeward.agents.learning.settings import DivergedError, TrainingError
from homeward.agents.trained.run_folder import CHECKPOINT, PREVIOUS, RUN
from homeward.commands import fleet, sweep, train
from homeward.diagnosis import Diagnosis, RecordingError
from homeward.diagnosis.result import RecordingInfo
from homeward.parallel import TaskError
from homeward.search import SearchError
from tests.parallel_cases import SETTINGS, STEPS, policies, write_recording


def test_a_sweep_is_every_setting_with_every_seed(tmp_path: Path) -> None:
    base = train.Args(out=tmp_path, ppo=SETTINGS)
    runs = sweep.runs_of(
        sweep.Args((0, 1), ("learning_rate=1e-3,1e-2", "start=scratch,dmax"), train=base)
    )
    assert {name: (run.ppo.learning_rate, run.ppo.start, run.seed) for name, run in runs.items()} == {
        f"learning_rate={rate}_start={start}/seed_{seed}": (rate, start, seed)
        for rate in (0.001, 0.01) for start in ("scratch", "dmax") for seed in (0, 1)
    }  # fmt: skip
    assert all(
        run.out == tmp_path / name and run.ppo.hidden == SETTINGS.hidden
        for name, run in runs.items()
    )


def test_a_sweep_trains_the_same_policies_wherever_it_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("stable_baselines3")

    def args(jobs: int) -> sweep.Args:
        base = train.Args(steps=STEPS, out=tmp_path / str(jobs), ppo=SETTINGS, curve=1)
        return sweep.Args((0,), ("learning_rate=1e-3,1e-2",), jobs=jobs, train=base)

    for jobs in (1, 2):
        sweep.main(args(jobs))
    alone, together = policies(tmp_path / "1"), policies(tmp_path / "2")
    assert list(alone) == [
        f"learning_rate={rate}/seed_0/policy.safetensors" for rate in ("0.001", "0.01")
    ]
    assert len(set(alone.values())) == 2
    assert together == alone
    files = {file: file.stat().st_mtime_ns for file in (tmp_path / "1").rglob("policy.safetensors")}
    sweep.main(args(1))
    # finished: nothing is trained anew
    assert {file: file.stat().st_mtime_ns for file in files} == files
    capsys.readouterr()
    sweep.main(args(1))
    printed = capsys.readouterr()
    assert (tmp_path / "1" / sweep.PLOT).read_bytes().startswith(b"\x89PNG")
    assert "too few" not in printed.err
    for rate in ("0.001", "0.01"):
        points = read_curve(tmp_path / "1" / f"learning_rate={rate}" / "seed_0")
        (row,) = (
            line.split()
            for line in printed.out.splitlines()
            if line.split()[:1] == [f"learning_rate={rate}"]
        )
        assert row[1:3] == ["1", f"{points[-1].score:.4g}"]
    (tmp_path / "1" / "learning_rate=0.01" / "seed_0" / "curve.csv").unlink()
    with pytest.raises(
        TrainingError, match=r"learning_rate=0.01/seed_0 has no learning curve any more"
    ):
        sweep.main(args(1))


def test_seeds_without_varied_settings_are_one_row_and_too_few_steps_are_said_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    points = [
        Point(0, 0.0, 9.0, 0.0, 0.0),
        Point(64, 1.0, 5.0, 0.5, 0.0),
        Point(128, 2.0, 3.0, 0.0, 0.0),
    ]

    def trained(args: train.Args) -> Path:
        write_curve(
            args.out,
            [dataclasses.replace(point, score=point.score + args.seed) for point in points],
        )
        return args.out

    monkeypatch.setattr(sweep, "train_quietly", trained)
    sweep.main(
        sweep.Args((0, 1), train=train.Args(steps=6 * SETTINGS.rollout, out=tmp_path, ppo=SETTINGS))
    )
    printed = capsys.readouterr()
    assert printed.err.count("384 steps are too few to learn anything") == 1
    (row,) = (
        line.split() for line in printed.out.splitlines() if line.split()[:2] == ["as", "given"]
    )
    assert row[2:] == ["2", "5.5", "5", "to", "6", "50.0%", "3.5"]


def searched(out: Path, **changes: Any) -> sweep.Args:
    """A search of four trials of one seed."""
    base = train.Args(steps=STEPS // 2, out=out, ppo=SETTINGS, curve=1, decision_s=120.0)
    space = ("learning_rate=1e-4..1e-2", "epochs=1..2", "start=scratch")
    return dataclasses.replace(sweep.Args((0,), space, optuna=4, train=base), **changes)


def trials_of(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / sweep.TRIALS).read_text().splitlines()))


@pytest.mark.usefixtures("short_curves")
def test_a_search_that_was_killed_goes_on_with_the_same_trials(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("optuna")
    pytest.importorskip("stable_baselines3")
    sweep.main(searched(tmp_path / "whole"))
    printed = capsys.readouterr()
    rows = trials_of(tmp_path / "whole")
    assert [row["trial"] for row in rows] == ["0", "1", "2", "3"]
    assert len({row["learning_rate"] for row in rows}) == 4
    for row in rows:
        folder = tmp_path / "whole" / f"trial_{row['trial']}" / "seed_0"
        settings = json.loads((folder / RUN).read_text())["settings"]
        assert [settings["learning_rate"], settings["epochs"]] == [
            float(row["learning_rate"]),
            int(row["epochs"]),
        ]
        assert float(row["score"]) == max(
            point.score for point in read_curve(folder) if point.steps
        )
        # but at the end there is no checkpoint, so that a kill leaves none
        assert not (folder / PREVIOUS).exists()
    best = max(rows, key=lambda row: float(row["score"]))
    shown = [
        words for line in printed.out.splitlines() if (words := line.split()) and words[0].isdigit()
    ]
    assert [words[0] for words in shown] == sorted(
        "0123", key=lambda one: -float(rows[int(one)]["score"])
    )
    assert (
        f"best: --learning-rate {best['learning_rate']} --epochs {best['epochs']} --start scratch"
        in printed.err
    )

    def killed_in_trial_2(options: Any, *given: Any, **more: Any) -> Any:
        trained = train_for_real(options, *given, **more)
        if "trial_2" in str(given[3]):
            # as it is found after a kill on the way
            for name in ("policy.json", "policy.safetensors", CHECKPOINT):
                (given[3] / name).unlink()
            raise KeyboardInterrupt
        return trained

    from homeward.agents.learning import ppo

    train_for_real = ppo.train
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(ppo, "train", killed_in_trial_2)
        sweep.main(searched(tmp_path / "killed"))
    first = (tmp_path / "killed" / "trial_0" / "seed_0" / "policy.safetensors").stat().st_mtime_ns
    sweep.main(searched(tmp_path / "killed"))
    assert (tmp_path / "killed" / sweep.TRIALS).read_text() == (
        tmp_path / "whole" / sweep.TRIALS
    ).read_text()
    assert policies(tmp_path / "killed") == policies(tmp_path / "whole")
    assert (
        tmp_path / "killed" / "trial_0" / "seed_0" / "policy.safetensors"
    ).stat().st_mtime_ns == first
    with pytest.raises(
        TaskError, match=r"trial_0/seed_0: .*holds a run with other settings .*choose another --out"
    ):
        sweep.main(searched(tmp_path / "killed", vary=("learning_rate=1e-5..1e-2",)))


def test_a_trial_that_diverges_does_not_end_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("optuna")

    def diverge(args: train.Args) -> Path:
        raise DivergedError("the weights are not finite any more")

    monkeypatch.setattr(sweep, "train_quietly", diverge)
    with pytest.raises(TrainingError, match="no trial ended with weights that are finite"):
        sweep.main(searched(tmp_path))
    assert [row["score"] for row in trials_of(tmp_path)] == ["nan"] * 4


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"optuna": None},
            r"--vary learning_rate=1e-4\.\.1e-2: a range is searched with --optuna N",
        ),
        ({"optuna": 0}, "optuna = 0 is not allowed; give at least 1"),
        ({"vary": ()}, r"--optuna searches what --vary names: give NAME=LOW\.\.HIGH"),
        ({"vary": ("clip=0.3..0.1",)}, r"--vary clip=0\.3\.\.0\.1: 0\.3\.\.0\.1 is no range"),
        ({"vary": ("clip=0.1..a",)}, "give float values, as clip=0.2"),
        ({"vary": ("clip=0.1..2",)}, "clip = 2.0 is not allowed"),
        ({"vary": ("epochs=0..3",)}, "epochs = 0 is not allowed"),
        (
            {"vary": ("start=scratch..dmax",)},
            "is not searched between ends; give values, as start=dmax",
        ),
        (
            {"vary": ("batch_size=8..64",)},
            "is not searched between ends; give values, as batch_size=4096",
        ),
        ({"vary": ("batch_size=32,48",)}, "batch_size = 48 does not divide"),
        ({"vary": ("clip=0.1..0.2", "clip=0.2..0.3")}, "names a setting twice"),
    ],
)
def test_a_bad_search_is_refused(given: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises((TrainingError, SearchError), match=message):
        sweep.main(searched(tmp_path / "new", **given))
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"vary": ("speed=1",)}, "there is no setting 'speed'; choose from"),
        ({"vary": ("clip=a",)}, "give float values, as clip=0.2"),
        ({"vary": ("clip=2",)}, "clip = 2.0 is not allowed"),
        (
            {"vary": ("start=planner",)},
            "start = 'planner' is not allowed; choose from scratch, dmax",
        ),
        ({"vary": ("clip=0.1,0.10",)}, "gives clip=0.1/seed_0 twice; give each value once"),
        ({"seeds": (1, 1)}, "give each seed once"),
        ({"seeds": ()}, "give each seed once, and at least one"),
    ],
)
def test_a_bad_sweep_is_refused(given: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match=message):
        sweep.main(sweep.Args(**given, train=train.Args(out=tmp_path / "new")))
    assert not (tmp_path / "new").exists()


def test_a_node_that_does_not_see_the_folder_says_so(tmp_path: Path) -> None:
    with pytest.raises(
        TrainingError, match="not visible from this node: give an --out that all nodes share"
    ):
        sweep.train_quietly(train.Args(out=tmp_path / "elsewhere" / "seed_0"))


@pytest.fixture
def garage(tmp_path: Path) -> Path:
    """Two robots: one as its file says, and one with a file of its own and more on board."""
    write_recording(tmp_path / "fleet" / "as_filed" / "run.csv", payload=0.0)
    write_recording(tmp_path / "fleet" / "loaded" / "run.csv", payload=0.5, seed=1)
    (tmp_path / "fleet" / "loaded" / "robot.toml").write_text(load_robot("rusti").to_toml())
    return tmp_path / "fleet"


def test_a_fleet_is_diagnosed_the_same_wherever_it_runs(garage: Path, tmp_path: Path) -> None:
    alone = fleet.main(fleet.Args(garage, robot="rusti", out=tmp_path / "1"))
    together = fleet.main(fleet.Args(garage, robot="rusti", out=tmp_path / "2", jobs=2))
    assert list(alone) == ["as_filed", "loaded"]
    assert {name: one.to_json() for name, one in together.items()} == {name: one.to_json() for name, one in alone.items()}  # fmt: skip  # noqa: E501
    for name in alone:
        files = {file.name for file in (tmp_path / "1" / name).iterdir()}
        assert files == {
            "diagnosis.json", "report.html", "corrected.toml", "series.parquet", "series.mcap", fleet.KEY,
        }  # fmt: skip
    with (tmp_path / "1" / "fleet.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["robot"], row["verdict"]) for row in rows] == [
        (name, one.verdict) for name, one in alone.items()
    ]


NOTHING_TO_TEST = Diagnosis("rusti", (), "not_testable", "nothing was usable").to_json().encode()
AS_FILED = Diagnosis(
    "rusti", (RecordingInfo("run.csv", "0", 60.0, 600),), "no_mismatch", "all is as the file says"
)


def test_a_fleet_of_which_nothing_is_usable_says_so_when_all_is_written(
    garage: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet, "diagnose_one", lambda case: {fleet.DIAGNOSIS: NOTHING_TO_TEST})
    with pytest.raises(
        RecordingError, match=r"no recording of any robot can be used: .*fleet.csv says why"
    ):
        fleet.main(fleet.Args(garage, robot="rusti", out=tmp_path / "out"))
    assert (tmp_path / "out" / "fleet.csv").read_text().count("nothing was usable") == 2


def test_only_what_has_changed_is_diagnosed_again(
    garage: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked: list[str] = []

    def note(case: fleet.Member) -> dict[str, bytes]:
        asked.append(case.recordings[0].sha256)
        return {fleet.DIAGNOSIS: AS_FILED.to_json().encode()}

    monkeypatch.setattr(fleet, "diagnose_one", note)
    args = fleet.Args(garage, robot="rusti", out=tmp_path / "out")
    fleet.main(args)
    write_recording(garage / "loaded" / "run.csv", payload=0.5, seed=2)
    fleet.main(args)
    assert len(asked) == len(set(asked)) == 3
    assert "2 robots diagnosed, 1 of them before" in capsys.readouterr().out


def test_what_was_done_before_a_failure_is_kept(
    garage: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    def fail_later(case: fleet.Member) -> dict[str, bytes]:
        if (tmp_path / "out" / "as_filed").is_dir():
            raise RuntimeError("no memory")
        return {fleet.DIAGNOSIS: AS_FILED.to_json().encode()}

    monkeypatch.setattr(fleet, "diagnose_one", fail_later)
    with pytest.raises(TaskError, match=r"^loaded: RuntimeError: no memory"):
        fleet.main(fleet.Args(garage, robot="rusti", out=tmp_path / "out"))
    assert (tmp_path / "out" / "as_filed" / fleet.KEY).is_file()
    assert not (tmp_path / "out" / "loaded").exists()


def test_how_recordings_of_a_fleet_were_read_is_said(
    garage: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:  # fmt: skip
    file = garage / "loaded" / "run.csv"
    file.write_text(file.read_text().replace(",", ";"))
    fleet.members_of(fleet.Args(garage, robot="rusti", out=tmp_path / "out"))
    assert capsys.readouterr().err == "loaded/run.csv: read with cells separated by semicolons\n"


def test_a_folder_of_tables_is_one_run_of_a_robot(
    garage: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:  # fmt: skip
    run = garage / "loaded" / "run"
    run.mkdir()
    whole = pd.read_csv(garage / "loaded" / "run.csv")
    power = [name for name in whole if name in ("power_w", "voltage_v", "current_a")]
    whole.drop(columns=power).to_csv(run / "odom.csv", index=False)
    whole[["time_s", *power]].to_csv(run / "power.csv", index=False)
    args = fleet.Args(garage, robot="rusti", out=tmp_path / "out")
    joined, alone = fleet.members_of(args)["loaded"].recordings
    assert joined.channels.keys() == alone.channels.keys() and len(joined) == len(alone)
    assert "loaded/run: tables of one run are joined: " in capsys.readouterr().err
    (run / "odom.csv").unlink()
    (run / "power.csv").unlink()
    with pytest.raises(RecordingError, match="contains no table of a run"):
        fleet.members_of(args)


def test_a_fleet_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"cannot read .*give a folder of folders"):
        fleet.main(fleet.Args(tmp_path / "nowhere", out=tmp_path / "out"))
    with pytest.raises(RecordingError, match="contains no folder"):
        fleet.main(fleet.Args(tmp_path, out=tmp_path / "out"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match="contains no recording"):
        fleet.main(fleet.Args(tmp_path, out=tmp_path / "out"))


@pytest.mark.parametrize("name", ["evaluate", "sweep", "fleet"])
def test_a_cluster_that_does_not_answer_takes_one_line(
    name: str,
    garage: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("ray")
    given = {
        "evaluate": ["--agents", "dmax"],
        "sweep": [],
        "fleet": [str(garage), "--robot", "rusti"],
    }[name]
    out = tmp_path / "out"
    monkeypatch.setattr(
        sys, "argv", ["homeward", name, *given, "--cluster", "127.0.0.1:1", "--out", str(out)]
    )
    assert command.run() == 2
    captured = capsys.readouterr()
    assert captured.err == (
        f"homeward {name}: no Ray cluster answers at '127.0.0.1:1': give HOST:PORT as `ray start --head` printed it\n"
    )
    assert (captured.out, out.exists()) == ("", False)
