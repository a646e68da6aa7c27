"""The policies that ship: they load, say how they were trained, and do what their cards say."""

import json
from pathlib import Path

import pytest
from scipy import stats

from homeward.agents import make_policy
from homeward.agents.evaluation import Episodes, episode_seeds, run_episodes
from homeward.agents.evaluation.learning_curve import read_curve
from homeward.agents.registry import SHIPPED, shipped
from homeward.agents.trained.policy_file import NetworkPolicy
from homeward.agents.trained.provenance import differences, made_with
from homeward.envs import IDS
from homeward.envs.options import Options
from homeward.envs.vector import HomewardVectorEnv

EPISODES = 300
LEAST_GAIN = {
    ("ppo", "OutAndBack"): 0.04, ("ppo", "Patrol"): -0.03, ("ppo", "Survey"): 0.02,
    ("ppo_scratch", "OutAndBack"): -0.02, ("ppo_scratch", "Patrol"): -0.06, ("ppo_scratch", "Survey"): -0.2,
}  # fmt: skip
"""Share of the rule's score that is gained at least, 95 % sure: paired, on these episodes."""
FOLDERS = {
    (agent, mission): shipped(mission, start)
    for agent, start in (("ppo", "dmax"), ("ppo_scratch", "scratch"))
    for mission in IDS
}


def driven(name: str, mission: str) -> Episodes:
    env = HomewardVectorEnv(mission=mission)
    return run_episodes(
        make_policy(name, env), Options(mission), episode_seeds(5, EPISODES)
    ).episodes


@pytest.mark.parametrize(("agent", "mission"), FOLDERS)
def test_what_ships_loads_without_a_warning(agent: str, mission: str) -> None:
    env = HomewardVectorEnv(mission=mission)
    policy = make_policy(agent, env)
    assert isinstance(policy, NetworkPolicy)
    assert not differences(policy.description, IDS[mission], env.batch.options, env.batch.known)
    assert {"command", "versions", "training"} <= set(policy.description)
    then, now = policy.description["made_with"], made_with(env.batch.options)
    # hashes stay the same
    assert all(then[name] == now[name] for name in ("robot", "instruments", "route"))
    assert " /" not in policy.description["command"]  # a path of somebody's machine
    assert len(read_curve(FOLDERS[agent, mission])) > 5


@pytest.mark.parametrize(("of", "least"), LEAST_GAIN.items())
def test_it_is_compared_with_the_adaptive_rule_and_strands_no_more(
    of: tuple[str, str], least: float
) -> None:
    agent, mission = of
    ours, rule = driven(agent, mission), driven("dmax_adaptive", mission)
    gain = stats.ttest_rel(ours.score, rule.score).confidence_interval(0.95)
    assert gain.low > least * rule.score.mean()
    assert ours.stranded.sum() <= max(6, rule.stranded.sum())
    # the one that starts from nothing sometimes stands on a survey
    assert ours.timed_out.mean() <= 0.02


@pytest.mark.parametrize(("agent", "mission"), FOLDERS)
def test_its_card_tells_of_the_very_policy(agent: str, mission: str) -> None:
    folder = FOLDERS[agent, mission]
    description = json.loads((folder / "policy.json").read_text())
    card = (folder / "card.md").read_text()
    assert description["weights_sha256"][:16] in card
    assert description["command"] in card
    # `dmax_belief`, which estimates the robot, is a d_max rule too, and better
    assert "minus the best of the three d_max rules that do not estimate the robot, `dmax_" in card
    assert "best d_max rule" not in card
    assert (Path(__file__).parents[3] / description["command"].split()[0]).is_file()


def test_nothing_else_ships() -> None:
    assert {folder.name for folder in SHIPPED.iterdir() if folder.is_dir()} == {
        one.name for one in FOLDERS.values()
    }
    assert set(LEAST_GAIN) == set(FOLDERS)
