"""Missions of a rule as a Minari data set, and a network that learns the rule from it.

`pip install -e '.[examples,train]' -c constraints.txt`, then
`python examples/minari_dataset.py --episodes 200`. The data set lies in Minari's folder
(`MINARI_DATASETS_PATH`) and opens with `minari.load_dataset("homeward/survey-v0")`.
"""

from __future__ import annotations

try:
    from homeward.installed import needed
except ModuleNotFoundError:
    raise SystemExit(
        "needs homeward: pip install -e '.[examples,train]' in its checkout, or run .venv/bin/python"
    ) from None

needed("examples,train", "minari", "torch")

from dataclasses import dataclass

import gymnasium as gym
import minari
import numpy as np
import torch
import tyro
from minari import MinariDataset
from minari.data_collector import EpisodeBuffer
from torch import nn

import homeward  # noqa: F401 - registers the environments
from homeward.agents import make_policy


@dataclass(frozen=True)
class Args:
    """What to record and learn."""

    env: str = "homeward/Survey-v0"
    """Environment id."""
    agent: str = "dmax_adaptive"
    """Rule to record: soc50, dmax, dmax_mapped or dmax_adaptive."""
    name: str = "homeward/survey-v0"
    """Id of the data set; one that is there already is replaced."""
    episodes: int = 100
    """Missions to record."""
    updates: int = 2000
    """Gradient steps."""
    seed: int = 0
    """Seed of all that is drawn."""


def record(args: Args) -> MinariDataset:
    """Run the rule and keep its missions."""
    env = gym.make(args.env)
    rule = make_policy(args.agent, env)
    missions = []
    for number in range(args.episodes):
        observation, _ = env.reset(seed=args.seed + number)
        mission = EpisodeBuffer(
            id=number, seed=args.seed + number, observations=[observation], actions=[]
        )
        begun, over = True, False
        while not over:
            action = rule.act(observation[None], np.array([begun]))[0]
            observation, reward, terminated, truncated, _ = env.step(action)
            mission.observations.append(observation)
            mission.actions.append(action)
            mission.rewards.append(reward)
            mission.terminations.append(terminated)
            mission.truncations.append(truncated)
            begun, over = False, terminated or truncated
        missions.append(mission)
    if args.name in minari.list_local_datasets():
        minari.delete_dataset(args.name)
    return minari.create_dataset_from_buffers(
        dataset_id=args.name,
        buffer=missions,
        env=env,
        eval_env=args.env,
        algorithm_name=args.agent,
        description=f"{args.episodes} missions of {args.env} driven by the rule {args.agent}",
        author="homeward contributors",
        author_email="",
        code_permalink="",
        data_format="arrow",
    )


def clone(dataset: MinariDataset, args: Args) -> tuple[nn.Sequential, float]:
    """Learn to choose as the data set does; return the network and its share of right choices in
    missions apart."""
    torch.manual_seed(args.seed)
    torch.set_num_threads(1)
    choices = dataset.action_space.nvec.tolist()
    episodes = list(dataset.iterate_episodes())
    apart = max(1, len(episodes) // 5)

    def stacked(chosen: list[minari.EpisodeData]) -> tuple[torch.Tensor, torch.Tensor]:
        # The last observation of a mission has no action.
        seen = torch.from_numpy(np.concatenate([episode.observations[:-1] for episode in chosen]))
        return seen, torch.from_numpy(np.concatenate([episode.actions for episode in chosen]))

    observations, actions = stacked(episodes[apart:])
    network = nn.Sequential(
        nn.Linear(observations.shape[1], 64),
        nn.Tanh(),
        nn.Linear(64, 64),
        nn.Tanh(),
        nn.Linear(64, sum(choices)),
    )
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
    for _ in range(args.updates):
        rows = torch.randint(len(observations), (256,))
        parts = network(observations[rows]).split(choices, dim=-1)
        losses = [
            nn.functional.cross_entropy(part, actions[rows, i]) for i, part in enumerate(parts)
        ]
        optimizer.zero_grad()
        torch.stack(losses).sum().backward()
        optimizer.step()
    observations, actions = stacked(episodes[:apart])
    with torch.no_grad():
        chosen = torch.stack(
            [part.argmax(-1) for part in network(observations).split(choices, dim=-1)], dim=-1
        )
    return network, float((chosen == actions).float().mean())


def main(args: Args) -> tuple[MinariDataset, float]:
    """Record, learn, and return the data set and the share of right choices."""
    dataset = record(args)
    mean = np.mean([episode.rewards.sum() for episode in dataset.iterate_episodes()])
    print(
        f"{args.name}: {dataset.total_episodes} missions, {dataset.total_steps} decisions, return {mean:.3f}"
    )
    _, right = clone(dataset, args)
    print(
        f"a network learned from them chooses as {args.agent} does in {right:.1%} of choices in missions kept apart"
    )
    return dataset, right


if __name__ == "__main__":
    main(tyro.cli(Args, description=__doc__))
