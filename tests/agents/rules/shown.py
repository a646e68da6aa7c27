"""What rules are shown, and what they make of it."""

import numpy as np

from homeward.agents import Policy, make_policy
from homeward.agents.base import Observations
from homeward.agents.evaluation import Episodes, episode_seeds, run_episodes
from homeward.envs.features import INDEX, NAMES
from homeward.envs.options import Known, Options
from homeward.envs.vector import HomewardVectorEnv

RULES = ["soc50", "dmax", "dmax_mapped", "dmax_adaptive", "dmax_belief"]
FIRST = np.ones(1, np.bool_)


def observed(**features: float) -> Observations:
    """One observation of a mission on its way out, with everything that is not given at 0; all
    gauges show the same."""
    row = np.zeros((1, len(NAMES)), np.float32)
    charge = features.get("energy", 1.0)
    for name, value in (
        {"energy": charge, "metered": charge, "outbound": 1.0, "east": 1.0} | features
    ).items():
        row[0, INDEX[name]] = value
    return row


def under_way(known: Known, **features: float) -> Observations:
    """As `observed`, a quarter of the time limit after the start, with the power and the speed that
    led there."""
    s = known.shared[0]
    time_s = 0.25 * s["max_decisions"] * s["decision_s"]
    used, way_m = 1.0 - features.get("energy", 1.0), features.get("distance", 0.0) * s["reach_m"]
    led_there = {
        "time": 0.25,
        "modelled": used,
        "power": used * s["usable_j"] / time_s / s["cruise_w"],
        "speed": way_m / time_s / s["max_speed_mps"],
    }
    return observed(**(led_there | features))


def begun(policy: Policy, missions: int = 1) -> Policy:
    """The policy, after it was shown the start of missions."""
    policy.act(np.repeat(observed(margin=1.0), missions, axis=0), np.ones(missions, np.bool_))
    return policy


def mode(policy: Policy, observations: Observations) -> int:
    return int(policy.act(observations, FIRST)[0, 2])


def episodes(name: str, options: Options, count: int) -> Episodes:
    policy = make_policy(name, HomewardVectorEnv(**vars(options)))
    return run_episodes(policy, options, episode_seeds(1, count)).episodes
