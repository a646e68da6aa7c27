"""What ships is the policy that did best on its curve, with a card that tells of it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.ship import Args, main
from homeward.agents.learning.curve import Point, read_curve, write_curve
from homeward.agents.learning.guide import make_guide
from homeward.agents.trained.policy_file import PolicyFileError, load_policy, save_policy
from homeward.envs.actions import action_space
from homeward.envs.features import NAMES
from homeward.envs.options import Options, known_of

ROW: dict[str, Any] = {
    "mission": "Survey", "difficulty": "uncertain", "variant": "recipe", "seeds": 2, "episodes": 2000,
    "score": 1250.0, "score_by_seed": [1240.0, 1260.0], "rule": "dmax_adaptive", "rule_score": 1200.0,
    "gain": 50.0, "gain_ci95": [40.0, 60.0], "stranded_rate": 0.01, "stranded_ci95": [0.007, 0.014],
    "rule_stranded_rate": 0.03,
}  # fmt: skip


def write_run(folder: Path, seed: int, score: float) -> None:
    options = Options("Survey")
    guide = make_guide("planner", "Survey", known_of(options))
    assert guide is not None
    layers = [
        (np.full((rows, columns), float(seed), np.float32), np.zeros(rows, np.float32))
        for rows, columns in ((4, len(NAMES) + guide.extra), (13, 4 + guide.proposals))
    ]
    training = {"seed": seed, "hidden": 64, "difficulty": "uncertain", "robot": "rusti_computer"}
    details = {
        "env": "homeward/Survey-v0", "training": training, "steps": 3000, "best_after_steps": 3000, "decision_s": 30.0,
        "command": "benchmarks/learn.py", "versions": {"homeward": "0.1.0"},
    }  # fmt: skip
    save_policy(folder, layers, action_space(True), details, guide)
    write_curve(folder, [Point(0, 0.0, 900.0, 0.05, 0.0), Point(3000, 12.0, score, 0.01, 0.0)])


def test_the_best_on_its_curve_is_shipped_with_a_card(tmp_path: Path) -> None:
    for seed, score in enumerate((1230.0, 1220.0)):
        write_run(tmp_path / "runs" / f"Survey-uncertain-recipe-{seed}", seed, score)
    rows = [ROW, {**ROW, "variant": "no shaping"}, {**ROW, "difficulty": "known"}]
    (tmp_path / "runs" / "learn.json").write_text(json.dumps(rows))
    main(Args(tmp_path / "runs", tmp_path / "out"))
    (shipped,) = (tmp_path / "out").iterdir()
    policy, card = load_policy(shipped), (shipped / "card.md").read_text()
    assert policy.description["training"]["seed"] == 0
    assert read_curve(shipped)[-1].score == 1230.0
    assert policy.description["weights_sha256"][:16] in card
    for told in (
        "on what `planner` believes",
        "`benchmarks/learn.py`, seed 0",
        "scores 1240",
        "+50 (+40 to +60",
        "1.00% (0.70% to 1.40%)",
        "| 3,000 |",
    ):
        assert told in card.replace("\n  ", " ")


def test_nothing_to_ship_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(PolicyFileError, match=r"holds no learn.json: run benchmarks/learn.py first"):
        main(Args(tmp_path, tmp_path / "out"))
