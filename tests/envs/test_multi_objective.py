"""The vector of rewards: its entries are what the environment tells, and MO-Gymnasium's tools take
it."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from homeward.envs import IDS, MULTI_OBJECTIVE_IDS
from homeward.envs.multi_objective import OBJECTIVES, MultiObjectiveEnv
from homeward.envs.options import OptionError
from tests.envs.rollouts import MISSIONS, SHORT_S, make, random_actions


def totals(env: Any, seed: int, actions: Any) -> tuple[Any, dict[str, Any], int]:
    """Sum of the rewards of a mission, what it told last, and its decisions."""
    env.reset(seed=seed)
    rewards = []
    for action in actions:
        _, reward, terminated, truncated, info = env.step(action)
        rewards.append(reward)
        if terminated or truncated:
            break
    return np.sum(rewards, axis=0), info, len(rewards)


@pytest.mark.parametrize("mission", MISSIONS)
def test_objectives_sum_to_what_the_mission_told(mission: str) -> None:
    env = MultiObjectiveEnv(mission=mission, shaping="none", decision_s=SHORT_S)
    shared = env.batch.known.shared[0]
    ends = set()
    for seed in range(12):
        actions = random_actions(np.random.default_rng(seed), "discrete", 60)
        rewards, info, decisions = totals(env, seed, actions)
        totalled = dict(zip(OBJECTIVES, rewards.tolist(), strict=True))
        home_score = info["score"] if info["home"] else 0.0
        assert totalled["reward"] == pytest.approx(home_score / shared["score_scale"], rel=1e-5)
        assert totalled["stranding"] == -float(info["stranded"])
        assert totalled["energy"] * shared["usable_j"] == pytest.approx(
            -info["energy_j"].total(), rel=1e-5
        )
        assert totalled["time"] * shared["max_decisions"] == pytest.approx(-decisions, rel=1e-5)
        ends.add((info["home"], info["stranded"]))
    assert {(True, False), (False, True)} <= ends


@pytest.mark.parametrize("shaping", ["none", "dmax"])
def test_rewards_are_those_of_the_environment_with_one(shaping: str) -> None:
    vector, scalar = (
        MultiObjectiveEnv(shaping=shaping, decision_s=SHORT_S),
        make("Survey", shaping=shaping),
    )
    vector.reset(seed=3)
    scalar.reset(seed=3)
    for action in random_actions(np.random.default_rng(3), "discrete", 60):
        (seen, rewards, *ended, objective_info), (other, reward, *also, info) = (
            vector.step(action),
            scalar.step(action),
        )
        np.testing.assert_array_equal(seen, other)
        assert (rewards[0], ended, objective_info["score"]) == (
            np.float32(reward),
            also,
            info["score"],
        )
        assert rewards.dtype == np.float32 and vector.reward_space.contains(rewards)
        if any(ended):
            break
    assert any(ended)


def test_ids_are_made_without_shaping_unless_asked() -> None:
    assert set(MULTI_OBJECTIVE_IDS) == set(IDS)
    for mission, env_id in MULTI_OBJECTIVE_IDS.items():
        env: Any = gym.make(env_id).unwrapped
        assert (env.options.mission, env.options.shaping, env.reward_space.shape) == (
            mission,
            "none",
            (4,),
        )
    shaped: Any = gym.make(
        "homeward:homeward/MOPatrol-v0", shaping="dmax", difficulty="harsh"
    ).unwrapped
    assert (shaped.options.shaping, shaped.options.difficulty) == ("dmax", "harsh")
    with pytest.raises(OptionError, match="speed"):
        gym.make("homeward/MOSurvey-v0", speed=1)


def test_mo_gymnasium_takes_them() -> None:
    mo_gym = pytest.importorskip("mo_gymnasium")
    from mo_gymnasium.wrappers import LinearReward, MORecordEpisodeStatistics
    from mo_gymnasium.wrappers.vector import MOSyncVectorEnv

    def made(**options: Any) -> Any:
        return mo_gym.make(
            "homeward/MOOutAndBack-v0", decision_s=SHORT_S, shaping="dmax", **options
        )

    actions = random_actions(np.random.default_rng(0), "discrete", 60)
    linear, scalar = LinearReward(made(), np.array([1.0, 0.0, 0.0, 0.0])), make("OutAndBack")
    linear.reset(seed=0)
    scalar.reset(seed=0)
    for action in actions:
        _, weighed, *ended, info = linear.step(action)
        _, reward, *also, _ = scalar.step(action)
        assert (weighed, ended) == (pytest.approx(reward, rel=1e-6, abs=1e-9), also)
        assert info["vector_reward"].shape == (4,)
        if any(ended):
            break
    assert any(ended)

    returns, _, decisions = totals(recorded := MORecordEpisodeStatistics(made()), 0, actions)
    np.testing.assert_allclose(recorded.return_queue[0], returns, rtol=1e-5)
    assert recorded.length_queue[0] == decisions

    side_by_side = MOSyncVectorEnv([made, made])
    alone = made()
    side_by_side.reset(seed=[1, 2])
    alone.reset(seed=2)
    assert side_by_side.reward_space == alone.unwrapped.reward_space
    for action in actions[:5]:
        rewards = side_by_side.step(np.stack((action, action)))[1]
        assert rewards.shape == (2, 4)
        np.testing.assert_array_equal(rewards[1], alone.step(action)[1])
