"""What ships is the policy that did best on its curve, with a card that tells of it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.agents.ship import Args, main
from homeward.agents.evaluation.learning_curve import Point, read_curve, write_curve
from homeward.agents.trained.inputs import COLUMNS, make_inputs
from homeward.agents.trained.policy_file import PolicyFileError, load_policy, save_policy
from homeward.envs.actions import action_space
from homeward.envs.features import NAMES
from homeward.envs.options import Options, known_of

NAMED = (
    "first_greedy", "first_sampled", "last_greedy", "last_sampled",
    "dmax", "dmax_mapped", "dmax_adaptive", "dmax_belief", "planner",
)  # fmt: skip
COMPARED = ("minus_first", "minus_rule", "minus_planner", "last_minus_first", "last_minus_rule")
ROW: dict[str, Any] = {
    "mission": "Survey", "start": "dmax", "seeds": 2, "episodes": 2000, "score": 1250.0,
    "score_by_seed": [1240.0, 1260.0], "stranded_by_seed": [0.005, 0.015], "sampled": 1230.0,
    "sampled_stranded_rate": 0.02, "rule": "dmax_adaptive", "stranded_rate": 0.01, "stranded_ci95": [0.007, 0.014],
    **{name: 1000.0 for name in NAMED}, **{f"{name}_stranded_rate": 0.03 for name in NAMED},
    **{name: 50.0 for name in COMPARED}, **{f"{name}_ci95": [40.0, 60.0] for name in COMPARED},
}  # fmt: skip


def write_run(folder: Path, start: str, seed: int, score: float) -> None:
    inputs = make_inputs(known_of(Options("Survey"))) if start == "dmax" else None
    columns = len(NAMES) + (len(COLUMNS) if inputs else 0)
    layers = [
        (np.full((rows, seen), float(seed), np.float32), np.zeros(rows, np.float32))
        for rows, seen in ((4, columns), (13, 4 + columns))
    ]
    training = {"seed": seed, "hidden": 64, "difficulty": "uncertain", "robot": "rusti_computer"}
    details = {
        "env": "homeward/Survey-v0", "training": training, "steps": 3000, "after_steps": 3000, "decision_s": 30.0,
        "command": "benchmarks/agents/learn.py", "versions": {"homeward": "0.1.0"},
    }  # fmt: skip
    save_policy(folder, layers, action_space(True), details, inputs)
    write_curve(folder, [Point(0, 0.0, 900.0, 0.05, 0.0), Point(3000, 12.0, score, 0.01, 0.0)])


def test_the_best_on_its_curve_is_shipped_with_a_card(tmp_path: Path) -> None:
    for start in ("dmax", "scratch"):
        for seed, score in enumerate((1230.0, 1220.0)):
            write_run(tmp_path / "runs" / f"Survey-{start}-{seed}", start, seed, score)
    (tmp_path / "runs" / "learn.json").write_text(json.dumps([ROW, {**ROW, "start": "scratch"}]))
    main(Args(tmp_path / "runs", tmp_path / "out"))
    assert sorted(folder.name for folder in (tmp_path / "out").iterdir()) == [
        "Survey",
        "Survey_scratch",
    ]
    shipped = tmp_path / "out" / "Survey"
    policy, card = load_policy(shipped), (shipped / "card.md").read_text()
    assert policy.description["training"]["seed"] == 0
    assert read_curve(shipped)[-1].score == 1230.0
    assert policy.description["weights_sha256"][:16] in card
    for expected in (
        "on the belief: a posterior of the robot",
        "`benchmarks/agents/learn.py`, seed 0",
        "this policy scores 1240 and strands in 0.50%",
        "minus the first policy +50 (+40 to +60)",
        "last minus the best of the three d_max rules that do not estimate the robot, `dmax_adaptive` +50 (+40 to +60)",
        "| first policy, sampled | 1000 | 3.00% |",
        "| last policy, greedy, all seeds | 1000 | 3.00% |",
        "| `ppo`, sampled, all seeds | 1230 | 2.00% |",
        "| 3,000 |",
    ):
        assert expected in card.replace("\n  ", " "), expected
    assert "# ppo_scratch, Survey" in (tmp_path / "out" / "Survey_scratch" / "card.md").read_text()


def test_nothing_to_ship_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(
        PolicyFileError, match=r"holds no learn.json: run benchmarks/agents/learn.py first"
    ):
        main(Args(tmp_path, tmp_path / "out"))
