"""PPO of RLlib on an environment of homeward.

`pip install -e '.[examples,train]' -c constraints.txt`, then
`python examples/rllib_ppo.py --iterations 50`. Not `ray[rllib]`: that asks for an older Gymnasium,
though RLlib works with ours.
"""

from __future__ import annotations

try:
    from homeward.installed import needed
except ModuleNotFoundError:
    raise SystemExit(
        "needs homeward: pip install -e '.[examples,train]' in its checkout, or run .venv/bin/python"
    ) from None

needed("examples,train", "ray", "torch")

import os
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")

import gymnasium as gym
import ray
import tyro
from ray.rllib.algorithms.ppo import PPOConfig
from ray.tune.registry import register_env

import homeward  # noqa: F401 - registers the environments


@dataclass(frozen=True)
class Args:
    """What to train."""

    env: str = "homeward/OutAndBack-v0"
    """Environment id."""
    difficulty: str = "known"
    """known, uncertain or harsh."""
    iterations: int = 20
    """Updates."""
    batch: int = 4000
    """Decisions between two updates."""
    workers: int = 0
    """Processes that run missions; 0: this one does."""
    seed: int = 0
    """Seed of all that is drawn."""


def main(args: Args) -> list[dict[str, Any]]:
    """Train, and return RLlib's figures of each update."""
    # RLlib makes its environments in its own processes, which have to import homeward themselves.
    register_env(args.env, lambda options: gym.make(f"homeward:{args.env}", **options))
    config = (
        PPOConfig()
        .environment(args.env, env_config={"difficulty": args.difficulty, "discount": 0.9995})
        .env_runners(num_env_runners=args.workers, num_envs_per_env_runner=16)
        .training(
            train_batch_size_per_learner=args.batch,
            minibatch_size=args.batch // 4,
            num_epochs=4,
            gamma=0.9995,
            lr=1e-3,
        )
        .debugging(seed=args.seed)
    )
    # A cluster of its own, whatever else of Ray runs on this machine.
    ray.init(
        address="local",
        num_cpus=1 + args.workers,
        include_dashboard=False,
        log_to_driver=False,
        object_store_memory=100_000_000,
    )
    algorithm = config.build_algo()
    history = []
    for _ in range(args.iterations):
        figures = algorithm.train()
        missions = figures["env_runners"]
        print(
            f"{missions['num_env_steps_sampled_lifetime']:>9,.0f} steps  "
            f"return {missions['episode_return_mean']:6.3f}  decisions {missions['episode_len_mean']:5.1f}"
        )
        history.append(figures)
    algorithm.stop()
    ray.shutdown()
    return history


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
