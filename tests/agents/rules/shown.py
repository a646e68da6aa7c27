"""What rules are shown, and what they make of it."""

import numpy as np

from homeward.agents import Policy, make_policy
from homeward.agents.base import Observations
from homeward.agents.evaluation import Episodes, episode_seeds, run_episodes
from homeward.envs.features import INDEX, NAMES
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv

RULES = ["soc50", "dmax", "dmax_mapped", "dmax_adaptive"]
FIRST = np.ones(1, np.bool_)


def observed(**features: float) -> Observations:
    """One observation of a mission on its way out, with everything that is not given at 0."""
    row = np.zeros((1, len(NAMES)), np.float32)
    for name, value in ({"energy": 1.0, "outbound": 1.0} | features).items():
        row[0, INDEX[name]] = value
    return row


def mode(policy: Policy, observations: Observations) -> int:
    return int(policy.act(observations, FIRST)[0, 2])


def episodes(name: str, options: Options, count: int) -> Episodes:
    policy = make_policy(name, HomewardVectorEnv(**vars(options)))
    return run_episodes(policy, options, episode_seeds(1, count)).episodes
