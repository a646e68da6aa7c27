"""PPO with a limit on stranding: a Lagrange multiplier weights the cost `info["cost"]`.

`python examples/lagrangian_ppo.py --limit 0.02` maximises the score subject to at most 2 % of
missions stranding. After every update the multiplier, which is what a stranding takes from the
reward, rises while more of the last missions stranded and falls while fewer did (PPO-Lagrangian:
Ray, Achiam, Amodei, Benchmarking Safe Exploration in Deep Reinforcement Learning, 2019). It prints
multiplier, stranding and score on the way, and both on unseen missions at the end. Everything comes
from the environments as they are: the reward, and the cost beside it.
"""

from __future__ import annotations

try:
    from homeward.installed import needed
except ModuleNotFoundError:
    raise SystemExit(
        "needs homeward: pip install -e '.[train]' in its checkout, or run .venv/bin/python"
    ) from None

needed("train", "torch", "stable_baselines3")

import sys
from collections import deque
from dataclasses import dataclass

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from homeward import cli
from homeward.agents.evaluation.statistics import wilson
from homeward.agents.learning import sb3_vec_env
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.envs.options import OptionError

_LAST = 1000
"""Missions over which the rate of stranding is taken."""
_STEP = 0.05
"""Largest difference from the limit that moves the multiplier, so that the first missions do not
wind it up."""


@dataclass(frozen=True)
class Args:
    """What to train on, and how often it may strand."""

    env: str = "homeward/OutAndBack-v0"
    """Environment id."""
    limit: float = 0.02
    """Rate of stranding that is allowed."""
    steps: int = 2_000_000
    """Decisions to train on."""
    n_envs: int = 256
    """Missions side by side."""
    gain: float = 4.0
    """How far the multiplier moves after an update, over the difference from the limit."""
    episodes: int = 2000
    """Unseen missions at the end."""
    seed: int = 0
    """Seed of all that is drawn."""


class PenalisedReward(VecEnvWrapper):
    """Takes the multiplier times the cost from the reward, and remembers how missions ended."""

    def __init__(self, venv: SB3Adapter) -> None:
        super().__init__(venv)
        self.multiplier = 0.5
        self.costs: deque[float] = deque(maxlen=_LAST)
        self.scores: deque[float] = deque(maxlen=_LAST)

    def reset(self) -> VecEnvObs:
        """Begin all missions."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Step all missions."""
        observations, rewards, dones, infos = self.venv.step_wait()
        for i in np.flatnonzero(dones).tolist():
            self.costs.append(infos[i]["cost"])
            self.scores.append(infos[i]["score"] if infos[i]["home"] else 0.0)
            rewards[i] -= self.multiplier * infos[i]["cost"]
        return observations, rewards, dones, infos


class DualAscent(BaseCallback):
    """Moves the multiplier after every update, and prints where it stands ten times in a run."""

    def __init__(self, env: PenalisedReward, args: Args) -> None:
        super().__init__()
        self._env, self._args, self._tenth = env, args, 0

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        env, args = self._env, self._args
        if not env.costs:
            return
        rate = float(np.mean(env.costs))
        env.multiplier = max(
            env.multiplier + args.gain * float(np.clip(rate - args.limit, -_STEP, _STEP)), 0.0
        )
        tenth = 10 * self.num_timesteps // args.steps
        if tenth > self._tenth:
            self._tenth = tenth
            figures = f"multiplier {env.multiplier:.2f}  score {np.mean(env.scores):.4g}"
            print(f"{self.num_timesteps:>9,} steps  stranded {rate:6.1%}  {figures}", flush=True)


def missions(args: Args, seed: int) -> SB3Adapter:
    """Missions side by side, as Stable-Baselines3 takes them."""
    return sb3_vec_env(args.env, args.n_envs, seed=seed)


def train(args: Args) -> tuple[PPO, float]:
    """Train, and return the learner with the last multiplier."""
    env = PenalisedReward(missions(args, args.seed * args.n_envs))
    model = PPO(
        "MlpPolicy", env, learning_rate=1e-3, n_steps=64, batch_size=2048, n_epochs=6, gamma=0.9995, gae_lambda=0.95,
        policy_kwargs={"net_arch": [64, 64]}, seed=args.seed, device="cpu",
    )  # fmt: skip
    model.learn(args.steps, DualAscent(env, args))
    return model, env.multiplier


def evaluate(model: PPO, args: Args) -> tuple[int, int, float]:
    """How many missions stranded, of how many, and the mean score, of likeliest actions on unseen
    missions."""
    env = missions(args, 1 << 40)
    observations, costs, scores = env.reset(), [], []
    # Short missions end first: so that they do not count for more, each environment gives as many.
    quota = np.full(args.n_envs, -(-args.episodes // args.n_envs))
    while quota.any():
        actions, _ = model.predict(observations, deterministic=True)  # type: ignore[arg-type]
        observations, _, dones, infos = env.step(actions)  # type: ignore[assignment]
        for i in np.flatnonzero(dones & (quota > 0)).tolist():
            quota[i] -= 1
            costs.append(infos[i]["cost"])
            scores.append(infos[i]["score"] if infos[i]["home"] else 0.0)
    return int(sum(costs)), len(costs), float(np.mean(scores))


def main(args: Args) -> tuple[int, int, float]:
    """Train and evaluate, and print both.

    Raises:
        OptionError: The environment is not known.
    """
    # the network is small: threads that wait for each other cost more than they give
    torch.set_num_threads(1)
    model, multiplier = train(args)
    stranded, episodes, score = evaluate(model, args)
    low, high = wilson(stranded, episodes)
    print(
        f"{args.env}, {episodes} unseen missions: stranded {stranded / episodes:.1%} ({low:.1%} to {high:.1%}), "
        f"allowed {args.limit:.1%}; score {score:.4g}; multiplier {multiplier:.2f}"
    )
    return stranded, episodes, score


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError,)))
