"""Models of Stable-Baselines3 act as agents: also a DQN, which needs one list of actions."""

from __future__ import annotations

import numpy as np
from stable_baselines3 import DQN, PPO

from homeward.agents.learning import sb3_vec_env, scratch_start, unseen_episodes
from homeward.agents.learning.sb3_policy import SB3Policy
from homeward.envs.actions import FLAT_ACTIONS


def test_a_dqn_learns_on_flat_actions() -> None:
    env = sb3_vec_env("homeward/OutAndBack-v0", 8, action_type="flat", decision_s=120.0)
    model = DQN(
        "MlpPolicy", env, learning_starts=64, batch_size=32, buffer_size=1000, seed=0, device="cpu"
    )
    before = [parameter.detach().clone() for parameter in model.q_net.parameters()]
    model.learn(512)
    after = list(model.q_net.parameters())
    assert any((one != other).any() for one, other in zip(before, after, strict=True))
    assert model.replay_buffer is not None
    assert model.replay_buffer.actions[: model.replay_buffer.pos].max() < FLAT_ACTIONS
    actions = SB3Policy(model).act(np.asarray(env.reset()), np.ones(8, np.bool_))
    assert actions.shape == (8, 3)
    assert len(unseen_episodes(model, env, 3).score) == 3


def test_the_first_policy_cruises_and_continues_a_return() -> None:
    env = sb3_vec_env("homeward/OutAndBack-v0", 4)
    model = PPO(env=env, **scratch_start(env, hidden=8), seed=0, device="cpu")
    going, returning = np.asarray(env.reset()), np.asarray(env.reset())
    cruise = SB3Policy(model).act(going, np.ones(4, np.bool_))
    assert cruise[:, 1:].tolist() == [[0, 1]] * 4  # no sensing, go
    env.step(np.array([[4, 0, 2]] * 4))
    env.step(np.array([[4, 0, 2]] * 4))
    returning = np.asarray(env.missions._last_observations)
    assert SB3Policy(model).act(returning, np.zeros(4, np.bool_))[:, 2].tolist() == [2] * 4
