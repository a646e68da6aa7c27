"""What is said of episodes follows from them."""

import csv
import io
import json

import numpy as np
import pytest

from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.evaluation.summary import Optima
from tests.agents.evaluation.runs import SURVEY, compared, made_up, policy, summarised


def test_summary_of_known_scores() -> None:
    rng = np.random.default_rng(0)
    scores = rng.normal(100.0, 10.0, 400)
    lost = np.arange(400) < 20
    one = summarised(agent=made_up(np.where(lost, 0.0, scores), lost))["agents"]["agent"]
    values = np.sort(np.where(lost, 0.0, scores))
    assert one["score_mean"] == pytest.approx(values.mean())
    assert one["score_iqm"] == pytest.approx(values[100:300].mean())
    half_width = 1.96 * values.std() / 20.0  # the normal approximation
    assert one["score_ci95"] == pytest.approx(
        [values.mean() - half_width, values.mean() + half_width], rel=0.01
    )
    assert (one["stranded"], one["stranded_rate"]) == (20, 0.05)
    z = 1.959964
    # Wilson, 1927
    centre, half = 0.05 + z**2 / 800.0, z * np.sqrt(0.05 * 0.95 / 400.0 + (z / 800.0) ** 2)
    wilson = [(centre - half) / (1.0 + z**2 / 400.0), (centre + half) / (1.0 + z**2 / 400.0)]
    assert one["stranded_ci95"] == pytest.approx(wilson, rel=1e-5)
    assert one["share_of_optimum"] is None


def test_pairs_are_compared_on_the_same_resampled_episodes() -> None:
    rng = np.random.default_rng(0)
    hard_and_easy = rng.uniform(0.0, 1000.0, 300)
    better = hard_and_easy + rng.uniform(0.0, 20.0, 300)
    summary = summarised(
        base=made_up(hard_and_easy), same=made_up(hard_and_easy), more=made_up(better)
    )
    assert list(summary["paired"]) == ["same - base", "more - base", "more - same"]
    same = summary["paired"]["same - base"]
    assert (same["mean"], same["ci95"], same["relative"], same["probability_of_improvement"]) == (
        0.0,
        [0.0, 0.0],
        0.0,
        0.5,
    )
    assert same["probability_ci95"] == pytest.approx([0.5, 0.5])
    assert summary["paired"]["more - base"]["probability_of_improvement"] == 1.0
    gain = summary["paired"]["more - base"]
    low, high = gain["ci95"]
    assert gain["mean"] == pytest.approx((better - hard_and_easy).mean())
    assert gain["relative"] == pytest.approx(gain["mean"] / hard_and_easy.mean())
    assert 8.0 < low < gain["mean"] < high < 12.0  # unpaired it would span 90
    wide_low, wide_high = summary["agents"]["more"]["score_ci95"]
    assert wide_high - wide_low > 10.0 * (high - low)


def test_one_episode_has_no_interval() -> None:
    summary = summarised(a=made_up([3.0]), b=made_up([0.0]))
    assert summary["agents"]["a"]["score_ci95"] is None
    assert summary["paired"]["b - a"] == {
        "mean": -3.0, "ci95": None, "relative": -1.0, "probability_of_improvement": 0.0, "probability_ci95": None,
    }  # fmt: skip


def test_training_seeds_count_as_much_as_episodes() -> None:
    rng = np.random.default_rng(0)
    episodes = rng.normal(100.0, 5.0, 400)
    seeds = [made_up(episodes + offset) for offset in (-10.0, 0.0, 10.0, 20.0)]
    one = summarised(agent=seeds, rule=made_up(episodes))
    agent, gain = one["agents"]["agent"], one["paired"]["rule - agent"]
    assert agent["training_seeds"] == 4
    assert agent["score_mean"] == pytest.approx(episodes.mean() + 5.0)
    low, high = agent["score_ci95"]
    assert high - low > 10.0  # that of the episodes alone would be 1
    assert gain["mean"] == pytest.approx(-5.0)
    assert gain["ci95"][0] < -8.0 and gain["ci95"][1] > 0.0
    assert gain["probability_of_improvement"] == pytest.approx((1.0 + 0.5) / 4.0)


def test_strandings_of_all_training_seeds_count() -> None:
    lost = [np.arange(50) < count for count in (1, 4)]
    one = summarised(agent=[made_up(np.ones(50), which) for which in lost])["agents"]["agent"]
    assert (one["stranded"], one["stranded_rate"]) == (5, 0.05)


def test_share_of_the_optimum_is_given_against_both_bounds() -> None:
    bounds = Optima(np.array([8.0, 12.0]), np.array([10.0, 15.0]))
    summary = summarised(bounds, agent=made_up([5.0, 10.0]))
    assert summary["agents"]["agent"]["share_of_optimum"] == pytest.approx(0.75)
    assert summary["agents"]["agent"]["share_of_optimum_at_least"] == pytest.approx(0.6)
    assert summary["optimum"] == {"lower": 10.0, "upper": 12.5}


def test_no_share_of_an_optimum_of_nothing() -> None:
    """Where nothing can be scored, rounding may leave the upper bound below 0."""
    bounds = Optima(np.zeros(2), np.array([0.0, -1e-15]))
    agent = summarised(bounds, agent=made_up([0.0, 0.0]))["agents"]["agent"]
    assert agent["share_of_optimum"] is agent["share_of_optimum_at_least"] is None


def test_profiles_say_what_share_of_episodes_scores_more() -> None:
    profiles = summarised(
        a=made_up([0.0, 50.0, 100.0, 100.0]), b=made_up([20.0, 20.0, 20.0, 20.0])
    )["profiles"]
    assert profiles["score"][0] == 0.0 and profiles["score"][-1] == 100.0
    at = {name: dict(zip(profiles["score"], profiles[name], strict=True)) for name in ("a", "b")}
    assert (at["a"][0.0], at["a"][50.0], at["a"][100.0]) == (0.75, 0.5, 0.0)
    assert (at["b"][19.0], at["b"][20.0]) == (1.0, 0.0)


def test_json_holds_what_the_schema_names() -> None:
    runs = {
        name: run_episodes(policy(name), SURVEY, episode_seeds(0, 6)) for name in ("soc50", "dmax")
    }
    result = compared(None, **runs)
    content = json.loads(result.to_json(result.summary(np.random.default_rng(0))))
    assert set(content) >= {
        "schema",
        "env",
        "options",
        "episodes",
        "seed",
        "versions",
        "agents",
        "paired",
    }
    assert (content["schema"], content["env"], content["episodes"], content["seed"]) == (
        1,
        "homeward/Survey-v0",
        6,
        0,
    )
    assert content["options"]["difficulty"] == "uncertain"
    assert {"homeward", "numpy", "gymnasium"} <= set(content["versions"])
    assert set(content["agents"]) == {"soc50", "dmax"}
    assert set(content["agents"]["dmax"]) >= {
        "score_mean", "score_ci95", "score_iqm", "stranded", "stranded_rate", "stranded_ci95", "energy_left_home_j",
        "share_of_optimum", "decision_us",
    }  # fmt: skip
    assert set(content["paired"]["dmax - soc50"]) >= {"mean", "ci95", "relative"}


def test_csv_has_a_row_per_agent_and_episode() -> None:
    runs = {
        name: run_episodes(policy(name), SURVEY, episode_seeds(0, 6)) for name in ("soc50", "dmax")
    }
    rows = list(csv.DictReader(io.StringIO(compared(None, **runs).to_csv())))
    assert [(row["agent"], int(row["episode"])) for row in rows] == [
        (a, k) for a in ("soc50", "dmax") for k in range(6)
    ]
    assert [int(row["seed"]) for row in rows] == 2 * episode_seeds(0, 6)
    assert [float(row["score"]) for row in rows[6:]] == runs["dmax"].episodes.score.tolist()
    assert {row["home"] for row in rows} <= {"0", "1"}
