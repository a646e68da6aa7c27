"""Agents come out the same whether their episodes run one after the other or in other processes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from homeward.agents import evaluation_tasks, make_policy
from homeward.agents.evaluation import Episodes, episode_seeds, run_episodes
from homeward.agents.evaluation_tasks import run_agents
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv


def test_outcomes_do_not_depend_on_where_they_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluation_tasks, "EPISODES_A_TASK", 16)
    options, seeds = Options("OutAndBack"), episode_seeds(3, 40)
    env = HomewardVectorEnv(**vars(options))
    agents = {name: [make_policy(name, env, seed=1)] for name in ("random", "soc50", "dmax_adaptive")}
    alone, together = (run_agents(agents, options, seeds, jobs=jobs) for jobs in (1, 2))
    straight = run_episodes(make_policy("dmax_adaptive", env), options, seeds)
    for name in agents:
        for field in dataclasses.fields(Episodes):
            outcome = getattr(alone[name][0].episodes, field.name)
            assert outcome.shape == (40,)
            np.testing.assert_array_equal(outcome, getattr(together[name][0].episodes, field.name))
    np.testing.assert_array_equal(alone["dmax_adaptive"][0].episodes.score, straight.episodes.score)
    np.testing.assert_array_equal(alone["dmax_adaptive"][0].traces, together["dmax_adaptive"][0].traces)
