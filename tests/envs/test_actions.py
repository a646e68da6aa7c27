"""Commands become actions, and the environment carries out the commands."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward.envs.actions import (
    FLAT_ACTIONS,
    LEVELS,
    decode_actions,
    encode_actions,
    flatten_actions,
    unflatten_actions,
)
from homeward.envs.options import OptionError, Options, known_of
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import load_robot


def carried_out(
    env: HomewardVectorEnv, speed: Any, sensing: Any, mode: Any
) -> np.ndarray[Any, Any]:
    """Records after one decision, as commanded, by missions that stood at a fair distance from
    home."""
    env.reset(seed=0)
    away = encode_actions(
        env.batch.known, env.batch.known.robot.max_speed_mps, 0.0, np.full(env.num_envs, GO)
    )
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
        np.linspace(file.min_speed_mps, file.max_speed_mps, LEVELS),
        np.linspace(0.0, file.max_sensing_hz, LEVELS),
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
    """A return heads home at once, and is not final yet."""
    env = HomewardVectorEnv(3, action_type=action_type)
    records = carried_out(env, 0.5, 0.0, np.array([STOP, GO, RETURN]))
    assert records["asked"].tolist() == [0, 0, 1] and not records["returning"].any()
    assert (records["speed_mps"] > 0.0).tolist() == [False, True, True]
    away_m = float(records["furthest_m"][0])
    moved_m = records["position_m"] - away_m
    assert moved_m.tolist() == pytest.approx([0.0, -moved_m[2], -0.5 * 30.0], rel=0.2)


@pytest.mark.parametrize("robot", ["rusti_computer", "jackal"])
@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_what_is_decoded_is_what_is_carried_out(action_type: str, robot: str) -> None:
    """Any action of the space, by the two forms of the code: arrays for agents, compiled for the
    step."""
    env = HomewardVectorEnv(64, action_type=action_type, robot=robot)
    env.reset(seed=0)
    env.action_space.seed(3)
    for _ in range(3):
        actions = env.action_space.sample()
        before_m, asked = env.batch.records["position_m"].copy(), env.batch.records["asked"].copy()
        env.step(actions)
        commands, records = decode_actions(env.batch.known, actions), env.batch.records
        np.testing.assert_allclose(records["sensing_hz"], commands.sensing_hz, rtol=1e-6, atol=1e-5)
        np.testing.assert_array_equal(records["asked"], np.where(commands.returns, asked + 1, 0))
        outwards, decision_s = commands.mode == GO, env.batch.known.shared["decision_s"]
        moved_m = records["position_m"] - before_m
        np.testing.assert_allclose(
            moved_m[outwards], (decision_s * commands.driven_mps)[outwards], rtol=1e-6
        )
        assert (records["position_m"][~outwards] <= before_m[~outwards]).all()
        assert (commands.driven_mps[commands.mode == STOP] == 0.0).all()


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_commands_survive_the_way_through_an_action(action_type: str) -> None:
    known = known_of(Options("Survey", action_type=action_type))
    share, mode = np.linspace(0.0, 1.0, LEVELS), np.array([STOP, GO, RETURN, GO, STOP])
    speed, sensing = 0.1 + 0.9 * share, 100.0 * share[::-1]
    commands = decode_actions(known, encode_actions(known, speed, sensing, mode))
    np.testing.assert_allclose(commands.speed_mps, speed, rtol=1e-6)
    np.testing.assert_allclose(commands.sensing_hz, sensing, atol=1e-5)
    np.testing.assert_array_equal(commands.mode, mode)
    np.testing.assert_array_equal(commands.returns, mode == RETURN)
    np.testing.assert_array_equal(commands.driven_mps == 0.0, mode == STOP)


def test_the_thirds_of_a_continuous_mode_are_the_same_in_both_forms() -> None:
    """At their borders too, in single precision."""
    borders = np.array([-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0], np.float32)
    modes = np.unique(
        np.concatenate(
            [np.nextafter(borders, np.float32(side)) for side in (-1.0, 1.0)] + [borders]
        )
    )
    env = HomewardVectorEnv(len(modes), action_type="continuous", decision_s=30.0)
    env.reset(seed=0)
    actions = np.column_stack((np.zeros((len(modes), 2)), modes)).astype(np.float32)
    env.step(actions)
    commands, records = decode_actions(env.batch.known, actions), env.batch.records
    np.testing.assert_array_equal(records["asked"] > 0, commands.returns)
    np.testing.assert_array_equal(records["position_m"] > 0.0, commands.mode == GO)


@given(speed=st.floats(-1.0, 9.0), sensing=st.floats(-10.0, 900.0), discrete=st.booleans())
def test_commands_beyond_the_limits_become_the_limits(
    speed: float, sensing: float, discrete: bool
) -> None:
    env = HomewardVectorEnv(1, action_type="discrete" if discrete else "continuous")
    known = env.batch.known
    assert env.action_space.contains(encode_actions(known, [speed], sensing, GO))
    limited = encode_actions(known, [np.clip(speed, 0.1, 1.0)], np.clip(sensing, 0.0, 100.0), GO)
    np.testing.assert_array_equal(encode_actions(known, [speed], sensing, GO), limited)


def test_a_robot_with_one_speed_drives_at_it() -> None:
    robot = dataclasses.replace(load_robot("rusti"), min_speed_mps=0.5, max_speed_mps=0.5)
    records = carried_out(HomewardVectorEnv(1, robot=robot), [0.5], 0.0, GO)
    assert records["speed_mps"].tolist() == [0.5]


def test_every_flat_action_is_one_discrete_action() -> None:
    numbers = np.arange(FLAT_ACTIONS)
    parts = unflatten_actions(numbers)
    assert len({tuple(one) for one in parts.tolist()}) == FLAT_ACTIONS == 75
    np.testing.assert_array_equal(flatten_actions(parts), numbers)
    flat, discrete = (
        HomewardVectorEnv(FLAT_ACTIONS, mission="OutAndBack", action_type=name)
        for name in ("flat", "discrete")
    )
    for env in (flat, discrete):
        env.reset(seed=0)
    for _ in range(4):
        for ours, theirs in zip(flat.step(numbers)[:4], discrete.step(parts)[:4], strict=True):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ([0, 75], "action 75 of env 1 is not allowed; give a whole number from 0 to 74"),
        ([-1, 0], "action -1 of env 0 is not allowed"),
        (
            [0.5, 1.0],
            r"flat actions have shape \(2,\) and dtype float64; give one whole number for each mission",
        ),
        ([[0, 0, 1], [0, 0, 1]], r"flat actions have shape \(2, 3\)"),
        (
            [0, 1, 2],
            r"flat actions have shape \(3,\) and dtype int64; give one whole number for each mission",
        ),
    ],
)
def test_what_is_no_flat_action_is_refused(numbers: Any, expected: str) -> None:
    env = HomewardVectorEnv(2, action_type="flat")
    env.reset(seed=0)
    with pytest.raises(OptionError, match=expected):
        env.step(np.array(numbers))
