"""The adapter equals Stable-Baselines3's own wrappers around as many scalar environments."""

import copy
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

import homeward  # noqa: F401 - registers the environments
from homeward.agents.learning import sb3_vec_env
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.agents.trained.inputs import make_inputs
from homeward.envs.features import INDEX, NAMES
from homeward.envs.options import OptionError
from homeward.envs.vector import HomewardVectorEnv

COUNT = 6
DECISION_S = 300.0  # short missions: some forty decisions until the time is over


def native(**options: Any) -> SB3Adapter:
    return SB3Adapter(HomewardVectorEnv(COUNT, autoreset_mode="SameStep", decision_s=DECISION_S, **options))


def scalars(**options: Any) -> DummyVecEnv:
    make = partial(gym.make, "homeward/Survey-v0", decision_s=DECISION_S, disable_env_checker=True, **options)
    return DummyVecEnv([lambda: Monitor(make()) for _ in range(COUNT)])


def draw_actions(rng: np.random.Generator, action_type: str) -> NDArray[Any]:
    """The first mission stands until its time is over, the others go and now and then turn back."""
    if action_type == "continuous":
        actions = rng.uniform(-0.3, 0.3, (COUNT, 3)).astype(np.float32)
        actions[rng.random(COUNT) < 0.05, 2] = 1.0
        actions[0] = -1.0
        return actions
    actions = np.stack([rng.integers(0, 5, COUNT), rng.integers(0, 5, COUNT), 1 + (rng.random(COUNT) < 0.05)], axis=1)
    actions[0] = 0
    return actions


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("difficulty", ["known", "harsh"])
def test_steps_equal_those_of_wrapped_scalar_environments(action_type: str, difficulty: str) -> None:
    ours, theirs = (make(action_type=action_type, difficulty=difficulty) for make in (native, scalars))
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    ours.seed(3)
    theirs.seed(3)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    rng = np.random.default_rng(0)
    ways_to_end = set()
    for _ in range(150):
        actions = draw_actions(rng, action_type)
        ours_now, theirs_now = ours.step(actions), theirs.step(actions)
        for one, other in zip(ours_now[:3], theirs_now[:3], strict=True):
            assert isinstance(one, np.ndarray) and isinstance(other, np.ndarray)
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, other)
        for done, info, expected in zip(ours_now[2], ours_now[3], theirs_now[3], strict=True):
            if not done:
                assert info == {}
                continue
            same_info(info, expected)
            ways_to_end.add((info["home"], info["stranded"], info["TimeLimit.truncated"]))
    assert ways_to_end == {(True, False, False), (False, True, False), (False, False, True)}


def same_info(info: dict[str, Any], expected: dict[str, Any]) -> None:
    assert set(info) == {*expected, "is_success"}
    assert info["is_success"] == expected["home"]
    np.testing.assert_array_equal(info["terminal_observation"], expected["terminal_observation"])
    assert info["energy_j"] == dict(expected["energy_j"])
    for name in ("score", "cost", "position_m", "home", "stranded", "TimeLimit.truncated"):
        assert info[name] == expected[name]
        assert type(info[name]) is type(expected[name])
    assert info["episode"]["r"] == pytest.approx(expected["episode"]["r"], abs=1e-6)
    assert info["episode"]["l"] == expected["episode"]["l"]


def test_a_copy_goes_on_as_the_original() -> None:
    env = native()
    env.seed(0)
    env.reset()
    rng = np.random.default_rng(1)
    for _ in range(20):
        env.step(draw_actions(rng, "discrete"))
    twin = copy.deepcopy(env)
    for _ in range(60):
        actions = draw_actions(rng, "discrete")
        first, second = env.step(actions), twin.step(actions)
        for one, other in zip(first[:3], second[:3], strict=True):
            np.testing.assert_array_equal(one, other)
        assert [info.get("episode", {}).get("r") for info in first[3]] == [
            info.get("episode", {}).get("r") for info in second[3]
        ]


def test_stranding_costs_what_it_is_said_to() -> None:
    free, costly = native(), SB3Adapter(HomewardVectorEnv(COUNT, autoreset_mode="SameStep", decision_s=DECISION_S), 0.5)
    for env in (free, costly):
        env.seed(0)
        env.reset()
    go = np.tile([4, 2, 1], (COUNT, 1))
    stranded = 0
    for _ in range(40):
        (_, rewards, _, infos), (_, costly_rewards, _, costly_infos) = free.step(go), costly.step(go)
        lost = np.array([0.5 if info.get("stranded") else 0.0 for info in infos])
        np.testing.assert_allclose(rewards - costly_rewards, lost, atol=1e-6)
        for info, costly_info in zip(infos, costly_infos, strict=True):
            if info.get("stranded"):
                stranded += 1
                assert info["episode"]["r"] - costly_info["episode"]["r"] == pytest.approx(0.5)
    assert stranded >= COUNT


def test_attributes_are_those_of_the_shared_environment() -> None:
    env = native()
    assert env.get_attr("num_envs", indices=[0, 2]) == [COUNT, COUNT]
    assert env.env_is_wrapped(Monitor) == [False] * COUNT
    with pytest.raises(NotImplementedError, match="share one environment"):
        env.set_attr("num_envs", 1)
    with pytest.raises(NotImplementedError, match="share one environment"):
        env.env_method("reset")


def test_another_way_of_resetting_is_refused() -> None:
    with pytest.raises(ValueError, match="autoreset_mode is NextStep; make the environment with SameStep"):
        SB3Adapter(HomewardVectorEnv(2))


@pytest.mark.parametrize("mission", ["OutAndBack", "Survey", "Patrol"])
def test_the_inputs_of_a_mission_begin_anew_with_it(mission: str) -> None:
    def make(count: int) -> SB3Adapter:
        env = HomewardVectorEnv(count, mission=mission, autoreset_mode="SameStep", decision_s=DECISION_S)
        return SB3Adapter(env, 0.5, make_inputs(env.batch.known), late_is_lost=True)

    env, rng, ended = make(COUNT), np.random.default_rng(0), 0
    env.seed(5)
    inputs = env.reset()
    assert env.observation_space.contains(inputs[0])
    twin = make_inputs(env.missions.batch.known)
    np.testing.assert_array_equal(twin(inputs[:, : len(NAMES)], np.ones(COUNT, np.bool_)), inputs)
    for _ in range(60):
        seen, rewards, over, infos = env.step(draw_actions(rng, "discrete"))
        np.testing.assert_array_equal(twin(np.asarray(seen)[:, : len(NAMES)], over), np.asarray(seen))
        assert np.isfinite(rewards).all() and not any(info.get("TimeLimit.truncated") for info in infos)
        ended += int(over.sum())
    assert ended


def test_late_missions_with_inputs_are_refused_where_they_would_go_on() -> None:
    env = HomewardVectorEnv(2, autoreset_mode="SameStep")
    with pytest.raises(ValueError, match="late_is_lost = False is not possible"):
        SB3Adapter(env, 0.0, make_inputs(env.batch.known))


def test_native_missions_under_stable_baselines3() -> None:
    env = sb3_vec_env("homeward/OutAndBack-v0", 3, seed=7, difficulty="known")
    expected, _ = HomewardVectorEnv(3, mission="OutAndBack", difficulty="known").reset(seed=7)
    np.testing.assert_array_equal(env.reset(), expected)
    with pytest.raises(OptionError, match="unknown env 'homeward/Nowhere-v0'; choose from"):
        sb3_vec_env("homeward/Nowhere-v0", 3)


def test_missions_begin_anew_when_asked_and_the_others_wait() -> None:
    env = native()
    env.seed(0)
    env.reset()
    go = np.tile([4, 2, 1], (COUNT, 1))
    for _ in range(3):
        seen = np.asarray(env.step(go)[0])
    which = np.arange(COUNT) < 2
    begun = env.begin(which)
    assert (begun[which, INDEX["time"]] == 0.0).all() and (begun[which, INDEX["distance"]] == 0.0).all()
    np.testing.assert_array_equal(begun[~which], seen[~which])


def test_who_learns_senses_on_the_go_alone() -> None:
    missions = HomewardVectorEnv(3, autoreset_mode="SameStep", decision_s=DECISION_S)
    env = SB3Adapter(missions, senses_on_the_go=True)
    env.seed(0)
    env.reset()
    seen = np.asarray(env.step(np.array([[4, 4, mode] for mode in range(3)]))[0])
    assert seen[:, INDEX["sensing"]].tolist() == [0.0, 1.0, 0.0]
