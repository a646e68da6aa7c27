"""Runs to evaluate: of agents by name, and made up of scores."""

from typing import Any

import numpy as np

from homeward.agents import Policy, make_policy
from homeward.agents.evaluation import TRACE_COLUMNS, Episodes, Run, episode_seeds
from homeward.agents.evaluation.summary import Evaluation, Optima
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv

SURVEY = Options("Survey")


def policy(name: str, options: Options = SURVEY) -> Policy:
    return make_policy(name, HomewardVectorEnv(**vars(options)))


def made_up(score: Any, stranded: Any = None) -> Run:
    scores = np.asarray(score, dtype=np.float64)
    lost = (
        np.zeros(len(scores), np.bool_)
        if stranded is None
        else np.asarray(stranded, dtype=np.bool_)
    )
    zeros = np.zeros(len(scores))
    episodes = Episodes(
        scores, ~lost, lost, np.zeros_like(lost), zeros + 5.0, zeros, zeros, zeros.astype(np.int64)
    )
    return Run(
        episodes,
        1.0,
        np.zeros((1, len(scores), len(TRACE_COLUMNS)), np.float32),
        np.zeros((len(scores), 1), np.float32),
    )


def compared(optimum: Optima | None = None, **runs: Run | list[Run]) -> Evaluation:
    lists = {name: run if isinstance(run, list) else [run] for name, run in runs.items()}
    count = len(next(iter(lists.values()))[0].episodes.score)
    return Evaluation("homeward/Survey-v0", SURVEY, 0, episode_seeds(0, count), lists, optimum)


def summarised(optimum: Optima | None = None, **runs: Run | list[Run]) -> dict[str, Any]:
    return compared(optimum, **runs).summary(np.random.default_rng(0))
