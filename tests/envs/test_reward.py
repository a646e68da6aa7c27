"""What a mission pays: its score on coming home, and a potential from d_max that changes no optimal policy."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from homeward.envs.difficulty import DIFFICULTIES
from homeward.envs.options import ACTION_TYPES
from homeward.envs.state import GO, RETURN, STOP
from tests.envs.rollouts import MISSIONS, drive, feature, make, mission, random_actions


@pytest.mark.parametrize("discount", [1.0, 0.997, 0.6])
@pytest.mark.parametrize("difficulty", DIFFICULTIES)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_shaped_rewards_telescope(mission_id: str, difficulty: str, discount: float) -> None:
    """Discounted, they sum to the discounted final score less the potential of the start, whatever is done."""
    env = make(mission_id, difficulty=difficulty, discount=discount)
    scale = float(env.batch.known.shared["score_scale"][0])
    rng, ends = np.random.default_rng(5), set()
    for seed, home in itertools.product(range(6), (0.0, 0.15)):
        env.reset(seed=seed)
        start = float(mission(env)["potential"])
        assert start > 0.0
        steps = list(drive(env, random_actions(rng, "discrete", 60, home)))
        weights = discount ** np.arange(len(steps) + 1)
        for step in steps:
            assert step.reward == sum(step.info["reward_terms"].values())
            assert (step.info["reward_terms"]["score"] > 0.0) <= step.info["home"]
        paid = float(weights[:-1] @ [step.reward for step in steps])
        last = steps[-1]
        final = last.info["score"] / scale * weights[-2] if last.info["home"] else 0.0
        left = float(mission(env)["potential"]) * weights[-1]
        assert (left == 0.0) or last.truncated
        assert paid == pytest.approx(final + left - start, abs=1e-12)
        ends.add((bool(last.info["home"]), bool(last.truncated)))
    assert len(ends) >= 2


@pytest.mark.parametrize("action_type", ACTION_TYPES)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_without_shaping_the_score_is_paid_at_home_and_nothing_else(mission_id: str, action_type: str) -> None:
    env = make(mission_id, shaping="none", action_type=action_type)
    scale = float(env.batch.known.shared["score_scale"][0])
    rng, home = np.random.default_rng(5), 0
    for seed in range(10):
        env.reset(seed=seed)
        *before, last = drive(env, random_actions(rng, action_type, 60, home=0.1))
        assert [step.reward for step in before] == [0.0] * len(before)
        assert last.info["reward_terms"] == {"score": last.reward, "shaping": 0.0}
        assert last.reward == (pytest.approx(last.info["score"] / scale) if last.info["home"] else 0.0)
        assert last.info["cost"] == float(last.info["stranded"])
        home += last.info["home"]
    assert home > 2


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_shaping_changes_rewards_and_nothing_else(mission_id: str) -> None:
    shaped, plain = make(mission_id, shaping="dmax"), make(mission_id, shaping="none")
    np.testing.assert_array_equal(shaped.reset(seed=8)[0], plain.reset(seed=8)[0])
    actions = random_actions(np.random.default_rng(5), "discrete", 60)
    rewards = []
    for one, other in zip(drive(shaped, actions), drive(plain, actions), strict=True):
        np.testing.assert_array_equal(one.observation, other.observation)
        assert one[2:4] == other[2:4] and one.info["score"] == other.info["score"]
        rewards.append((one.reward, other.reward))
    assert any(one != other for one, other in rewards)


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_stranding_pays_less_than_coming_home(mission_id: str) -> None:
    returns = {}
    for last_mode in (GO, RETURN):
        env = make(mission_id, difficulty="known", discount=1.0, decision_s=60.0)
        env.reset(seed=1)
        actions = itertools.chain([[4, 2, GO]] * 20, itertools.repeat([4, 2, last_mode], 200))
        steps = list(drive(env, actions))
        assert steps[-1].info["home"] == (last_mode == RETURN)
        returns[last_mode] = sum(step.reward for step in steps)
    assert returns[GO] < returns[RETURN]


@pytest.mark.parametrize("action_type", ACTION_TYPES)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_the_return_latches(mission_id: str, action_type: str) -> None:
    """From then on the robot heads home whether told to go or to return; a stop is still a stop."""
    env = make(mission_id, action_type=action_type, difficulty="known", decision_s=60.0)
    env.reset(seed=2)

    def act(speed: int, mode: int) -> tuple[float, bool]:
        if action_type == "discrete":
            *_, info = env.step([speed, 0, mode])
        else:
            *_, info = env.step(np.array([0.5 * speed - 1.0, -1.0, (mode - 1) * 2.0 / 3.0], np.float32))
        return info["position_m"], bool(mission(env)["returning"])

    out_m, returning = act(4, GO)
    assert out_m == pytest.approx(60.0) and not returning
    positions = [act(1, mode) for mode in (RETURN, GO, STOP, GO)]
    assert all(returning for _, returning in positions)
    first, second, third, fourth = (position for position, _ in positions)
    assert out_m > first > second == third > fourth > 0.0
    assert first - second == pytest.approx((0.1 + 0.9 / 4) * 60.0)


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_going_home_at_once_is_worth_nothing(mission_id: str) -> None:
    env = make(mission_id, shaping="none")
    env.reset(seed=2)
    step = next(drive(env, [[4, 4, RETURN]]))
    assert step.terminated and step.info["home"] and step.info["score"] == step.reward == 0.0
    assert feature(step.observation, "returning") == 1.0
