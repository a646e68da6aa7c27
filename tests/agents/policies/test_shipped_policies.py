"""The policies that ship: they load, say how they were trained, and do what their cards say."""

import json

import pytest
from scipy import stats

from homeward.agents import make_policy
from homeward.agents.evaluation import Episodes, episode_seeds, run_episodes
from homeward.agents.learning.curve import read_curve
from homeward.agents.registry import SHIPPED
from homeward.agents.trained.policy_file import NetworkPolicy
from homeward.agents.trained.provenance import differences
from homeward.envs import IDS
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv

EPISODES = 300
LEAST_GAIN = {"OutAndBack": 0.04, "Patrol": -0.01, "Survey": 0.02}
"""Share of the rule's score that is gained at least, 95 % sure: paired, on these episodes."""
MISSIONS = sorted(folder.name for folder in SHIPPED.iterdir() if folder.is_dir())


def driven(name: str, mission: str) -> Episodes:
    env = HomewardVectorEnv(mission=mission)
    return run_episodes(make_policy(name, env), Options(mission), episode_seeds(5, EPISODES)).episodes


@pytest.mark.parametrize("mission", MISSIONS)
def test_what_ships_loads_without_a_warning(mission: str) -> None:
    env = HomewardVectorEnv(mission=mission)
    policy = make_policy("ppo", env)
    assert isinstance(policy, NetworkPolicy)
    assert not differences(policy.description, IDS[mission], env.batch.options, env.batch.known)
    assert {"command", "versions", "training"} <= set(policy.description)
    assert len(read_curve(SHIPPED / mission)) > 5


@pytest.mark.parametrize(("mission", "least"), LEAST_GAIN.items())
def test_it_gains_on_the_adaptive_rule_and_strands_less(mission: str, least: float) -> None:
    ours, rule = driven("ppo", mission), driven("dmax_adaptive", mission)
    gain = stats.ttest_rel(ours.score, rule.score).confidence_interval(0.95)
    assert gain.low > least * rule.score.mean()
    assert ours.stranded.sum() <= min(6, rule.stranded.sum())
    assert (ours.home | ours.stranded).all()  # in time


@pytest.mark.parametrize("mission", MISSIONS)
def test_its_card_tells_of_the_very_policy(mission: str) -> None:
    description = json.loads((SHIPPED / mission / "policy.json").read_text())
    card = (SHIPPED / mission / "card.md").read_text()
    assert description["weights_sha256"][:16] in card
    assert description["command"] in card


def test_a_policy_ships_for_every_mission() -> None:
    assert set(MISSIONS) == set(IDS) == set(LEAST_GAIN)
