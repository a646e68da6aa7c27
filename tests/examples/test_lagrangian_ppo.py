"""The Lagrangian example subtracts the multiplier times the cost, and runs from the command
line."""

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.command_line import example_ended

pytest.importorskip("stable_baselines3")


@pytest.fixture(scope="module")
def example(load_example: Callable[[str], Any]) -> Any:
    return load_example("lagrangian_ppo")


def test_a_stranding_costs_the_multiplier(example: Any) -> None:
    args = example.Args(n_envs=16)
    bare, penalised = example.missions(args, 3), example.PenalisedReward(example.missions(args, 3))
    penalised.multiplier = 7.0
    bare.reset()
    penalised.reset()
    onward, stranded = np.tile([4, 4, 1], (16, 1)), 0.0
    for _ in range(150):
        _, free, _, infos = bare.step(onward)
        _, paid, _, _ = penalised.step(onward)
        costs = np.array([info.get("cost", 0.0) for info in infos])
        np.testing.assert_allclose(free - paid, 7.0 * costs, atol=1e-5)
        stranded += costs.sum()
    assert stranded == sum(penalised.costs) >= 16.0


@pytest.mark.parametrize(("stranded", "rises"), [(1.0, True), (0.0, False)])
def test_the_multiplier_follows_the_rate(stranded: float, rises: bool, example: Any) -> None:
    env = example.PenalisedReward(example.missions(example.Args(n_envs=2), 0))
    ascent = example.DualAscent(env, example.Args(limit=0.02, steps=10**9))
    before = env.multiplier
    ascent._on_rollout_end()
    assert env.multiplier == before  # no mission has ended yet
    env.costs.extend([stranded] * 10)
    for _ in range(100):
        ascent._on_rollout_end()
    assert env.multiplier > before if rises else env.multiplier == 0.0


def test_it_learns_to_score_and_not_only_to_stay_safe() -> None:
    """A policy that does nothing strands nowhere: of a penalty alone this is all that is
    learned."""
    code, printed, said = example_ended("lagrangian_ppo", "--steps", "98304", "--episodes", "256")
    assert code == 0, said
    figures = re.search(
        r", 256 unseen missions: stranded ([\d.]+)% .*; score ([\d.]+);", printed.splitlines()[-1]
    )
    assert figures is not None
    stranded_percent, score = map(float, figures.groups())
    assert score > 50.0 and stranded_percent < 20.0


def test_an_unknown_environment_takes_one_line() -> None:
    code, _, said = example_ended("lagrangian_ppo", "--env", "CartPole-v1")
    assert code == 2 and said.count("\n") == 1
    assert said.startswith(
        "lagrangian_ppo.py: unknown env 'CartPole-v1'; choose from homeward/OutAndBack-v0"
    )
