"""Baseline: stable-baselines3's PPO with its defaults, on the observation alone, without a
pretrained policy.

`python benchmarks/agents/plain_ppo.py` trains `PPO("MlpPolicy")` with five seeds on 16 missions of
OutAndBack side by side, with all its defaults but the discount factor, which is that of the
shaping. It prints the results of 2,000 unseen missions, those of evaluate.py with seed 0, with the
most probable action (greedy) and with sampled ones. Finished seeds are stored in OUT, so that an
interrupted run continues.
"""

from __future__ import annotations

import itertools
import sys
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numba
import torch
from rich.console import Console
from stable_baselines3 import PPO

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.kept import Kept
from benchmarks.tables import rate, table
from homeward import cli
from homeward.agents.base import Policy
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.learning.ppo import one_thread
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.agents.learning.sb3_policy import SB3Policy
from homeward.agents.learning.settings import TrainingError
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv
from homeward.parallel import ClusterError, TaskError, run_tasks

OPTIONS = Options("OutAndBack")
SIDE_BY_SIDE = 16
"""Missions that a learner trains on at once."""


@dataclass(frozen=True)
class Args:
    """Training and evaluation."""

    seeds: int = 5
    """Training seeds: 0, 1, ..."""
    steps: int = 1_000_000
    """Decisions to train on."""
    episodes: int = 2000
    """Unseen episodes to compare on."""
    jobs: int = 1
    """Seeds at once."""
    out: Path = Path("runs/plain_ppo")
    """Folder of the results."""


def make_model(options: Options, seed: int) -> PPO:
    """PPO with all defaults but the discount factor.

    Args:
        options: Options of the environment; its discount factor is the learner's.
        seed: Seed of network, samples and missions; no two seeds share a mission.
    """
    env = SB3Adapter(HomewardVectorEnv(SIDE_BY_SIDE, autoreset_mode="SameStep", **vars(options)))
    model = PPO("MlpPolicy", env, gamma=options.discount, seed=seed, device="cpu")
    # the model has given it seeds that overlap with those of the next seed
    env.seed(seed * SIDE_BY_SIDE)
    return model


def run_seed(task: tuple[int, int, list[int]]) -> dict[str, Any]:
    """Train with a seed for a number of decisions, and run the unseen episodes."""
    numba.set_num_threads(1)  # steps are short: several threads would be slower
    training_seed, steps, episodes = task
    start = time.perf_counter()
    with one_thread():
        model = make_model(OPTIONS, training_seed).learn(steps)
        trained_s = time.perf_counter() - start
        torch.manual_seed(training_seed)  # seed of the samples in evaluation
        greedy = figures(SB3Policy(model, True), episodes)
        sampled = figures(SB3Policy(model, False), episodes)
    return {"greedy": greedy, "sampled": sampled, "trained_s": trained_s}


def figures(policy: Policy, seeds: list[int]) -> dict[str, Any]:
    """Share of missions that get home, number of stranded ones, and mean score of a policy."""
    episodes = run_episodes(policy, OPTIONS, seeds).episodes
    return {
        "home_rate": float(episodes.home.mean()),
        "stranded": int(episodes.stranded.sum()),
        "score_mean": float(episodes.score.mean()),
    }


def main(args: Args) -> None:
    """Train and store the missing seeds, and print the table.

    Raises:
        TrainingError, ClusterError, TaskError: An argument cannot be used, or a training failed.
        OSError: The output folder cannot be written to.
    """
    if args.seeds < 1 or args.steps < 1 or args.episodes < 2:
        raise TrainingError(f"{args}: give at least 1 of --seeds and --steps, and 2 --episodes")
    versions = {name: version(name) for name in ("stable-baselines3", "torch")}
    unseen = episode_seeds(0, args.episodes)
    kept = Kept(
        args.out / "plain_ppo.json", steps=args.steps, episodes=args.episodes, versions=versions
    )
    tasks = {f"seed {seed}": (seed, args.steps, unseen) for seed in range(args.seeds)}
    run_tasks(run_seed, kept.missing(tasks), jobs=args.jobs, keep=kept.keep, title="training seeds")
    title = f"OutAndBack, uncertain: {args.steps:,} decisions of plain PPO\n{args.episodes} unseen missions"
    shown = table(title, ("training",), ("home", "stranded (95 %)", "mean score", "training, s"))
    for name, how in itertools.product(tasks, ("greedy", "sampled")):
        run = kept.results[name]
        result = run[how]
        home = f"{result['home_rate']:.2%}"
        stranded = rate(result["stranded"], args.episodes)
        score = f"{result['score_mean']:.4g}"
        shown.add_row(f"{name}, {how}", home, stranded, score, f"{run['trained_s']:.0f}")
    Console(width=120).print(shown)


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (TrainingError, ClusterError, TaskError)))
