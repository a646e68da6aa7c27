"""The Lagrangian example subtracts the multiplier times the cost, and runs from the command line."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

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


def test_it_runs_from_the_command_line(root: Path) -> None:
    arguments = ["--steps", "4096", "--n-envs", "32", "--episodes", "32"]
    done = subprocess.run(
        [sys.executable, str(root / "examples" / "lagrangian_ppo.py"), *arguments], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "32 unseen missions: stranded" in done.stdout.splitlines()[-1]


def test_an_unknown_environment_takes_one_line(root: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(root / "examples" / "lagrangian_ppo.py"), "--env", "CartPole-v1"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("lagrangian_ppo.py: unknown env 'CartPole-v1'; choose from homeward/OutAndBack-v0")


def test_it_learns_to_score_and_not_only_to_stay_safe(example: Any) -> None:
    """A policy that does nothing strands nowhere: of a penalty alone this is all that is learned."""
    args = example.Args(steps=131_072, episodes=256)
    stranded, episodes, score = example.evaluate(example.train(args)[0], args)
    assert score > 50.0 and stranded < 0.2 * episodes
