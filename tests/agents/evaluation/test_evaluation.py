"""Episodes are the same for all agents, and what is said of them follows from them."""

import csv
import io
import json
from typing import Any, final

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

from homeward.agents import Policy, make_policy
from homeward.agents.base import Observations
from homeward.agents.evaluation import TRACED, Episodes, Run, episode_seeds, run_episodes
from homeward.agents.evaluation import episodes as evaluation_episodes
from homeward.agents.evaluation.episode_plots import episode_png, route_png, typical_episode
from homeward.agents.evaluation.plots import profiles_png, scores_png
from homeward.agents.evaluation.summary import Bounds, Evaluation
from homeward.envs.actions import encode_actions
from homeward.envs.options import Options, settle
from homeward.envs.state import GO, STOP
from homeward.envs.vector import HomewardVectorEnv

SURVEY = Options("Survey")


@final
class Always(Policy):
    """Commands one mode at top speed, whatever it sees."""

    def __init__(self, mode: int) -> None:
        self.action = encode_actions(settle(SURVEY), [1.0], 0.0, mode)
        self.begun: list[int] = []

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        self.begun.append(int(begun.sum()))
        return np.repeat(self.action, len(observations), axis=0)


def policy(name: str, options: Options = SURVEY) -> Policy:
    return make_policy(name, HomewardVectorEnv(**vars(options)))


def made_up(score: Any, stranded: Any = None) -> Run:
    scores = np.asarray(score, dtype=np.float64)
    lost = np.zeros(len(scores), np.bool_) if stranded is None else np.asarray(stranded, dtype=np.bool_)
    zeros = np.zeros(len(scores))
    episodes = Episodes(scores, ~lost, lost, np.zeros_like(lost), zeros + 5.0, zeros, zeros, zeros.astype(np.int64))
    return Run(
        episodes, 1.0, np.zeros((1, len(scores), len(TRACED)), np.float32), np.zeros((len(scores), 1), np.float32)
    )


def compared(optimum: Bounds | None = None, **runs: Run | list[Run]) -> Evaluation:
    lists = {name: run if isinstance(run, list) else [run] for name, run in runs.items()}
    count = len(next(iter(lists.values()))[0].episodes.score)
    return Evaluation("homeward/Survey-v0", SURVEY, 0, episode_seeds(0, count), lists, optimum)


def test_seeds_are_apart_from_those_of_training_and_from_each_other() -> None:
    seeds = episode_seeds(0, 10_000)
    assert min(seeds) >= 2**63
    assert max(seeds) < 2**64
    assert len(set(seeds)) == 10_000
    assert not set(seeds) & set(episode_seeds(1, 10_000))
    assert episode_seeds(0, 10) == seeds[:10]


def test_an_episode_is_that_of_the_scalar_environment_with_its_seed() -> None:
    for index, seed in enumerate(seeds := episode_seeds(5, 3)):
        env, agent = gym.make("homeward/Survey-v0"), policy("dmax_mapped")
        observation, info = env.reset(seed=seed)
        begun, over, decisions = np.ones(1, np.bool_), False, 0
        while not over:
            action = agent.act(observation[None], begun)[0]
            observation, _, terminated, truncated, info = env.step(action)
            begun, over, decisions = np.zeros(1, np.bool_), terminated or truncated, decisions + 1
        episodes = run_episodes(policy("dmax_mapped"), SURVEY, seeds).episodes
        assert episodes.score[index] == info["score"] * info["home"]
        assert episodes.stranded[index] == info["stranded"]
        assert episodes.decisions[index] == decisions


def test_results_do_not_depend_on_how_many_run_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seeds = episode_seeds(6, 7)
    whole = run_episodes(policy("dmax_adaptive"), SURVEY, seeds)
    monkeypatch.setattr(evaluation_episodes, "SIDE_BY_SIDE", 3)
    parts = run_episodes(policy("dmax_adaptive"), SURVEY, seeds)
    for name in ("score", "home", "energy_left_j", "time_s", "decisions"):
        np.testing.assert_array_equal(getattr(parts.episodes, name), getattr(whole.episodes, name))
    assert whole.traces.shape[1:] == (7, len(TRACED))
    assert parts.traces.shape[1:] == (3, len(TRACED))


def test_agents_are_told_once_that_missions_begin() -> None:
    agent = Always(GO)
    run_episodes(agent, SURVEY, episode_seeds(0, 4))
    assert agent.begun[0] == 4
    assert not any(agent.begun[1:])


def test_a_robot_that_drives_on_is_stranded_and_scores_nothing() -> None:
    run = run_episodes(Always(GO), Options("Survey", difficulty="harsh"), episode_seeds(0, 20))
    steep = run.episodes.timed_out  # nobody drives to the end of a steep way down and still has charge to stand there
    assert not run.episodes.home.any()
    assert (run.episodes.stranded ^ steep).all()
    assert run.episodes.score.tolist() == [0.0] * 20
    assert (run.episodes.energy_left_j[run.episodes.stranded] == 0.0).all()
    assert (run.episodes.furthest_m > 1000.0).all()


def test_running_out_of_time_is_no_stranding_and_scores_nothing() -> None:
    run = run_episodes(Always(STOP), SURVEY, episode_seeds(0, 4))
    assert run.episodes.timed_out.all()
    assert not run.episodes.stranded.any()
    assert run.episodes.score.tolist() == [0.0] * 4
    summary = compared(waits=run).summary()["agents"]["waits"]
    assert (summary["timed_out"], summary["stranded"], summary["energy_left_home_j"]) == (4, 0, None)


def test_traces_begin_full_at_home_and_end_with_the_episode() -> None:
    run = run_episodes(policy("soc50"), SURVEY, episode_seeds(0, 5))
    trace = {name: run.traces[..., column] for column, name in enumerate(TRACED)}
    assert (trace["energy_share"][0] == 1.0).all()
    assert (trace["position_m"][0] == 0.0).all()
    for mission, decisions in enumerate(run.episodes.decisions):
        assert trace["time_s"][decisions, mission] == pytest.approx(run.episodes.time_s[mission])
        assert (np.diff(trace["time_s"][: decisions + 1, mission]) > 0.0).all()
    np.testing.assert_allclose(trace["position_m"].max(axis=0), run.episodes.furthest_m, rtol=0.05)


def test_summary_of_known_scores() -> None:
    rng = np.random.default_rng(0)
    scores = rng.normal(100.0, 10.0, 400)
    lost = np.arange(400) < 20
    one = compared(agent=made_up(np.where(lost, 0.0, scores), lost)).summary()["agents"]["agent"]
    values = np.sort(np.where(lost, 0.0, scores))
    assert one["score_mean"] == pytest.approx(values.mean())
    assert one["score_iqm"] == pytest.approx(values[100:300].mean())
    half_width = 1.96 * values.std() / 20.0  # the normal approximation
    assert one["score_ci95"] == pytest.approx([values.mean() - half_width, values.mean() + half_width], rel=0.01)
    assert (one["stranded"], one["stranded_rate"]) == (20, 0.05)
    z = 1.959964
    centre, half = 0.05 + z**2 / 800.0, z * np.sqrt(0.05 * 0.95 / 400.0 + (z / 800.0) ** 2)  # Wilson, 1927
    wilson = [(centre - half) / (1.0 + z**2 / 400.0), (centre + half) / (1.0 + z**2 / 400.0)]
    assert one["stranded_ci95"] == pytest.approx(wilson, rel=1e-5)
    assert one["share_of_optimum"] is None


def test_pairs_are_compared_on_the_same_resampled_episodes() -> None:
    rng = np.random.default_rng(0)
    hard_and_easy = rng.uniform(0.0, 1000.0, 300)
    better = hard_and_easy + rng.uniform(0.0, 20.0, 300)
    summary = compared(base=made_up(hard_and_easy), same=made_up(hard_and_easy), more=made_up(better)).summary()
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
    summary = compared(a=made_up([3.0]), b=made_up([0.0])).summary()
    assert summary["agents"]["a"]["score_ci95"] is None
    assert summary["paired"]["b - a"] == {
        "mean": -3.0, "ci95": None, "relative": -1.0, "probability_of_improvement": 0.0, "probability_ci95": None,
    }  # fmt: skip


def test_training_seeds_count_as_much_as_episodes() -> None:
    rng = np.random.default_rng(0)
    episodes = rng.normal(100.0, 5.0, 400)
    seeds = [made_up(episodes + offset) for offset in (-10.0, 0.0, 10.0, 20.0)]
    one = compared(agent=seeds, rule=made_up(episodes)).summary()
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
    one = compared(agent=[made_up(np.ones(50), which) for which in lost]).summary()["agents"]["agent"]
    assert (one["stranded"], one["stranded_rate"]) == (5, 0.05)


def test_share_of_the_optimum_is_given_against_both_bounds() -> None:
    bounds = Bounds(np.array([8.0, 12.0]), np.array([10.0, 15.0]))
    summary = compared(bounds, agent=made_up([5.0, 10.0])).summary()
    assert summary["agents"]["agent"]["share_of_optimum"] == pytest.approx(0.75)
    assert summary["agents"]["agent"]["share_of_optimum_at_least"] == pytest.approx(0.6)
    assert summary["optimum"] == {"lower": 10.0, "upper": 12.5}


def test_profiles_say_what_share_of_episodes_scores_more() -> None:
    profiles = compared(a=made_up([0.0, 50.0, 100.0, 100.0]), b=made_up([20.0, 20.0, 20.0, 20.0])).summary()["profiles"]
    assert profiles["score"][0] == 0.0 and profiles["score"][-1] == 100.0
    at = {name: dict(zip(profiles["score"], profiles[name], strict=True)) for name in ("a", "b")}
    assert (at["a"][0.0], at["a"][50.0], at["a"][100.0]) == (0.75, 0.5, 0.0)
    assert (at["b"][19.0], at["b"][20.0]) == (1.0, 0.0)


def test_json_holds_what_the_schema_names() -> None:
    runs = {name: run_episodes(policy(name), SURVEY, episode_seeds(0, 6)) for name in ("soc50", "dmax")}
    result = compared(None, **runs)
    content = json.loads(result.to_json(result.summary()))
    assert set(content) >= {"schema", "env", "options", "episodes", "seed", "versions", "agents", "paired"}
    assert (content["schema"], content["env"], content["episodes"], content["seed"]) == (1, "homeward/Survey-v0", 6, 0)
    assert content["options"]["difficulty"] == "uncertain"
    assert {"homeward", "numpy", "gymnasium"} <= set(content["versions"])
    assert set(content["agents"]) == {"soc50", "dmax"}
    assert set(content["agents"]["dmax"]) >= {
        "score_mean", "score_ci95", "score_iqm", "stranded", "stranded_rate", "stranded_ci95", "energy_left_home_j",
        "share_of_optimum", "decision_us",
    }  # fmt: skip
    assert set(content["paired"]["dmax - soc50"]) >= {"mean", "ci95", "relative"}


def test_csv_has_a_row_per_agent_and_episode() -> None:
    runs = {name: run_episodes(policy(name), SURVEY, episode_seeds(0, 6)) for name in ("soc50", "dmax")}
    rows = list(csv.DictReader(io.StringIO(compared(None, **runs).to_csv())))
    assert [(row["agent"], int(row["episode"])) for row in rows] == [
        (a, k) for a in ("soc50", "dmax") for k in range(6)
    ]
    assert [int(row["seed"]) for row in rows] == 2 * episode_seeds(0, 6)
    assert [float(row["score"]) for row in rows[6:]] == runs["dmax"].episodes.score.tolist()
    assert {row["home"] for row in rows} <= {"0", "1"}


@pytest.mark.parametrize("mission", ["OutAndBack", "Survey", "Patrol"])
def test_pictures_are_drawn(mission: str) -> None:
    options = Options(mission, difficulty="harsh")
    runs = {name: run_episodes(policy(name, options), options, episode_seeds(0, 8)) for name in ("random", "dmax")}
    result = Evaluation(
        f"homeward/{mission}-v0", options, 0, episode_seeds(0, 8), {name: [run] for name, run in runs.items()}
    )
    summary = result.summary()
    for picture in (
        scores_png(result, summary), profiles_png(result, summary), episode_png(result), route_png(result)
    ):  # fmt: skip
        assert picture.startswith(b"\x89PNG")


def test_the_picture_shows_a_middling_episode() -> None:
    assert typical_episode(compared(a=made_up([9.0, 1.0, 5.0]), b=made_up([8.0, 0.0, 6.0]))) == 2
    assert typical_episode(compared(a=made_up([0.0, 0.0, 9.0]), b=made_up([5.0, 6.0, 7.0]))) == 1
