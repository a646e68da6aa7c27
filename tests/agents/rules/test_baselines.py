"""The rules turn back where they say, for one mission as for many, and come home."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

from homeward.agents import AGENTS, AgentError, Policy, make_policy
from homeward.agents.base import Observations
from homeward.agents.evaluation import Episodes, episode_seeds, run_episodes
from homeward.agents.planner import Planner
from homeward.agents.registry import FROM_FILES
from homeward.agents.rules.dmax_adaptive import AdaptiveDmaxRule
from homeward.agents.rules.pace import NO_SENSING, Pace
from homeward.agents.rules.rule import TurnBackRule
from homeward.agents.rules.tuned import RESERVES
from homeward.agents.shield import decode_actions
from homeward.envs.features import INDEX, NAMES
from homeward.envs.options import MISSIONS, Options, settle
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import ancillary_power, d_max

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


@pytest.mark.parametrize("mission", ["OutAndBack", "Survey"])
def test_soc50_turns_back_at_half(mission: str) -> None:
    policy = make_policy("soc50", HomewardVectorEnv(mission=mission))
    assert mode(policy, observed(energy=0.501, distance=0.3)) == GO
    assert mode(policy, observed(energy=0.499, distance=0.3)) == RETURN


@pytest.mark.parametrize("mean_grade", [-0.04, 0.0, 0.06])
def test_dmax_turns_back_when_equation_8_reaches_no_further_than_home(mean_grade: float) -> None:
    env = HomewardVectorEnv(mission="OutAndBack")
    policy, s = make_policy("dmax", env), env.batch.setting.shared[0]
    robot, distance_m = env.batch.setting.robot, 0.5 * s["reach_m"]
    out, home = np.arcsin(mean_grade), np.arcsin(-mean_grade)
    ahead_m = 2.0 * s["decision_s"] * s["cruise_mps"]
    needed = (distance_m + ahead_m) / d_max(robot, 1.0, home) + ahead_m / d_max(robot, 1.0, out)
    threshold = needed + RESERVES["dmax"]["OutAndBack"]
    seen = {"distance": 0.5, "grade_mean": 10.0 * mean_grade}
    assert mode(policy, observed(energy=threshold + 1e-3, **seen)) == GO
    assert mode(policy, observed(energy=threshold - 1e-3, **seen)) == RETURN


def test_dmax_mapped_turns_back_when_the_margin_is_down_to_the_reserve() -> None:
    env = HomewardVectorEnv(mission="Survey")
    policy, s, robot = make_policy("dmax_mapped", env), env.batch.setting.shared[0], env.batch.setting.robot
    idle_w, sensing_w = ancillary_power(robot, np.array([0.0, robot.max_sensing_hz]))
    ahead_s = 2.0 * s["decision_s"]
    ahead = 2.0 * ahead_s / d_max(robot, 1.0) + ahead_s * (sensing_w - idle_w) / robot.usable_energy_j
    threshold = ahead + RESERVES["dmax_mapped"]["Survey"]
    assert mode(policy, observed(margin=threshold + 1e-3)) == GO
    assert mode(policy, observed(margin=threshold - 1e-3)) == RETURN


def drive(rule: AdaptiveDmaxRule, ratios: NDArray[np.float64], sensing: NDArray[np.float64]) -> tuple[float, float]:
    """Spare energy, and what it falls by per home cost, after decisions of given consumption over the model's.

    Sensing, where it is on, takes what the file says times 1.1; the rest of the modelled energy takes its ratio.
    """
    setting = settle(Options("Survey"))
    s, robot = setting.shared[0], setting.robot
    used, modelled = 0.0, 0.0
    spare: Any = rule.spare(observed(), FIRST)
    for ratio, rate in zip(ratios, sensing, strict=True):
        extra_w = ancillary_power(robot, rate * s["max_sensing_hz"]) - ancillary_power(robot, 0.0)
        extra = extra_w * s["decision_s"] / s["usable_j"]
        used += 0.005 * ratio + 1.1 * extra
        modelled += 0.005 + extra
        state = {"energy": 1.0 - used, "modelled": modelled, "sensing": rate}
        spare = rule.spare(observed(**state), np.zeros(1, np.bool_))
    nothing_passed = observed(**state, home_cost=0.2)
    nothing_passed[0, INDEX["sensing"]] = 0.0
    farther = rule.spare(nothing_passed, np.zeros(1, np.bool_))
    return float(spare[0]), float((spare - farther)[0] / 0.2)


def adaptive(deviations: float) -> AdaptiveDmaxRule:
    return AdaptiveDmaxRule(settle(Options("Survey")), Pace(1.0, 0.0, 0.9), deviations)


@pytest.mark.parametrize("ratio", [0.8, 1.0, 1.5])
def test_adaptive_scales_the_way_home_by_what_driving_took(ratio: float) -> None:
    silent, mixed = np.zeros(60), np.tile([1.0, 0.0], 30)
    for sensing in (silent, mixed):
        _, scale = drive(adaptive(0.0), np.full(60, ratio), sensing)
        assert scale == pytest.approx(ratio, abs=0.03)


def test_adaptive_keeps_more_back_where_consumption_varies() -> None:
    steady, varied = np.full(60, 1.2), np.tile([0.9, 1.5], 30)
    silent = np.zeros(60)
    no_reserve = drive(adaptive(0.0), steady, silent)[1]
    assert drive(adaptive(1.0), steady, silent)[1] == pytest.approx(no_reserve + 0.1, abs=1e-3)
    assert drive(adaptive(1.0), varied, silent)[1] == pytest.approx(no_reserve + np.hypot(0.1, 0.3), abs=0.02)


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize("mission", ["OutAndBack", "Survey"])
def test_rules_turn_back_at_the_far_end_and_when_time_runs_out(name: str, mission: str) -> None:
    env = HomewardVectorEnv(mission=mission)
    s = env.batch.setting.shared[0]
    end = float(s["length_m"] / s["reach_m"])
    assert mode(make_policy(name, env), observed(margin=1.0, distance=0.5 * end)) == GO
    assert mode(make_policy(name, env), observed(margin=1.0, distance=end)) == RETURN
    assert mode(make_policy(name, env), observed(margin=1.0, distance=0.5 * end, time=0.9)) == RETURN


@pytest.mark.parametrize("name", RULES)
def test_patrols_turn_back_at_the_home_post_only(name: str) -> None:
    policy = make_policy(name, HomewardVectorEnv(mission="Patrol"))
    assert mode(policy, observed(energy=0.02, margin=0.02, distance=0.0)) == RETURN
    assert mode(policy, observed(energy=0.02, margin=0.02, distance=0.01)) == GO
    assert mode(policy, observed(energy=0.9, margin=0.9, distance=0.0)) == GO


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("name", [*RULES, "planner"])
def test_it_heads_home_where_its_rule_turns(name: str, action_type: str) -> None:
    env = HomewardVectorEnv(mission="Survey", action_type=action_type)
    shown = np.concatenate(
        [observed(energy=energy, distance=0.3, home_cost=0.2, margin=energy - 0.2) for energy in (1.0, 0.8, 0.1, 1.0)]
    )
    shown[3, INDEX["returning"]] = 1.0
    policies = [make_policy(name, env) for _ in range(2)]
    rule = policies[0].rule if isinstance(policies[0], Planner) else policies[0]
    assert isinstance(rule, TurnBackRule)
    turns = rule.turns(shown, np.ones(4, np.bool_))
    assert turns.tolist() == [False, False, True, True]
    commands = decode_actions(env.batch.setting, policies[1].act(shown, np.ones(4, np.bool_)))
    np.testing.assert_array_equal(commands.homeward, turns)


@pytest.mark.parametrize("name", RULES)
def test_rules_keep_heading_home_and_sense_nothing_there(name: str) -> None:
    policy = make_policy(name, HomewardVectorEnv())
    action = policy.act(observed(margin=1.0, distance=0.3, returning=1.0, interest=5.0), FIRST)
    assert action.tolist() == [[4, 0, RETURN]]


def test_pace_senses_where_it_pays_and_stops_while_the_memory_is_full() -> None:
    setting, pace = settle(Options("Survey")), Pace(rate=0.75, interest=1.0, full=0.8)
    out = np.zeros(1, np.bool_)
    assert pace.act(setting, observed(interest=0.51), out).tolist() == [[4, 3, GO]]
    assert pace.act(setting, observed(interest=0.49), out).tolist() == [[4, 0, GO]]
    assert pace.act(setting, observed(interest=0.51, backlog=0.81), out).tolist() == [[4, 0, STOP]]
    assert pace.act(setting, observed(interest=0.49, backlog=0.81), out).tolist() == [[4, 0, GO]]
    assert NO_SENSING.act(setting, observed(interest=2.0), out).tolist() == [[4, 0, GO]]


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


def test_a_mission_that_begins_finds_nothing_of_the_one_before() -> None:
    options = Options("Survey")
    env = HomewardVectorEnv(**vars(options))
    used, fresh = make_policy("dmax_adaptive", env), make_policy("dmax_adaptive", env)
    run_episodes(used, options, episode_seeds(3, 4))
    seeds = episode_seeds(4, 4)
    again, first = (run_episodes(policy, options, seeds).episodes for policy in (used, fresh))
    np.testing.assert_array_equal(again.score, first.score)
    np.testing.assert_array_equal(again.energy_left_j, first.energy_left_j)


@pytest.mark.parametrize("mission", MISSIONS)
@pytest.mark.parametrize("name", ["dmax", "dmax_mapped", "dmax_adaptive"])
def test_tuned_rules_come_home_when_all_is_known(name: str, mission: str) -> None:
    assert episodes(name, Options(mission, difficulty="known"), 150).home.all()


def test_adaptive_beats_half_a_charge_on_uncertain_surveys() -> None:
    options = Options("Survey", difficulty="uncertain")
    gain = episodes("dmax_adaptive", options, 200).score - episodes("soc50", options, 200).score
    assert gain.mean() > 3.0 * gain.std() / np.sqrt(len(gain))


@pytest.mark.parametrize("name", ["dmax_mapped", "dmax_adaptive"])
def test_hidden_wind_fools_rules_that_extrapolate(name: str) -> None:
    usual = episodes(name, Options("OutAndBack"), 200).stranded.mean()
    fooled = episodes(name, Options("OutAndBack", route="hidden_wind"), 200).stranded.mean()
    assert usual < 0.1
    assert fooled > 0.4


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("name", sorted(AGENTS.keys() - FROM_FILES))
def test_actions_are_in_the_space(name: str, action_type: str) -> None:
    env = gym.make_vec(
        "homeward/Survey-v0", num_envs=5, vectorization_mode="vector_entry_point", action_type=action_type
    )
    observations, _ = env.reset(seed=0)
    assert env.action_space.contains(make_policy(name, env).act(observations, np.ones(5, np.bool_)))


def test_random_draws_evenly_and_repeatably() -> None:
    env = HomewardVectorEnv(3000)
    observations, begun = np.zeros((3000, len(NAMES)), np.float32), np.ones(3000, np.bool_)
    first, again, other = (make_policy("random", env, seed=seed).act(observations, begun) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    for column, levels in enumerate((5, 5, 3)):
        assert np.bincount(first[:, column]) == pytest.approx(np.full(levels, 3000 / levels), rel=0.12)
    box = HomewardVectorEnv(3000, action_type="continuous")
    for column in make_policy("random", box, seed=5).act(observations, begun).T:
        assert np.histogram(column, 10, (-1.0, 1.0))[0] == pytest.approx(np.full(10, 300), rel=0.2)


@pytest.mark.parametrize("scalar", [True, False])
def test_agents_are_made_for_wrapped_environments(scalar: bool) -> None:
    env: Any = (
        gym.make("homeward/Patrol-v0")
        if scalar
        else gym.make_vec("homeward/Patrol-v0", vectorization_mode="vector_entry_point")
    )
    assert mode(make_policy("dmax", env), observed(margin=1.0)) == GO


def test_wrong_requests_say_what_is_allowed() -> None:
    env = HomewardVectorEnv()
    with pytest.raises(AgentError, match=r"unknown agent 'soc5'.*random, soc50, dmax"):
        make_policy("soc5", env)
    with pytest.raises(AgentError, match="takes no file"):
        make_policy("dmax", env, "file")
    with pytest.raises(AgentError, match=r"no/such.*train\.py wrote"):
        make_policy("ppo", env, "no/such")
