"""`evaluate.py` from its arguments to its files; input that cannot be used takes one line."""

import csv
import errno
import json
import sys
from pathlib import Path

import pytest

import evaluate
from evaluate import Args, main, run

SMALL = ["--episodes", "3", "--agents", "dmax"]


def run_with(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["evaluate.py", *arguments])
    return run()


def test_files_and_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "folder"
    main(Args(agents=("random", "soc50", "dmax_adaptive"), episodes=12, seed=3, out=out))
    assert sorted(path.name for path in out.iterdir()) == [
        "episode.png", "episodes.csv", "evaluation.json", "scores.png",
    ]  # fmt: skip
    content = json.loads((out / "evaluation.json").read_text())
    rows = list(csv.DictReader((out / "episodes.csv").read_text().splitlines()))
    for name, one in content["agents"].items():
        scores = [float(row["score"]) for row in rows if row["agent"] == name]
        assert sum(scores) / 12 == pytest.approx(one["score_mean"])
    shown = capsys.readouterr().out
    for text in ("12 episodes, seed 3", "uncertain, rusti_computer", "numpy", "dmax_adaptive", "minus random"):
        assert text in shown
    assert max(map(len, shown.splitlines())) <= 80 + len(str(out))


def test_twice_the_same_but_for_the_clock(tmp_path: Path) -> None:
    contents = []
    for name in ("a", "b"):
        main(Args(agents=("random", "dmax"), episodes=5, out=tmp_path / name))
        content = json.loads((tmp_path / name / "evaluation.json").read_text())
        for agent in content["agents"].values():
            del agent["decision_us"]
        contents.append(content)
    assert contents[0] == contents[1]
    assert (tmp_path / "a" / "episodes.csv").read_bytes() == (tmp_path / "b" / "episodes.csv").read_bytes()


def test_options_reach_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = {"difficulty": "harsh", "robot": "husky", "route": "hidden_wind", "action_type": "continuous"}
    arguments = [text for name, value in chosen.items() for text in (f"--{name.replace('_', '-')}", value)]
    assert run_with(monkeypatch, *SMALL, "--env", "homeward/OutAndBack-v0", "--out", str(tmp_path), *arguments) == 0
    content = json.loads((tmp_path / "evaluation.json").read_text())
    assert content["env"] == "homeward/OutAndBack-v0"
    assert content["options"].items() >= chosen.items()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--agents", "dmacks"], "unknown agent 'dmacks'; choose from random, soc50"),
        (["--agents", "dmax+shield"], "there is no shield yet in this version"),
        (["--agents", "ppo+shield=somewhere"], "there is no shield yet in this version"),
        (["--agents", "dmax=file"], "dmax takes no file"),
        (["--agents", "dmax", "dmax"], "given twice"),
        (["--agents", "ppo"], "ppo=FOLDER"),
        (["--agents", "ppo=no/such/folder"], "no/such/folder"),
        (["--env", "CartPole-v1"], "unknown env 'CartPole-v1'; choose from homeward/OutAndBack-v0"),
        (["--difficulty", "hard"], "choose from known, uncertain, harsh"),
        (["--robot", "no_such_robot"], "presets: husky"),
        (["--route", "no_such_route"], "known: generated, hidden_wind"),
        (["--action-type", "both"], "choose from discrete, continuous"),
        (["--episodes", "0"], "at least 1 episode"),
        (["--seed", "-1"], "a seed of 0 or more"),
    ],
)
def test_bad_arguments_take_one_line(
    arguments: list[str],
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    assert run_with(monkeypatch, *SMALL, "--out", str(out), *arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("evaluate.py: ")
    assert captured.err.count("\n") == 1
    assert expected in captured.err
    assert not out.exists()


def test_an_output_folder_that_cannot_be_made_takes_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way")
    assert run_with(monkeypatch, *SMALL, "--out", str(tmp_path / "file" / "out")) == 2
    captured = capsys.readouterr().err
    assert captured.count("\n") == 1
    assert "cannot write" in captured
    assert "choose another --out" in captured


def test_a_full_disk_takes_one_line_and_leaves_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(path: Path, content: str | bytes) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(evaluate, "write_whole", full)
    assert run_with(monkeypatch, *SMALL, "--out", str(tmp_path)) == 2
    assert "No space left on device; choose another --out" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
