"""Commands become actions, and the environment carries out the commands."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward.envs.actions import LEVELS, encode_actions
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import load_robot


def carried_out(env: HomewardVectorEnv, speed: Any, sensing: Any, mode: Any) -> np.ndarray[Any, Any]:
    """Records after one decision, as commanded, by missions that stood at a fair distance from home."""
    env.reset(seed=0)
    away = encode_actions(env.batch.known, env.batch.known.robot.max_speed_mps, 0.0, np.full(env.num_envs, GO))
    env.step(away)
    actions = encode_actions(env.batch.known, speed, sensing, mode)
    assert env.action_space.contains(actions)
    env.step(actions)
    return env.batch.records


@pytest.mark.parametrize("robot", ["rusti_computer", "jackal"])
def test_every_level_comes_back_from_the_discrete_environment(robot: str) -> None:
    env = HomewardVectorEnv(LEVELS * LEVELS, robot=robot)
    file = env.batch.known.robot
    speed, sensing = np.meshgrid(
        np.linspace(file.min_speed_mps, file.max_speed_mps, LEVELS), np.linspace(0.0, file.max_sensing_hz, LEVELS)
    )
    records = carried_out(env, speed.ravel(), sensing.ravel(), GO)
    np.testing.assert_allclose(records["speed_mps"], speed.ravel())
    np.testing.assert_allclose(records["sensing_hz"], sensing.ravel())


@pytest.mark.parametrize("robot", ["rusti_computer", "jackal"])
def test_any_command_comes_back_from_the_continuous_environment(robot: str) -> None:
    env = HomewardVectorEnv(32, robot=robot, action_type="continuous")
    file, rng = env.batch.known.robot, np.random.default_rng(0)
    speed = rng.uniform(file.min_speed_mps, file.max_speed_mps, 32)
    sensing = rng.uniform(0.0, file.max_sensing_hz, 32)
    records = carried_out(env, speed, sensing, GO)
    np.testing.assert_allclose(records["speed_mps"], speed, rtol=1e-6)
    np.testing.assert_allclose(records["sensing_hz"], sensing, atol=1e-5)


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_every_mode_comes_back(action_type: str) -> None:
    env = HomewardVectorEnv(3, action_type=action_type)
    records = carried_out(env, 0.5, 0.0, np.array([STOP, GO, RETURN]))
    assert records["returning"].tolist() == [False, False, True]
    assert records["direction"].tolist() == [1.0, 1.0, -1.0]
    assert (records["speed_mps"] > 0.0).tolist() == [False, True, True]


@given(speed=st.floats(-1.0, 9.0), sensing=st.floats(-10.0, 900.0), discrete=st.booleans())
def test_commands_beyond_the_limits_become_the_limits(speed: float, sensing: float, discrete: bool) -> None:
    env = HomewardVectorEnv(1, action_type="discrete" if discrete else "continuous")
    known = env.batch.known
    assert env.action_space.contains(encode_actions(known, [speed], sensing, GO))
    limited = encode_actions(known, [np.clip(speed, 0.1, 1.0)], np.clip(sensing, 0.0, 100.0), GO)
    np.testing.assert_array_equal(encode_actions(known, [speed], sensing, GO), limited)


def test_a_robot_with_one_speed_drives_at_it() -> None:
    robot = dataclasses.replace(load_robot("rusti"), min_speed_mps=0.5, max_speed_mps=0.5)
    records = carried_out(HomewardVectorEnv(1, robot=robot), [0.5], 0.0, GO)
    assert records["speed_mps"].tolist() == [0.5]
