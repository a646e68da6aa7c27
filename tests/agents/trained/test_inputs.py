"""What a policy sees beside the observation, and the policies that training starts from."""

import numpy as np
import pytest

from homeward.agents.base import Policy
from homeward.agents.evaluation import run_episodes
from homeward.agents.registry import AGENTS, Request
from homeward.agents.trained.inputs import COLUMNS, first_policy, inputs_from, make_inputs
from homeward.agents.trained.policy_file import ON_THE_GO, NetworkPolicy
from homeward.envs.actions import action_space
from homeward.envs.features import INDEX, NAMES
from homeward.envs.options import Options, known_of
from homeward.envs.state import GO, RETURN
from homeward.envs.vector import HomewardVectorEnv

AT = {name: len(NAMES) + index for index, (name, _) in enumerate(COLUMNS)}


def first(options: Options, *, by_rule: bool) -> NetworkPolicy:
    known = known_of(options)
    inputs = make_inputs(known) if by_rule else None
    layers, space = (first_policy(known, inputs),), action_space(options.action_type == "discrete")
    return NetworkPolicy(layers, space, ON_THE_GO, inputs)


def driven(policy: Policy, options: Options) -> tuple[float, float]:
    episodes = run_episodes(policy, options, range(100)).episodes
    return float(episodes.score.mean()), float(episodes.stranded.mean())


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_out_and_back_the_first_policy_is_the_rule(action_type: str) -> None:
    options = Options("OutAndBack", action_type=action_type, decision_s=90.0)
    ours, _ = driven(first(options, by_rule=True), options)
    theirs, _ = driven(AGENTS["dmax_belief"](Request(known_of(options))), options)
    assert ours == pytest.approx(theirs, rel=0.05)


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("mission", ["Survey", "Patrol"])
def test_the_first_policy_comes_home_by_the_rule(mission: str, action_type: str) -> None:
    options = Options(mission, action_type=action_type, decision_s=90.0)
    score, stranded = driven(first(options, by_rule=True), options)
    theirs, _ = driven(AGENTS["dmax_belief"](Request(known_of(options))), options)
    assert score > 0.6 * theirs
    assert stranded < 0.2  # decisions are long


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_from_scratch_it_knows_nothing_of_energy(action_type: str) -> None:
    options = Options("OutAndBack", action_type=action_type)
    policy = first(options, by_rule=False)
    weight, _ = policy.layers[0]
    used = {name for name in NAMES if np.abs(weight[:, INDEX[name]]).max() > 0.0}
    assert used <= {"returning"}
    assert driven(policy, options)[0] == 0.0


def test_nothing_is_believed_once_the_return_is_final() -> None:
    env = HomewardVectorEnv(4, mission="OutAndBack")
    inputs = make_inputs(env.batch.known)
    observations, _ = env.reset(seed=0)
    begun = np.ones(4, np.bool_)
    seen = inputs(observations, begun)
    for decision in range(40):
        mode = np.where((np.arange(4) < 2) & (decision >= 30), RETURN, GO)
        observations, *_ = env.step(np.stack((np.full(4, 4), np.zeros(4, np.int64), mode), axis=1))
        seen = inputs(observations, np.zeros(4, np.bool_))
        assert np.isfinite(seen).all()
    np.testing.assert_array_equal(seen[:, : len(NAMES)], observations)
    assert (seen[:2, len(NAMES) :] == 0.0).all()
    assert (seen[2:, AT["deviation"]] > 0.0).all()
    assert (np.abs(seen[:, AT["spare"]]) <= 1.0).all()


def test_a_description_makes_equal_inputs() -> None:
    env = HomewardVectorEnv(8, mission="Survey")
    ours = make_inputs(env.batch.known)
    theirs = inputs_from(ours.description, env.batch.known)
    observations, _ = env.reset(seed=3)
    for decision in range(20):
        begun = np.full(8, decision == 0)
        np.testing.assert_array_equal(ours(observations, begun), theirs(observations, begun))
        observations, *_ = env.step(np.tile([4, 2, 1], (8, 1)))
