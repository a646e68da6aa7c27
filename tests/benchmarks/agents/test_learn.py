"""The benchmark of learning: its figures, and that nothing is trained or driven twice."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.agents import learn
from benchmarks.agents.learn import Args, Driven, Result, Sampled, main, summary
from homeward.agents.learning.settings import TrainingError
from homeward.agents.registry import AGENTS, Request
from homeward.agents.trained.policy_file import NetworkPolicy
from homeward.envs.actions import action_space
from homeward.envs.features import NAMES
from homeward.envs.options import Options, known_of


@pytest.mark.usefixtures("short_curves")
def test_a_run_trains_compares_and_is_kept(tmp_path: Path) -> None:
    args = Args(
        out=tmp_path, missions=("Patrol",), starts=("scratch",), seeds=1, steps=1, episodes=8
    )
    (first,) = main(args)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.npz")}
    before |= {path: path.stat().st_mtime_ns for path in tmp_path.rglob("policy.*")}
    (again,) = main(args)
    assert before == {path: path.stat().st_mtime_ns for path in before}
    np.testing.assert_array_equal(first.best["sampled"].score, again.best["sampled"].score)
    (row,) = json.loads((tmp_path / "learn.json").read_text())
    assert (row["mission"], row["start"], row["seeds"], row["episodes"]) == (
        "Patrol",
        "scratch",
        1,
        8,
    )


def test_what_is_kept_of_one_mission_is_not_taken_for_another(tmp_path: Path) -> None:
    scores = []
    for mission in ("OutAndBack", "Patrol"):
        options = Options(mission)
        policy = AGENTS["dmax"](Request(known_of(options)))
        scores.append(
            learn.driven(Args(out=tmp_path), options, policy, b"dmax", [1, 2, 3]).score.mean()
        )
    assert scores[0] > 10.0 * scores[1]


def driven(score: object, stranded: object) -> Driven:
    return Driven(np.array(score, np.float64), np.array(stranded, np.bool_))


def test_figures_of_a_result() -> None:
    rule, never = np.array([100.0, 0.0, 100.0, 0.0]), [False] * 4
    best = driven(np.stack([rule + 10.0, rule + 20.0]), [never, [True, *never[1:]]])
    others = {name: driven(rule - 5.0, never) for name in ("dmax", "dmax_mapped", "dmax_belief")}
    others |= {
        "dmax_adaptive": driven(rule, [False, True, False, True]),
        "planner": driven(rule + 30.0, never),
    }
    first = {"greedy": driven(rule + 1.0, never), "sampled": driven(rule, never)}
    ends = driven(np.stack([rule - 9.0, rule - 19.0]), [[True, *never[1:]]] * 2)
    both, last = {"greedy": best, "sampled": best}, {"greedy": ends, "sampled": ends}
    row = summary(Result("Survey", "dmax", first, both, last, others, [2.0, 2.0]))
    assert (row["rule"], row["score"], row["dmax_adaptive"]) == ("dmax_adaptive", 65.0, 50.0)
    assert (row["minus_rule"], row["minus_first"], row["minus_planner"]) == (15.0, 14.0, -15.0)
    assert row["minus_rule_ci95"] == [10.0, 20.0]
    assert (row["last_greedy"], row["last_minus_first"], row["last_greedy_stranded_rate"]) == (
        36.0,
        -15.0,
        0.25,
    )
    assert row["last_minus_first_ci95"] == [-20.0, -10.0]
    assert (row["last_minus_rule"], row["last_minus_rule_ci95"]) == (-14.0, [-19.0, -9.0])
    assert (row["stranded_rate"], row["dmax_adaptive_stranded_rate"]) == (0.125, 0.5)


def test_a_sampled_policy_draws_with_the_probabilities_of_the_logits() -> None:
    bias = np.log([0.7, 0.1, 0.1, 0.05, 0.05, 0.2, 0.2, 0.2, 0.2, 0.2, 0.1, 0.6, 0.3]).astype(
        np.float32
    )
    layers = ((np.zeros((13, len(NAMES)), np.float32), bias),)
    policy = Sampled(NetworkPolicy(layers, action_space(True), {}), 0)
    actions = policy.act(np.zeros((4000, len(NAMES)), np.float32), np.ones(4000, np.bool_))
    assert (actions[:, 0] == 0).mean() == pytest.approx(0.7, abs=0.03)
    assert (actions[:, 2] == 2).mean() == pytest.approx(0.3, abs=0.03)


def test_too_little_to_compare_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="give at least 1 seed and 2 episodes"):
        main(Args(out=tmp_path, seeds=0))
