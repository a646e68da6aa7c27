"""`evaluate.py` from its arguments to its files; input that cannot be used takes one line."""

import csv
import dataclasses
import errno
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import evaluate
import train
from evaluate import Args, main, run
from homeward import load_robot
from homeward.agents.evaluation import tasks as evaluation_tasks
from homeward.agents.evaluation.learning_curve import EvaluatedCurve, best_so_far, read_curve
from homeward.agents.learning.settings import PPOSettings
from homeward.agents.registry import SWEPT
from homeward.agents.trained.policy_file import DESCRIPTION

SMALL = ["--episodes", "3", "--agents", "dmax"]
PICTURES = ("scores_png", "profiles_png", "episode_png", "route_png")


@pytest.fixture(autouse=True)
def hardly_any_pictures(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Empty pictures but where a test looks for them: to draw takes longer than to drive."""
    if request.function is not test_files_and_table:
        for name in PICTURES:
            monkeypatch.setattr(evaluate, name, lambda *_: b"")


def run_with(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["evaluate.py", *arguments])
    return run()


def test_docks_of_the_command_line_are_those_of_the_environment() -> None:
    given: dict[str, Any] = {
        "env": "homeward/Patrol-v0",
        "docks": "120:20,0:15",
        "time_limit": 9_000.0,
    }
    for options in (evaluate._options(Args(**given)), train._options(train.Args(**given))):
        assert options.docks == ((0.0, 15.0), (120.0, 20.0)) and options.time_limit_s == 9_000.0


def test_files_and_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "folder"
    main(Args(agents=("random", "soc50", "dmax_adaptive"), episodes=12, seed=3, out=out))
    assert sorted(path.name for path in out.iterdir()) == [
        "episode.png", "episodes.csv", "evaluation.json", "profiles.png", "route.png", "scores.png",
    ]  # fmt: skip
    assert all(picture.read_bytes().startswith(b"\x89PNG") for picture in out.glob("*.png"))
    content = json.loads((out / "evaluation.json").read_text())
    rows = list(csv.DictReader((out / "episodes.csv").read_text().splitlines()))
    for name, one in content["agents"].items():
        scores = [float(row["score"]) for row in rows if row["agent"] == name]
        assert sum(scores) / 12 == pytest.approx(one["score_mean"])
    shown = capsys.readouterr().out
    for text in (
        "12 episodes, seed 3",
        "uncertain, rusti_computer",
        "numpy",
        "dmax_adaptive",
        "minus random",
    ):
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
    assert (tmp_path / "a" / "episodes.csv").read_bytes() == (
        tmp_path / "b" / "episodes.csv"
    ).read_bytes()


def test_the_number_of_jobs_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation_tasks, "SIDE_BY_SIDE", 8)  # so that there are several tasks
    for jobs in (1, 2):
        main(
            Args(agents=("random", "dmax+shield"), episodes=20, jobs=jobs, out=tmp_path / str(jobs))
        )
    alone, together = ((tmp_path / str(jobs) / "episodes.csv").read_bytes() for jobs in (1, 2))
    assert alone == together


def test_an_agent_that_fails_takes_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*arguments: object) -> None:
        raise FloatingPointError("no\nnumber")

    monkeypatch.setattr(evaluation_tasks, "run_episodes", fail)
    assert run_with(monkeypatch, *SMALL, "--out", str(tmp_path)) == 2
    expected = (
        "evaluate.py: dmax, training seed 0, episodes from 0: FloatingPointError: no number\n"
    )
    assert capsys.readouterr().err == expected


def test_options_reach_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chosen: dict[str, str | float] = {
        "difficulty": "harsh", "instruments": "meter", "weather": "still", "robot": "husky", "route": "hidden_wind",
        "action_type": "continuous",
        "decision_s": 120.0,
    }  # fmt: skip
    arguments = [
        text
        for name, value in chosen.items()
        for text in (f"--{name.replace('_', '-')}", str(value))
    ]
    assert (
        run_with(
            monkeypatch,
            *SMALL,
            "--env",
            "homeward/OutAndBack-v0",
            "--out",
            str(tmp_path),
            *arguments,
        )
        == 0
    )
    content = json.loads((tmp_path / "evaluation.json").read_text())
    assert content["env"] == "homeward/OutAndBack-v0"
    assert content["options"].items() >= chosen.items()


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"soc_step = 2.0", "soc_step = 2.0 is not allowed; give a number in"),
        (b"power_gian = 0.1", "unknown size 'power_gian'; allowed: soc_step"),
        (b"soc_step = ", "Invalid value"),
        (b"\xff\xfe", "codec can't decode"),
    ],
)
def test_a_bad_file_of_instruments_takes_one_line(
    content: bytes,
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "mine.toml"
    file.write_bytes(content)
    assert (
        run_with(monkeypatch, *SMALL, "--out", str(tmp_path / "out"), "--instruments", str(file))
        == 2
    )
    error = capsys.readouterr().err
    assert error.startswith(f"evaluate.py: {file}: ") and error.count("\n") == 1
    assert expected in error
    assert not (tmp_path / "out").exists()


def test_instruments_come_from_a_file(tmp_path: Path) -> None:
    left = []
    for name, sizes in (("none", ""), ("coarse", "soc_step = 0.2\nsoc_noise = 0.1\n")):
        file = tmp_path / f"{name}.toml"
        file.write_text(sizes)
        args = Args(
            ("soc50",),
            "homeward/OutAndBack-v0",
            episodes=12,
            instruments=str(file),
            out=tmp_path / name,
        )
        left.append(main(args).runs["soc50"][0].episodes.energy_left_j)
    exact = Args(
        ("soc50",),
        "homeward/OutAndBack-v0",
        episodes=12,
        instruments="exact",
        out=tmp_path / "exact",
    )
    assert (left[0] == main(exact).runs["soc50"][0].episodes.energy_left_j).all()
    assert left[1].std() > left[0].std()


def test_a_sweep_writes_curves(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    agents = ("random", "soc50", "dmax_belief", "soc50+shield")
    result = main(
        Args(
            agents,
            "homeward/OutAndBack-v0",
            episodes=6,
            margins=True,
            decision_s=120.0,
            out=tmp_path,
        )
    )
    assert (tmp_path / "margins.png").read_bytes().startswith(b"\x89PNG")
    curves = json.loads((tmp_path / "margins.json").read_text())
    assert list(curves) == list(agents)
    for name, curve in curves.items():
        assert set(curve) == {"reserve", "score", "stranded"}
        assert len(curve["reserve"]) == len(curve["score"]) == len(curve["stranded"])
        assert all(0.0 <= share <= 1.0 for share in curve["stranded"]), name
    means = {
        name: one["score_mean"]
        for name, one in json.loads((tmp_path / "evaluation.json").read_text())["agents"].items()
    }
    assert curves["random"] == {"reserve": [None], "score": [means["random"]], "stranded": [0.0]}
    assert curves["soc50"]["reserve"] == list(SWEPT["soc50"])
    assert curves["soc50"]["score"][curves["soc50"]["reserve"].index(0.5)] == pytest.approx(
        means["soc50"]
    )
    assert curves["dmax_belief"]["score"][SWEPT["dmax_belief"].index(3.0)] == pytest.approx(
        means["dmax_belief"]
    )
    assert curves["soc50+shield"]["reserve"] == [10.0**-k for k in range(1, 9)]
    shown = " ".join(capsys.readouterr().out.split())
    assert "at a stranding rate of at most" in shown and "margins.json" in shown
    assert result.runs["soc50"][0].episodes.home.any()


def test_without_a_sweep_there_are_no_curves(tmp_path: Path) -> None:
    main(Args(("soc50",), episodes=2, decision_s=120.0, out=tmp_path))
    assert not list(tmp_path.glob("margins*"))


def test_decisions_come_as_often_as_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    decisions = []
    for decision_s in (60.0, 120.0):
        args = Args(
            ("dmax",), "homeward/OutAndBack-v0", episodes=20, out=tmp_path, decision_s=decision_s
        )
        decisions.append(main(args).runs["dmax"][0].episodes.decisions.sum())
        assert f"discrete actions every {decision_s:g} s" in capsys.readouterr().out
    assert decisions[0] == pytest.approx(2 * decisions[1], rel=0.1)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy of hardly any training: every 120 s, without shaping."""
    tiny = PPOSettings(n_envs=16, n_steps=16, batch_size=128, epochs=1, hidden=8)
    out = tmp_path_factory.mktemp("trained") / "run"
    return train.main(
        train.Args(out=out, steps=tiny.rollout, ppo=tiny, decision_s=120.0, shaping="none")
    )


@pytest.mark.parametrize(
    ("arguments", "met"),
    [
        (["--decision-s", "120"], []),
        ([], ["decision_s 30 (trained with 120)"]),
        (["--decision-s", "60"], ["decision_s 60 (trained with 120)"]),
        (
            ["--decision-s", "120", "--env", "homeward/OutAndBack-v0"],
            ["env homeward/OutAndBack-v0 (trained with homeward/Survey-v0)"],
        ),
        (
            [
                "--decision-s",
                "120",
                "--robot",
                "husky",
                "--difficulty",
                "harsh",
                "--route",
                "hidden_wind",
            ],
            [
                "route hidden_wind (trained with generated)",
                "difficulty harsh (trained with uncertain)",
                "robot husky (trained with rusti_computer)",
            ],
        ),
    ],
)
def test_a_policy_that_meets_another_environment_is_said_to(
    arguments: list[str],
    met: list[str],
    trained: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    agents = ["--agents", "soc50", f"ppo={trained}"]
    assert (
        run_with(monkeypatch, *agents, "--episodes", "2", "--out", str(tmp_path), *arguments) == 0
    )
    transfer = (
        f"evaluate.py: warning: ppo meets {', '.join(met)}; its figures are those of a transfer\n"
    )
    assert capsys.readouterr().err == (transfer if met else "")
    assert (tmp_path / "evaluation.json").is_file()


def test_a_robot_is_known_by_its_numbers(
    trained: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    file = tmp_path / "rusti_computer.toml"
    arguments = [
        "--agents",
        f"ppo={trained}",
        "--episodes",
        "2",
        "--decision-s",
        "120",
        "--out",
        str(tmp_path),
    ]
    file.write_text(load_robot("rusti_computer").to_toml())
    assert run_with(monkeypatch, *arguments, "--robot", str(file)) == 0
    assert capsys.readouterr().err == ""
    file.write_text(dataclasses.replace(load_robot("rusti_computer"), mass_kg=1.0).to_toml())
    assert run_with(monkeypatch, *arguments, "--robot", str(file)) == 0
    assert f"robot {file} (trained with rusti_computer)" in capsys.readouterr().err


def test_decision_times_that_follow_from_the_robots_are_not_remarked_on(
    trained: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = tmp_path / "policy"
    shutil.copytree(trained, folder)
    description = json.loads((folder / DESCRIPTION).read_text())
    description["training"]["decision_s"], description["decision_s"] = None, 30.0
    (folder / DESCRIPTION).write_text(json.dumps(description))
    arguments = ["--agents", f"ppo={folder}", "--episodes", "2", "--out", str(tmp_path / "out")]
    assert run_with(monkeypatch, *arguments) == 0
    assert capsys.readouterr().err == ""
    assert run_with(monkeypatch, *arguments, "--robot", "husky") == 0
    error = capsys.readouterr().err
    assert "robot husky" in error and "decision_s" not in error


def test_a_shielded_agent_stands_beside_the_bare_one(tmp_path: Path) -> None:
    result = main(Args(agents=("dmax_mapped", "dmax_mapped+shield"), episodes=6, out=tmp_path))
    assert list(result.runs) == ["dmax_mapped", "dmax_mapped+shield"]
    assert result.runs["dmax_mapped+shield"][0].episodes.stranded.sum() == 0
    assert (
        "dmax_mapped+shield - dmax_mapped"
        in json.loads((tmp_path / "evaluation.json").read_text())["paired"]
    )


@pytest.mark.parametrize("form", ["list", "folder"])
def test_several_training_seeds_are_one_agent(form: str, trained: Path, tmp_path: Path) -> None:
    folders = [tmp_path / "seeds" / name for name in ("0", "1")]
    for folder in folders:
        shutil.copytree(trained, folder)
    file = ",".join(map(str, folders)) if form == "list" else str(tmp_path / "seeds")
    main(Args(agents=("soc50", f"ppo={file}"), episodes=3, decision_s=120.0, out=tmp_path / "out"))
    agents = json.loads((tmp_path / "out" / "evaluation.json").read_text())["agents"]
    assert (agents["ppo"]["training_seeds"], agents["soc50"]["training_seeds"]) == (2, 1)
    rows = list(csv.DictReader((tmp_path / "out" / "episodes.csv").read_text().splitlines()))
    assert [(row["run"], row["episode"]) for row in rows[3:]] == [
        (run, str(k)) for run in "01" for k in range(3)
    ]
    assert [row["score"] for row in rows[3:6]] == [row["score"] for row in rows[6:]]


def test_a_label_names_an_agent_and_the_curve_ends_at_its_level(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A policy that got worse after half of its training: the run kept the better one."""
    tiny = PPOSettings(start="scratch", n_envs=16, n_steps=16, batch_size=128, epochs=1, hidden=8)
    run_folder = tmp_path / "run"
    train.main(
        train.Args(out=run_folder, steps=9 * tiny.rollout, curve=9, ppo=tiny, decision_s=120.0)
    )
    points = read_curve(run_folder)
    kept = json.loads((run_folder / DESCRIPTION).read_text())["after_steps"]
    assert points[best_so_far(points)[-1]].steps == kept
    drawn: dict[str, list[EvaluatedCurve]] = {}
    monkeypatch.setattr(evaluate, "learning_png", lambda *given: drawn.update(given[2]) or b"")
    agents = ("dmax", f"mine:ppo={run_folder}", f"its start:ppo={run_folder / 'first'}")
    result = main(Args(agents=agents, episodes=6, decision_s=120.0, out=tmp_path / "out"))
    assert list(result.runs) == ["dmax", "mine", "its start"]
    (curve,) = drawn.pop("mine")
    assert drawn == {}
    means = {label: runs[0].episodes.score.mean() for label, runs in result.runs.items()}
    assert (curve.best_so_far[0].score, curve.best_so_far[-1].score) == (
        means["its start"],
        means["mine"],
    )
    assert [point.steps for point in curve.present] == [point.steps for point in points]
    for folder in (run_folder / "curve").iterdir():
        (folder / DESCRIPTION).unlink()
    capsys.readouterr()
    main(Args(agents=agents, episodes=2, decision_s=120.0, out=tmp_path / "out"))
    assert (
        f"{run_folder} lacks policies of its learning curve, as older runs do"
        in capsys.readouterr().err
    )


def test_the_optimum_is_found_where_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    env = "homeward/OutAndBack-v0"
    result = main(Args(("dmax",), env, episodes=2, optimum=True, decision_s=120.0, out=tmp_path))
    assert result.optimum is not None
    assert (result.runs["dmax"][0].episodes.score <= result.optimum.upper).all()
    one = json.loads((tmp_path / "evaluation.json").read_text())["agents"]["dmax"]
    assert 0.0 <= one["share_of_optimum_at_least"] <= one["share_of_optimum"]
    assert "optimum" in capsys.readouterr().out
    header = (tmp_path / "episodes.csv").read_text().splitlines()[0]
    assert header.endswith("optimum_lower,optimum_upper")


def test_spaces_that_do_not_fit_are_refused(
    trained: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    arguments = [
        "--agents",
        f"ppo={trained}",
        "--action-type",
        "continuous",
        "--out",
        str(tmp_path / "out"),
    ]
    assert run_with(monkeypatch, *arguments) == 2
    assert "choose the action_type that it was trained with" in capsys.readouterr().err


def test_a_policy_is_evaluated_without_the_libraries_it_was_trained_with(
    trained: Path, tmp_path: Path
) -> None:
    code = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name in ("torch", "stable_baselines3", "tensorboard"):
            raise ModuleNotFoundError(name=name)

sys.meta_path.insert(0, Missing())
import evaluate
sys.exit(evaluate.run())
"""
    arguments = [
        "--agents",
        f"ppo={trained}",
        "--episodes",
        "2",
        "--decision-s",
        "120",
        "--out",
        str(tmp_path),
    ]
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--agents", "dmacks"], "unknown agent 'dmacks'; choose from random, soc50"),
        (["--agents", "dmax+shild"], "unknown agent 'dmax+shild'"),
        (["--agents", "ppo+shield=no/such/folder"], "no/such/folder"),
        (["--agents", "dmax+shield=file"], "dmax takes no file"),
        (["--optimum", "--action-type", "continuous"], "the oracle acts on a grid"),
        (["--agents", "dmax=file"], "dmax takes no file"),
        (["--agents", "dmax", "dmax"], "given twice"),
        (["--agents", "mine:dmax", "mine:soc50"], "an agent or a label is given twice"),
        (["--agents", ":dmax"], ":dmax has an empty label: give LABEL:NAME, or NAME alone"),
        (
            ["--agents", "dmax", "--action-type", "flat"],
            "three parts of an action, not its flat number",
        ),
        (["--agents", "ppo=no/such/folder"], "no/such/folder"),
        (["--env", "CartPole-v1"], "unknown env 'CartPole-v1'; choose from homeward/OutAndBack-v0"),
        (["--difficulty", "hard"], "choose from known, uncertain, harsh"),
        (["--robot", "no_such_robot"], "presets: f1tenth, husky"),
        (["--route", "no_such_route"], "known: generated, hidden_wind"),
        (["--action-type", "both"], "choose from discrete, continuous"),
        (["--decision-s", "0"], "decision_s = 0.0 is not allowed"),
        (["--decision-s", "nan"], "decision_s = nan is not allowed"),
        (["--episodes", "0"], "give 1 to 1,000,000 episodes"),
        (["--episodes", "9223372036854775807"], "give 1 to 1,000,000 episodes"),
        (["--seed", "-1"], "a seed of 0 or more"),
        (
            ["--instruments", "perfect"],
            "instruments = 'perfect'; choose exact, meter, gauge, any_gauge or name a TOML file",
        ),
        (["--instruments", "no/such.toml"], "no/such.toml"),
        (["--weather", "windy"], "weather = 'windy' is not allowed; choose from still, changing"),
        (["--randomise", "wide"], "randomise = 'wide' is not allowed; choose from generic, file"),
        (["--jobs", "0"], "jobs = 0 is not allowed; give 1 to "),
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
