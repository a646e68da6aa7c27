"""Learners so small that an update takes milliseconds."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO

from homeward.agents.learning.ppo import make_model
from homeward.agents.learning.settings import PPOSettings
from homeward.envs.options import Options

SETTINGS = PPOSettings(start="scratch", n_envs=8, n_steps=4, batch_size=32, epochs=1, hidden=8)
OPTIONS = Options("Survey", decision_s=120.0)


def learner(options: Options = OPTIONS, seed: int = 0, **changes: Any) -> PPO:
    return make_model(options, dataclasses.replace(SETTINGS, **changes), seed)


def seen(model: PPO) -> NDArray[np.float32]:
    """Inputs of the missions' beginnings, with some noise so that no two are alike."""
    env = model.get_env()
    assert env is not None
    inputs = np.asarray(env.reset())
    noise = np.random.default_rng(0).normal(0.0, 0.1, inputs.shape)
    return np.asarray(inputs + noise, dtype=np.float32)


def parameters(model: PPO) -> dict[str, torch.Tensor]:
    return {name: value.detach().clone() for name, value in model.policy.state_dict().items()}
