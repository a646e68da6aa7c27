"""Agents are made by name for any environment, and act in its space."""

import dataclasses
import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

from homeward.agents import AGENTS, AgentError, Policy, make_policy
from homeward.agents.base import Observations
from homeward.agents.registry import FROM_FILES, Request
from homeward.envs.actions import encode_actions
from homeward.envs.options import Known, Options, known_of
from homeward.envs.state import GO, STOP
from homeward.envs.vector import HomewardVectorEnv
from tests.agents.rules.shown import mode, observed


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("name", sorted(AGENTS.keys() - FROM_FILES))
def test_actions_are_in_the_space(name: str, action_type: str) -> None:
    env = gym.make_vec(
        "homeward/Survey-v0",
        num_envs=5,
        vectorization_mode="vector_entry_point",
        action_type=action_type,
    )
    observations, _ = env.reset(seed=0)
    assert env.action_space.contains(make_policy(name, env).act(observations, np.ones(5, np.bool_)))


@pytest.mark.parametrize("name", sorted(AGENTS.keys() - FROM_FILES))
def test_agents_are_made_from_what_is_known_alone(name: str) -> None:
    """And from a copy of it, through which nothing leads to the environment."""
    options = Options("Survey", difficulty="harsh")
    env = HomewardVectorEnv(3, **vars(options))
    observations, _ = env.reset(seed=0)
    begun = np.ones(3, np.bool_)
    known = pickle.loads(pickle.dumps(known_of(options)))
    assert {field.name for field in dataclasses.fields(Known)} == {
        "mission", "robot", "shared", "difficulty", "instruments"
    }  # fmt: skip
    actions = AGENTS[name](Request(known)).act(observations, begun)
    np.testing.assert_array_equal(actions, make_policy(name, env).act(observations, begun))


@pytest.mark.parametrize("scalar", [True, False])
def test_agents_are_made_for_wrapped_environments(scalar: bool) -> None:
    env: Any = (
        gym.make("homeward/Patrol-v0")
        if scalar
        else gym.make_vec("homeward/Patrol-v0", vectorization_mode="vector_entry_point")
    )
    assert mode(make_policy("dmax", env), observed(margin=1.0, east=1.0)) == GO


def standing(known: Known) -> Policy:
    """A factory of an agent that stands for ever."""

    class Standing(Policy):
        def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
            return encode_actions(known, np.zeros(len(begun)), 0.0, STOP)

    return Standing()


def test_an_agent_of_ones_own_comes_from_its_factory() -> None:
    env = HomewardVectorEnv(3)
    policy = make_policy("mine", env, "tests.agents.test_registry:standing")
    observations, _ = env.reset(seed=0)
    assert env.action_space.contains(policy.act(observations, np.ones(3, np.bool_)))
    with pytest.raises(AgentError, match=r"no_such.*give package\.module:factory"):
        make_policy("mine", env, "no_such:factory")
    with pytest.raises(AgentError, match=r"returns a str, not a homeward\.agents\.Policy"):
        make_policy("mine", env, "builtins:repr")


def test_wrong_requests_say_what_is_allowed() -> None:
    env = HomewardVectorEnv()
    with pytest.raises(AgentError, match=r"unknown agent 'soc5'.*random, soc50, dmax"):
        make_policy("soc5", env)
    with pytest.raises(AgentError, match="takes no file"):
        make_policy("dmax", env, "file")
    with pytest.raises(AgentError, match=r"no/such.*homeward train` wrote"):
        make_policy("ppo", env, "no/such")


def test_flat_actions_are_no_actions_of_agents() -> None:
    with pytest.raises(
        AgentError,
        match="three parts of an action, not its flat number; choose action_type 'discrete'",
    ):
        make_policy("dmax", HomewardVectorEnv(2, action_type="flat"))
