"""The examples of other stacks run as a reader runs them, with few steps, and their parts agree
with homeward's."""

from __future__ import annotations

import csv
import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import yaml  # type: ignore[import-untyped]

from homeward.agents import Policy, make_policy
from homeward.envs import IDS
from tests.command_line import example_ended

EXAMPLES = Path(__file__).parents[2] / "examples"


def lines_of(name: str, *arguments: str) -> list[str]:
    """Lines that an example prints, in this process."""
    code, printed, said = example_ended(name, *arguments)
    assert code == 0, said
    return printed.splitlines()


def run_example(name: str, *arguments: str, folder: Path, **environment: str) -> list[str]:
    """Lines that an example prints, in a process of its own: what it starts there would stay in
    this one."""
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / f"{name}.py"), *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        env=os.environ | environment,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_cleanrl() -> None:
    pytest.importorskip("torch")
    lines = lines_of("cleanrl_ppo", "--steps", "32768", "--num-envs", "128")
    assert [int(line.split(" steps")[0].replace(",", "")) for line in lines] == [
        8192,
        16384,
        24576,
        32768,
    ]
    # no mission ends within the first 64 decisions
    assert "nan" in lines[0] and "nan" not in "".join(lines[1:])
    for line in lines[1:]:
        home, stranded = (float(line.split(name)[1].split("%")[0]) for name in ("home", "stranded"))
        assert 0.0 < home + stranded <= 100.1
        assert -2.0 < float(line.split("return")[1].split()[0]) < 1.0


def test_torchrl() -> None:
    pytest.importorskip("torchrl")
    lines = lines_of("torchrl_ppo", "--steps", "600", "--batch", "300", "--minibatch", "100")
    figures = [line for line in lines if " steps  return " in line]
    assert [int(line.split(" steps")[0]) for line in figures] == [300, 600]
    assert all(np.isfinite(float(line.split("decisions")[1])) for line in figures)


def test_rllib(tmp_path: Path) -> None:
    pytest.importorskip("ray.rllib")
    lines = run_example("rllib_ppo", "--iterations", "1", "--batch", "200", folder=tmp_path)
    steps, rest = next(line for line in lines if " steps  return " in line).split(" steps  return ")
    assert int(steps) >= 200
    assert -2.0 < float(rest.split()[0]) < 1.0


def test_minari(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    minari = pytest.importorskip("minari")
    pytest.importorskip("torch")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    lines = lines_of("minari_dataset", "--episodes", "6", "--updates", "300")
    assert lines[0].startswith("homeward/survey-v0: 6 missions, ")
    right = float(lines[1].split(" does in ")[1].split("%")[0])
    assert right > 70.0  # by chance, a quarter
    dataset = minari.load_dataset("homeward/survey-v0")
    assert dataset.total_episodes == 6
    env = gym.make("homeward/Survey-v0")
    rule = make_policy("dmax_adaptive", env)
    for seed, mission in enumerate(dataset.iterate_episodes()):
        assert len(mission.observations) == len(mission.actions) + 1
        observations, actions, rewards = driven(env, rule, seed)
        np.testing.assert_array_equal(mission.observations, observations)
        np.testing.assert_array_equal(mission.actions, actions)
        assert sum(mission.rewards) == pytest.approx(sum(rewards), rel=1e-6)
        assert dataset.observation_space.contains(mission.observations[0])
        assert mission.terminations[-1] or mission.truncations[-1]
        assert not mission.terminations[:-1].any()


def driven(env: Any, rule: Policy, seed: int) -> tuple[Any, Any, list[float]]:
    """Observations, actions and rewards of one mission."""
    observation, _ = env.reset(seed=seed)
    observations, over = [observation], False
    actions: list[Any] = []
    rewards: list[float] = []
    while not over:
        actions.append(rule.act(observation[None], np.array([not actions]))[0])
        observation, reward, terminated, truncated, _ = env.step(actions[-1])
        observations.append(observation)
        rewards.append(float(reward))
        over = terminated or truncated
    return np.stack(observations), np.stack(actions), rewards


def test_omnisafe(tmp_path: Path) -> None:
    if importlib.util.find_spec("omnisafe") is None:
        pytest.skip("OmniSafe is installed apart, see docs/other_stacks.md")
    steps = (
        "--env",
        "homeward/OutAndBack-v0",
        "--steps",
        "16384",
        "--n-envs",
        "64",
        "--per-update",
        "128",
    )
    lines = run_example("omnisafe_ppolag", *steps, "--out", str(tmp_path), folder=tmp_path)
    assert lines[-1].startswith("homeward/OutAndBack-v0: return ")
    assert 0.0 <= float(lines[-1].split("stranded ")[1].split("%")[0]) <= 100.0
    (log,) = tmp_path.rglob("progress.csv")
    updates = list(csv.DictReader(log.read_text().splitlines()))
    assert [int(float(row["TotalEnvSteps"])) for row in updates] == [8192, 16384]
    assert all(0.0 <= float(row["Metrics/EpCost"]) <= 1.0 for row in updates)


@pytest.mark.parametrize("env_id", IDS.values())
def test_the_zoo_file_fits_the_learner(env_id: str) -> None:
    sb3 = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.env_util import make_vec_env
    from torch import nn

    settings: dict[str, Any] = yaml.safe_load((EXAMPLES / "rl_zoo" / "ppo.yml").read_text("utf-8"))[
        env_id
    ]
    assert settings.pop("n_timesteps") == 3e6
    schedule, start = settings.pop("learning_rate").split("_")  # as the Zoo reads it
    # as the Zoo does
    settings["policy_kwargs"] = eval(settings["policy_kwargs"], {"nn": nn, "dict": dict})
    envs = make_vec_env(env_id, settings.pop("n_envs"), seed=0)
    model = sb3.PPO(env=envs, learning_rate=float(start), seed=0, device="cpu", **settings)
    assert (schedule, model.n_steps * envs.num_envs % model.batch_size) == ("lin", 0)
    actions, _ = model.predict(envs.reset())
    envs.step(actions)
