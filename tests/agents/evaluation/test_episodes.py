"""Episodes are the same for all agents, and their outcome does not depend on how many run at
once."""

from typing import Any, final

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

from homeward.agents import Policy
from homeward.agents.base import Observations
from homeward.agents.evaluation import TRACE_COLUMNS, episode_seeds, run_episodes
from homeward.agents.evaluation import episodes as evaluation_episodes
from homeward.envs.actions import encode_actions
from homeward.envs.options import Options, known_of
from homeward.envs.state import GO, STOP
from tests.agents.evaluation.runs import SURVEY, policy, summarised


@final
class Always(Policy):
    """Commands one mode at top speed, whatever it sees."""

    def __init__(self, mode: int) -> None:
        self.action = encode_actions(known_of(SURVEY), [1.0], 0.0, mode)
        self.begun: list[int] = []

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        self.begun.append(int(begun.sum()))
        return np.repeat(self.action, len(observations), axis=0)


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
    assert whole.traces.shape[1:] == (7, len(TRACE_COLUMNS))
    assert parts.traces.shape[1:] == (3, len(TRACE_COLUMNS))


def test_agents_are_told_once_that_missions_begin() -> None:
    agent = Always(GO)
    run_episodes(agent, SURVEY, episode_seeds(0, 4))
    assert agent.begun[0] == 4
    assert not any(agent.begun[1:])


def test_a_robot_that_drives_on_is_stranded_and_scores_nothing() -> None:
    run = run_episodes(Always(GO), Options("Survey", difficulty="harsh"), episode_seeds(0, 20))
    # nobody drives to the end of a steep way down and still has charge to stand there
    steep = run.episodes.timed_out
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
    summary = summarised(waits=run)["agents"]["waits"]
    assert (summary["timed_out"], summary["stranded"], summary["energy_left_home_j"]) == (
        4,
        0,
        None,
    )


def test_traces_begin_full_at_home_and_end_with_the_episode() -> None:
    run = run_episodes(policy("soc50"), SURVEY, episode_seeds(0, 5))
    trace = {name: run.traces[..., column] for column, name in enumerate(TRACE_COLUMNS)}
    assert (trace["energy_share"][0] == 1.0).all()
    assert (trace["position_m"][0] == 0.0).all()
    for mission, decisions in enumerate(run.episodes.decisions):
        assert trace["time_s"][decisions, mission] == pytest.approx(run.episodes.time_s[mission])
        assert (np.diff(trace["time_s"][: decisions + 1, mission]) > 0.0).all()
    np.testing.assert_allclose(trace["position_m"].max(axis=0), run.episodes.furthest_m, rtol=0.05)
