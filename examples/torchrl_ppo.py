"""PPO from TorchRL's parts on an environment of homeward with continuous actions.

`pip install -e '.[examples,train]' -c constraints.txt`, then
`python examples/torchrl_ppo.py --steps 200000`.
"""

from __future__ import annotations

try:
    from homeward.installed import needed
except ModuleNotFoundError:
    raise SystemExit(
        "needs homeward: pip install -e '.[examples,train]' in its checkout, or run .venv/bin/python"
    ) from None

needed("examples,train", "torch", "torchrl")

from dataclasses import dataclass

import gymnasium as gym
import torch
import tyro
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, ReplayBuffer, SamplerWithoutReplacement
from torchrl.envs import GymWrapper, RewardSum, StepCounter, TransformedEnv
from torchrl.modules import NormalParamExtractor, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import homeward  # noqa: F401 - registers the environments


@dataclass(frozen=True)
class Args:
    """What to train."""

    env: str = "homeward/OutAndBack-v0"
    """Environment id."""
    steps: int = 100_000
    """Decisions to train on."""
    batch: int = 2000
    """Decisions between two updates."""
    minibatch: int = 500
    """Decisions in a gradient step."""
    epochs: int = 4
    """Passes over the decisions in an update."""
    learning_rate: float = 1e-3
    """Step size of Adam."""
    gamma: float = 0.9995
    """Discount factor, also of the shaping."""
    seed: int = 0
    """Seed of all that is drawn."""


def make_env(args: Args) -> TransformedEnv:
    """The environment as TorchRL sees it, with return and length of missions."""
    env = GymWrapper(gym.make(args.env, action_type="continuous", discount=args.gamma))
    env.set_seed(args.seed)
    return TransformedEnv(env, RewardSum()).append_transform(StepCounter())


def hidden(features: int, outputs: int) -> nn.Sequential:
    """Two hidden layers of 64."""
    return nn.Sequential(
        nn.Linear(features, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)
    )  # fmt: skip


def main(args: Args) -> list[float]:
    """Train, and return the mean return of the missions that ended in each batch; nan where none
    did."""
    torch.manual_seed(args.seed)
    torch.set_num_threads(1)  # batches are small
    env = make_env(args)
    features, actions = env.observation_spec["observation"].shape[-1], env.action_spec.shape[-1]
    parameters = nn.Sequential(hidden(features, 2 * actions), NormalParamExtractor())
    actor = ProbabilisticActor(
        TensorDictModule(parameters, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        return_log_prob=True,
    )
    critic = ValueOperator(hidden(features, 1), in_keys=["observation"])
    advantage = GAE(gamma=args.gamma, lmbda=0.95, value_network=critic, average_gae=True)
    loss = ClipPPOLoss(actor, critic, clip_epsilon=0.2, entropy_coeff=0.001)
    optimizer = torch.optim.Adam(loss.parameters(), lr=args.learning_rate)
    buffer = ReplayBuffer(
        storage=LazyTensorStorage(args.batch),
        sampler=SamplerWithoutReplacement(),
        batch_size=args.minibatch,
    )
    collector = Collector(
        env,
        actor,
        frames_per_batch=args.batch,
        total_frames=args.steps,
        auto_register_policy_transforms=True,
    )
    history, steps = [], 0
    for batch in collector:
        for _ in range(args.epochs):
            advantage(batch)  # with the values as they are now
            buffer.extend(batch.reshape(-1))
            for _ in range(args.batch // args.minibatch):
                losses = loss(buffer.sample())
                total = losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]
                optimizer.zero_grad()
                total.backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimizer.step()
        over = batch["next", "done"]
        history.append(float(batch["next", "episode_reward"][over].mean()))
        steps += batch.numel()
        print(
            f"{steps:>9,} steps  return {history[-1]:6.3f}  "
            f"decisions {batch['next', 'step_count'][over].float().mean():5.1f}"
        )
    collector.shutdown()
    return history


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
