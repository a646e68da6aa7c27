"""What all rules share: where they turn back, for one mission as for many, and that they come
home."""

import dataclasses

import numpy as np
import pytest

from homeward import load_robot
from homeward.agents import make_policy
from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.planner import Planner
from homeward.agents.rules.turn_back import TurnBackRule
from homeward.envs.actions import decode_actions
from homeward.envs.features import INDEX
from homeward.envs.missions import MISSIONS
from homeward.envs.options import Options
from homeward.envs.state import GO, RETURN
from homeward.envs.vector import HomewardVectorEnv
from tests.agents.rules.shown import FIRST, RULES, begun, episodes, mode, observed, under_way


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize("mission", ["OutAndBack", "Survey"])
def test_rules_turn_back_at_the_far_end_and_when_time_runs_out(name: str, mission: str) -> None:
    env = HomewardVectorEnv(mission=mission)
    s = env.batch.known.shared[0]
    end = float(s["length_m"] / s["reach_m"])
    assert mode(make_policy(name, env), observed(margin=1.0, distance=0.5 * end)) == GO
    assert mode(make_policy(name, env), observed(margin=1.0, distance=end)) == RETURN
    assert (
        mode(make_policy(name, env), observed(margin=1.0, distance=0.5 * end, time=0.9)) == RETURN
    )


@pytest.mark.parametrize("name", RULES)
def test_patrols_turn_back_at_the_home_post_only(name: str) -> None:
    env = HomewardVectorEnv(mission="Patrol")
    known, modes = env.batch.known, []
    for energy, distance in ((0.02, 0.0), (0.02, 0.01), (0.9, 0.0)):
        shown = under_way(known, energy=energy, margin=energy, distance=distance)
        modes.append(begun(make_policy(name, env)).act(shown, np.zeros(1, np.bool_))[0, 2])
    assert modes == [RETURN, GO, GO]


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("name", [*RULES, "planner"])
def test_it_heads_home_where_its_rule_turns(name: str, action_type: str) -> None:
    env = HomewardVectorEnv(mission="Survey", action_type=action_type)
    shown = np.concatenate([
        under_way(env.batch.known, energy=energy, distance=0.2, home_cost=0.15, margin=energy - 0.15)
        for energy in (0.9, 0.8, 0.1, 0.9)
    ])  # fmt: skip
    shown[3, INDEX["returning"]] = 1.0
    policies = [begun(make_policy(name, env), 4) for _ in range(2)]
    rule = policies[0].rule if isinstance(policies[0], Planner) else policies[0]
    assert isinstance(rule, TurnBackRule)
    turns = rule.turns(shown, np.zeros(4, np.bool_))
    assert turns.tolist() == [False, False, True, True]
    commands = decode_actions(env.batch.known, policies[1].act(shown, np.zeros(4, np.bool_)))
    np.testing.assert_array_equal(commands.returns, turns)


@pytest.mark.parametrize("name", RULES)
def test_rules_keep_heading_home_and_sense_nothing_there(name: str) -> None:
    policy = make_policy(name, HomewardVectorEnv())
    action = policy.act(observed(margin=1.0, distance=0.3, returning=1.0, interest=5.0), FIRST)
    assert action.tolist() == [[4, 0, RETURN]]


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize("mission", MISSIONS)
def test_batches_equal_singles(name: str, mission: str) -> None:
    options, seeds = Options(mission), episode_seeds(2, 6)
    policy = make_policy(name, HomewardVectorEnv(**vars(options)))
    together = run_episodes(policy, options, seeds).episodes
    for index, seed in enumerate(seeds):
        alone = run_episodes(policy, options, [seed]).episodes
        assert alone.score[0] == together.score[index]
        assert alone.decisions[0] == together.decisions[index]


@pytest.mark.parametrize("mission", MISSIONS)
@pytest.mark.parametrize("name", ["dmax", "dmax_mapped", "dmax_adaptive"])
def test_tuned_rules_come_home_when_all_is_known(name: str, mission: str) -> None:
    assert episodes(name, Options(mission, difficulty="known"), 150).home.all()


@pytest.mark.parametrize("name", ["dmax_mapped", "dmax_adaptive"])
def test_hidden_wind_fools_rules_that_extrapolate(name: str) -> None:
    stranded = episodes(name, Options("OutAndBack"), 200).stranded.mean()
    misled = episodes(name, Options("OutAndBack", route="hidden_wind"), 200).stranded.mean()
    assert stranded < 0.1
    assert misled > 0.4


@pytest.mark.parametrize("name", ["dmax", "dmax_mapped", "dmax_adaptive", "dmax_belief", "planner"])
@pytest.mark.parametrize("mission", MISSIONS)
def test_rules_come_home_above_the_cut_off(name: str, mission: str) -> None:
    robot = dataclasses.replace(
        load_robot("turtlebot3_burger"),
        cutoff_v=11.0,
        effects={"internal_resistance": {"ohm": 0.3}},
    )
    result = episodes(name, Options(mission, difficulty="known", robot=robot), 20)
    assert not result.stranded.any() and (result.score > 0.0).all()
    # What stays is a sixth of the battery.
    assert result.energy_left_j.min() > 0.15 * robot.usable_energy_j
