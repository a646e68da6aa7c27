"""The benchmark of learning: its figures, and that nothing is trained twice."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.learn import (
    Args,
    Result,
    gap_cell,
    gap_closed_interval,
    interval,
    main,
    over_missions,
    reached_s,
    summary,
)
from homeward.agents.learning.curve import Point
from homeward.agents.learning.settings import TrainingError

CURVE = [Point(0, 0.0, 90.0, 0.1, 0.0), Point(10, 1.0, 101.0, 0.0, 0.0), Point(20, 2.0, 110.0, 0.0, 0.0)]


def test_a_run_trains_compares_and_is_kept(tmp_path: Path) -> None:
    args = Args(out=tmp_path, missions=("OutAndBack",), seeds=1, steps=1, episodes=20)
    (first,) = main(args)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("policy.*")}
    (again,) = main(args)
    assert before == {path: path.stat().st_mtime_ns for path in tmp_path.rglob("policy.*")}
    np.testing.assert_array_equal(first.score, again.score)
    (row,) = json.loads((tmp_path / "learn.json").read_text())
    assert (row["mission"], row["variant"], row["seeds"], row["episodes"]) == ("OutAndBack", "recipe", 1, 20)
    assert (tmp_path / "learn.png").stat().st_size > 1000


def test_figures_of_a_result() -> None:
    rule = np.array([100.0, 0.0, 100.0, 0.0])
    row = summary(
        Result(
            "Survey", "uncertain", "recipe",
            np.stack([rule + 10.0, rule + 20.0]), np.array([[False] * 4, [True] + [False] * 3]),
            (CURVE, CURVE[:2]), "dmax", rule, np.array([False, True, False, True]), 100.0, np.array([130.0, 30.0]),
        )
    )  # fmt: skip
    assert (row["gain"], row["score"], row["rule_score"]) == (15.0, 65.0, 50.0)
    assert row["gain_ci95"] == [10.0, 20.0]
    assert (row["stranded_rate"], row["rule_stranded_rate"]) == (0.125, 0.5)
    assert row["gap_closed"] == pytest.approx(15.0 / 30.0)
    assert row["gap_closed_ci95"] == pytest.approx((10.0 / 30.0, 20.0 / 30.0))
    assert row["reaches_rule_s"] == [1.0, 1.0]
    assert row["final_level_s"] == [2.0, 1.0]


def test_a_share_of_a_gap_has_an_interval_and_hardly_a_gap_has_neither() -> None:
    rule, rng = np.full(400, 100.0), np.random.default_rng(1)
    gap = rng.normal(20.0, 5.0, 400)
    low, high = gap_closed_interval(np.stack([0.5 * gap] * 3), gap)
    assert low == pytest.approx(0.5) == high  # paired: gain and gap rise and fall together
    low, high = gap_closed_interval(rng.normal(10.0, 5.0, (3, 400)), gap)
    assert low < 0.5 < high and high - low < 0.1
    nobody = np.zeros((1, 400), np.bool_)
    row = summary(
        Result(
            "Patrol", "uncertain", "recipe", rule[None], nobody, (CURVE,), "dmax", rule, nobody[0], 100.0, rule + 0.05
        )
    )
    assert (row["gap_closed"], gap_cell(row)) == (None, "no gap")


def test_a_score_that_is_not_reached_has_no_time() -> None:
    assert reached_s(CURVE, 100.0) == 1.0
    assert reached_s(CURVE, 111.0) is None


def test_the_interval_holds_the_spread_of_seeds_and_of_episodes() -> None:
    rng = np.random.default_rng(1)
    same = interval(np.tile(rng.normal(0.0, 1.0, 400), (3, 1)))
    apart = interval(np.array([[-1.0], [0.0], [1.0]]) + rng.normal(0.0, 1.0, 400))
    assert same[1] - same[0] == pytest.approx(2 * 1.96 / 20.0, rel=0.2)
    assert apart[1] - apart[0] > 1.0
    assert interval(np.ones((1, 5))) == (1.0, 1.0)


def test_too_little_to_compare_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="give at least 1 seed and 2 episodes"):
        main(Args(out=tmp_path, seeds=0))


def test_what_is_gained_over_missions_is_the_mean_of_shares_of_the_rules_scores() -> None:
    rule, nobody = np.full(50, 10.0), np.zeros((2, 50), np.bool_)
    results = [
        Result(
            mission,
            "known",
            "recipe",
            np.stack([rule + gain] * 2),
            nobody,
            (CURVE,),
            "dmax",
            rule,
            nobody[0],
            1.0,
            None,
        )
        for mission, gain in (("Survey", 2.0), ("Patrol", 1.0))
    ]
    assert over_missions(results) == (
        "known, mean over Survey, Patrol: +15.0% of the best rule's score (+15.0% to +15.0%, stratified bootstrap)"
    )
