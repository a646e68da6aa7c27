"""PPO in one file, in the manner of CleanRL, on the native vector environment.

`python examples/cleanrl_ppo.py --steps 2000000` prints how missions end as it learns. Needs
homeward and torch.
"""

from __future__ import annotations

try:
    from homeward.installed import needed
except ModuleNotFoundError:
    raise SystemExit(
        "needs homeward: pip install -e '.[train]' in its checkout, or run .venv/bin/python"
    ) from None

needed("train", "torch")

import math
import time
from dataclasses import dataclass

import gymnasium as gym
import numba
import numpy as np
import torch
import tyro
from gymnasium.vector import AutoresetMode
from torch import Tensor, nn
from torch.distributions import Categorical

import homeward  # noqa: F401 - registers the environments


@dataclass(frozen=True)
class Args:
    """What to train."""

    env: str = "homeward/Survey-v0"
    """Environment id."""
    steps: int = 1_000_000
    """Decisions to train on."""
    seed: int = 0
    """Seed of all that is drawn."""
    num_envs: int = 256
    """Missions side by side."""
    num_steps: int = 64
    """Decisions of each mission between two updates."""
    minibatches: int = 8
    """Gradient steps in a pass over the decisions."""
    epochs: int = 4
    """Passes in an update."""
    learning_rate: float = 1e-3
    """Step size of Adam at the start; it falls linearly to 0."""
    gamma: float = 0.9995
    """Discount factor, also of the shaping."""
    gae_lambda: float = 0.95
    """How far advantages look ahead."""
    clip: float = 0.2
    """How far an update may move the probability of an action."""
    max_grad_norm: float = 0.5
    """Longest gradient."""


class Agent(nn.Module):
    """Policy and value, two hidden layers each; an action is three choices: speed, sensing rate,
    stop / go / return."""

    def __init__(self, features: int, choices: list[int]) -> None:
        super().__init__()
        self.choices = choices
        self.critic = network(features, 1, 1.0)
        self.actor = network(features, sum(choices), 0.01)
        # A robot that may turn back at every decision hardly ever gets anywhere by chance: begin
        # with one that goes on.
        with torch.no_grad():
            self.actor[-1].bias[-3:] = torch.tensor([-1.5, 2.0, -2.2])

    def value(self, observations: Tensor) -> Tensor:
        """Expected return, shape (n,)."""
        return self.critic(observations).squeeze(-1)

    def policy(self, observations: Tensor) -> list[Categorical]:
        """Distribution of each choice."""
        return [
            Categorical(logits=part)
            for part in self.actor(observations).split(self.choices, dim=-1)
        ]


def network(inputs: int, outputs: int, last_gain: float) -> nn.Sequential:
    """Two hidden layers of 64, initialised as PPO likes it."""
    layers: list[nn.Module] = []
    for before, after, gain in (
        (inputs, 64, math.sqrt(2)),
        (64, 64, math.sqrt(2)),
        (64, outputs, last_gain),
    ):
        layer = nn.Linear(before, after)
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.zeros_(layer.bias)
        layers += [layer, nn.Tanh()]
    return nn.Sequential(*layers[:-1])


def log_prob(policy: list[Categorical], actions: Tensor) -> Tensor:
    """Log probability of actions of shape (n, 3)."""
    return torch.stack(
        [choice.log_prob(action) for choice, action in zip(policy, actions.unbind(-1), strict=True)]
    ).sum(0)


def main(args: Args) -> list[float]:
    """Train, and return the mean return of the missions that ended in each update; nan where none
    did."""
    torch.manual_seed(args.seed)
    torch.set_num_threads(1)  # batches are small, and idle threads of the one starve the other
    numba.set_num_threads(1)
    envs = gym.make_vec(
        args.env,
        num_envs=args.num_envs,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.SAME_STEP,
        discount=args.gamma,
    )
    agent = Agent(envs.single_observation_space.shape[0], envs.single_action_space.nvec.tolist())
    optimizer = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-5)

    shape = (args.num_steps, args.num_envs)
    observations = torch.zeros(*shape, envs.single_observation_space.shape[0])
    actions = torch.zeros(*shape, 3, dtype=torch.int64)
    log_probs, rewards, dones, values = (torch.zeros(shape) for _ in range(4))

    observation = torch.from_numpy(envs.reset(seed=args.seed)[0])
    returns, history = np.zeros(args.num_envs), []
    updates, start_s = math.ceil(args.steps / (args.num_steps * args.num_envs)), time.monotonic()
    for update in range(updates):
        optimizer.param_groups[0]["lr"] = args.learning_rate * (1.0 - update / updates)
        ended: list[tuple[float, float, float]] = []  # return, home, stranded
        for t in range(args.num_steps):
            with torch.no_grad():
                policy, values[t] = agent.policy(observation), agent.value(observation)
                action = torch.stack([choice.sample() for choice in policy], dim=-1)
                log_probs[t] = log_prob(policy, action)
            observations[t], actions[t] = observation, action
            following, reward, terminated, truncated, info = envs.step(action.numpy())
            returns += reward
            over = terminated | truncated
            rewards[t], dones[t] = torch.from_numpy(reward), torch.from_numpy(over)
            if over.any():
                final = info["final_info"]
                ended += [
                    (returns[i], final["home"][i], final["stranded"][i])
                    for i in np.flatnonzero(over)
                ]
                returns[over] = 0.0
            # Out of time is not the end of the world: what would have followed counts.
            for i in np.flatnonzero(truncated & ~terminated):
                with torch.no_grad():
                    rewards[t, i] += args.gamma * agent.value(
                        torch.from_numpy(info["final_obs"][i])
                    )
            observation = torch.from_numpy(following)

        with torch.no_grad():
            advantages, advantage, following_value = (
                torch.zeros(shape),
                torch.zeros(()),
                agent.value(observation),
            )
            for t in reversed(range(args.num_steps)):
                goes_on = 1.0 - dones[t]
                error = rewards[t] + args.gamma * goes_on * following_value - values[t]
                advantage = error + args.gamma * args.gae_lambda * goes_on * advantage
                advantages[t], following_value = advantage, values[t]
            targets = advantages + values

        flat = [
            values.flatten(0, 1)
            for values in (observations, actions, log_probs, advantages, targets)
        ]
        for _ in range(args.epochs):
            for rows in torch.randperm(args.num_steps * args.num_envs).chunk(args.minibatches):
                seen, taken, old_log_prob, gain, target = (values[rows] for values in flat)
                policy = agent.policy(seen)
                ratio = (log_prob(policy, taken) - old_log_prob).exp()
                gain = (gain - gain.mean()) / (gain.std() + 1e-8)
                policy_loss = -torch.min(
                    ratio * gain, ratio.clamp(1.0 - args.clip, 1.0 + args.clip) * gain
                ).mean()
                value_loss = 0.5 * (agent.value(seen) - target).square().mean()
                optimizer.zero_grad()
                (policy_loss + value_loss).backward()
                nn.utils.clip_grad_norm_(agent.parameters(), args.max_grad_norm)
                optimizer.step()

        steps = (update + 1) * args.num_steps * args.num_envs
        mean, home, stranded = np.mean(ended, axis=0) if ended else (math.nan,) * 3
        history.append(float(mean))
        print(
            f"{steps:>9,} steps  return {mean:6.3f}  home {home:5.1%}  stranded {stranded:5.1%}  "
            f"{steps / (time.monotonic() - start_s):,.0f} steps/s"
        )
    envs.close()
    return history


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
