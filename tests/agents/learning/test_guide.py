"""The guide: the first policy does as it proposes, what is shown twice counts once, and late missions are lost."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch

from homeward.agents.evaluation import episode_seeds, run_episodes
from homeward.agents.learning.guide import BELIEFS, Guide, guide_from, make_guide
from homeward.agents.learning.ppo import deployed, make_model
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.agents.learning.settings import PPOSettings
from homeward.agents.registry import AGENTS, Request
from homeward.envs.features import NAMES
from homeward.envs.options import Options, known_of
from homeward.envs.vector import HomewardVectorEnv

SETTINGS = PPOSettings(n_envs=16, n_steps=8, batch_size=64, epochs=1, hidden=16)


def guide_of(options: Options, name: str = "planner") -> Guide:
    guide = make_guide(name, options.mission, known_of(options))
    assert guide is not None
    return guide


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("mission", ["OutAndBack", "Survey", "Patrol"])
@pytest.mark.parametrize("name", ["dmax_adaptive", "planner"])
def test_the_first_policy_drives_as_its_guide(name: str, mission: str, action_type: str) -> None:
    options = Options(mission, action_type=action_type)
    model = make_model(options, dataclasses.replace(SETTINGS, guide=name), seed=0)
    with torch.no_grad():
        head = model.policy.action_net
        assert isinstance(head, torch.nn.Linear)
        head.weight[:, : SETTINGS.hidden] = 0.0  # all but the proposal
    guide = AGENTS[name](Request(known_of(options), None, 0))
    seeds = episode_seeds(0, 50)
    ours = run_episodes(deployed(model, guide_of(options, name)), options, seeds).episodes
    theirs = run_episodes(guide, options, seeds).episodes
    for name, values in vars(theirs).items():
        np.testing.assert_allclose(getattr(ours, name), values, rtol=1e-4 if action_type == "continuous" else 0.0)


def drive(options: Options, guide: Guide, often: int) -> list[np.ndarray[Any, Any]]:
    """Inputs along a drive, each observation shown some times."""
    env = HomewardVectorEnv(8, autoreset_mode="SameStep", **vars(options))
    observations, _ = env.reset(seed=0)
    begun, inputs = np.ones(8, np.bool_), []
    for _ in range(60):
        for again in range(often):
            inputs.append(guide.inputs(observations, begun & (again == 0)))
        observations, _, terminated, truncated, _ = env.step(np.tile([4, 2, 1], (8, 1)))
        begun = terminated | truncated
    return inputs


def test_what_is_shown_twice_counts_once() -> None:
    options = Options("Survey")
    twice = drive(options, guide_of(options), 2)
    for once, first, second in zip(drive(options, guide_of(options), 1), twice[::2], twice[1::2], strict=True):
        np.testing.assert_array_equal(once, first)
        np.testing.assert_array_equal(once, second)


def test_inputs_are_bounded_and_begin_with_the_observation() -> None:
    options = Options("Survey", difficulty="harsh")
    guide = guide_of(options)
    for inputs in drive(options, guide, 1):
        assert inputs.dtype == np.float32
        assert inputs.shape == (8, len(NAMES) + len(BELIEFS) + guide.proposals)
        assert np.abs(inputs[:, len(NAMES) :]).max() <= 3.0


@pytest.mark.parametrize("name", ["dmax_adaptive", "planner"])
def test_a_guide_comes_back_from_its_description(name: str) -> None:
    options = Options("Survey")
    guide = guide_of(options, name)
    again = guide_from(guide.description, known_of(options))
    for one, other in zip(drive(options, guide, 1), drive(options, again, 1), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("late_is_lost", [False, True])
def test_the_adapter_shows_the_end_of_a_mission_and_the_start_of_the_next(late_is_lost: bool) -> None:
    options = Options("OutAndBack", decision_s=300.0)
    env = HomewardVectorEnv(4, autoreset_mode="SameStep", **vars(options))
    adapter, twin = SB3Adapter(env, 0.0, guide_of(options), late_is_lost=late_is_lost), guide_of(options)
    plain = SB3Adapter(HomewardVectorEnv(4, autoreset_mode="SameStep", **vars(options)))
    for one in (adapter, plain):
        one.seed(0)
    begun, ends = np.ones(4, np.bool_), 0
    inputs: Any = adapter.reset()
    observations: Any = plain.reset()
    for _ in range(60):
        np.testing.assert_array_equal(inputs, twin.inputs(observations, begun))
        inputs, _, begun, infos = adapter.step(np.tile([4, 0, 1], (4, 1)))
        observations, _, _, expected = plain.step(np.tile([4, 0, 1], (4, 1)))
        for i in np.flatnonzero(begun):
            ends += 1
            last = infos[i]["terminal_observation"]
            np.testing.assert_array_equal(last[: len(NAMES)], expected[i]["terminal_observation"])
            assert adapter.observation_space.contains(last)
            assert last[len(NAMES) :].any() != late_is_lost
    assert ends > 4


def test_a_late_mission_keeps_nothing_that_it_hoped_for() -> None:
    """Rewards of shaping add up to minus the hope at the start, where nothing is scored."""
    options = Options("Survey", decision_s=300.0, discount=1.0)
    for lost in (False, True):
        adapter = SB3Adapter(HomewardVectorEnv(4, autoreset_mode="SameStep", **vars(options)), late_is_lost=lost)
        adapter.seed(0)
        adapter.reset()
        hope = adapter.env.batch.records["potential"].copy()
        for _ in range(1000):
            _, _, ended, infos = adapter.step(np.zeros((4, 3), np.int64))  # stands until the time is over
            if ended.any():
                break
        returns = np.array([info["episode"]["r"] for info in infos])
        assert ended.all() and hope.min() > 0.1
        assert all(info["TimeLimit.truncated"] for info in infos) == (not lost)
        if lost:
            np.testing.assert_allclose(returns, -hope, atol=1e-5)
        else:
            assert (returns > -hope + 0.1).all()


def test_training_changes_every_layer_of_a_guided_learner(tmp_path: Any) -> None:
    options = Options("OutAndBack", decision_s=120.0)
    settings = dataclasses.replace(SETTINGS, n_envs=64, n_steps=16, batch_size=256, epochs=2)
    model = make_model(options, settings, seed=0)
    before = [weight.copy() for weight, _ in deployed(model, None).layers]
    model.learn(2 * settings.rollout)
    after = [weight for weight, _ in deployed(model, None).layers]
    assert all((one != other).any() for one, other in zip(before, after, strict=True))
