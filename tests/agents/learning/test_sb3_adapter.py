"""The adapter equals Stable-Baselines3's own wrappers around as many scalar environments."""

import copy
from functools import partial
from typing import Any, cast

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import VectorWrapper
from gymnasium.wrappers.vector import RecordEpisodeStatistics, TransformObservation
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

import homeward  # noqa: F401 - registers the environments
from homeward.agents.learning import sb3_vec_env, scratch_start, unseen_episodes
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.agents.trained.inputs import make_inputs
from homeward.envs.features import INDEX, LIMIT, NAMES
from homeward.envs.options import OptionError
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import CAUSES

COUNT = 6
DECISION_S = 300.0  # short missions: some forty decisions until the time is over


def native(**options: Any) -> SB3Adapter:
    return SB3Adapter(
        HomewardVectorEnv(COUNT, autoreset_mode="SameStep", decision_s=DECISION_S, **options)
    )


def scalars(**options: Any) -> DummyVecEnv:
    make = partial(
        gym.make, "homeward/Survey-v0", decision_s=DECISION_S, disable_env_checker=True, **options
    )
    return DummyVecEnv([lambda: Monitor(make()) for _ in range(COUNT)])


def draw_actions(rng: np.random.Generator, action_type: str) -> NDArray[Any]:
    """The first mission stands until its time is over, the others go and now and then turn back."""
    if action_type == "continuous":
        actions = rng.uniform(-0.3, 0.3, (COUNT, 3)).astype(np.float32)
        actions[rng.random(COUNT) < 0.05, 2] = 1.0
        actions[0] = -1.0
        return actions
    actions = np.stack(
        [rng.integers(0, 5, COUNT), rng.integers(0, 5, COUNT), 1 + (rng.random(COUNT) < 0.05)],
        axis=1,
    )
    actions[0] = 0
    return actions


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
@pytest.mark.parametrize("difficulty", ["known", "harsh"])
def test_steps_equal_those_of_wrapped_scalar_environments(
    action_type: str, difficulty: str
) -> None:
    ours, theirs = (
        make(action_type=action_type, difficulty=difficulty) for make in (native, scalars)
    )
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
    free, costly = (
        native(),
        SB3Adapter(HomewardVectorEnv(COUNT, autoreset_mode="SameStep", decision_s=DECISION_S), 0.5),
    )
    for env in (free, costly):
        env.seed(0)
        env.reset()
    go = np.tile([4, 2, 1], (COUNT, 1))
    stranded = 0
    for _ in range(40):
        (_, rewards, _, infos), (_, costly_rewards, _, costly_infos) = (
            free.step(go),
            costly.step(go),
        )
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
    with pytest.raises(
        ValueError, match="autoreset_mode is NextStep; make the environment with SameStep"
    ):
        SB3Adapter(HomewardVectorEnv(2))


class DistanceTerm(VectorWrapper[Any, Any, Any, Any, Any]):
    """Adds a term to the reward: the way of each decision, also of the last one of a mission."""

    def reset(self, **keywords: Any) -> tuple[Any, dict[str, Any]]:
        observations, info = super().reset(**keywords)
        self._position_m = info["position_m"].copy()
        return observations, info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        observations, rewards, terminated, truncated, info = super().step(actions)
        after_m = info.get("final_info", info)["position_m"]
        rewards = rewards + np.abs(after_m - self._position_m)
        self._position_m = info["position_m"].copy()
        return observations, rewards, terminated, truncated, info


def test_a_reward_term_in_a_wrapper_reaches_the_learner_and_infos_hold_what_it_needs() -> None:
    plain, own = (
        sb3_vec_env(
            "homeward/Survey-v0", COUNT, decision_s=DECISION_S, late_is_lost=True, wrapper_class=wrapper,
            info_keys=("position_m", "energy_j"),
        )
        for wrapper in (None, DistanceTerm)
    )  # fmt: skip
    np.testing.assert_array_equal(plain.reset(), own.reset())
    rng, before_m, ended = np.random.default_rng(0), np.zeros(COUNT), 0
    for _ in range(150):
        actions = draw_actions(rng, "discrete")
        (_, rewards, over, infos), (_, own_rewards, _, _) = plain.step(actions), own.step(actions)
        after_m = np.array([info["position_m"] for info in infos])
        np.testing.assert_allclose(own_rewards - rewards, np.abs(after_m - before_m), atol=1e-4)
        assert all(set(info) == {"position_m", "energy_j"} for info in np.array(infos)[~over])
        assert all(set(info["energy_j"]) == set(CAUSES) for info in infos)
        before_m = np.where(over, 0.0, after_m)
        ended += int(over.sum())
    assert ended > COUNT and own.get_attr("options")[0].mission == "Survey"


def test_wrappers_of_gymnasium_are_taken() -> None:
    options: dict[str, Any] = {"decision_s": DECISION_S, "difficulty": "harsh"}
    native_env = sb3_vec_env("homeward/Survey-v0", COUNT, **options)
    counted, seen_otherwise = (
        sb3_vec_env(
            "homeward/Survey-v0", COUNT, autoreset_mode="Disabled", wrapper_class=wrapper, **options
        )
        for wrapper in (
            RecordEpisodeStatistics,
            lambda env: TransformObservation(env, lambda values: 2.0 * values),
        )
    )
    rng, ended = np.random.default_rng(0), 0
    first = native_env.reset()
    np.testing.assert_array_equal(counted.reset(), first)
    np.testing.assert_array_equal(seen_otherwise.reset(), 2.0 * first)
    assert counted.as_missions
    for _ in range(60):
        actions = draw_actions(rng, "discrete")
        (seen, rewards, over, infos), *others = (
            env.step(actions) for env in (native_env, counted, seen_otherwise)
        )
        for (other_seen, other_rewards, other_over, other_infos), factor in zip(
            others, (1.0, 2.0), strict=True
        ):
            np.testing.assert_array_equal(other_seen, factor * np.asarray(seen))
            np.testing.assert_array_equal(other_rewards, rewards)
            np.testing.assert_array_equal(other_over, over)
            for i in np.flatnonzero(over).tolist():
                final, other_final = (
                    infos[i]["terminal_observation"],
                    other_infos[i]["terminal_observation"],
                )
                np.testing.assert_array_equal(other_final, factor * final)
                assert other_infos[i]["energy_j"] == infos[i]["energy_j"]
                assert other_infos[i]["episode"]["r"] == infos[i]["episode"]["r"]
        ended += int(over.sum())
    assert ended > COUNT


def test_what_a_wrapper_takes_away_is_said() -> None:
    env = HomewardVectorEnv(2, autoreset_mode="Disabled")
    scaled = TransformObservation(
        env,
        lambda values: values[:, :1],
        single_observation_space=spaces.Box(-LIMIT, LIMIT, (1,), np.float32),
    )
    with pytest.raises(
        ValueError, match="inputs need the observations of the missions; leave out the wrapper"
    ):
        SB3Adapter(scaled, 0.0, make_inputs(env.batch.known), late_is_lost=True)
    with pytest.raises(ValueError, match="a wrapper changes observations or actions"):
        unseen_episodes(cast(Any, None), SB3Adapter(scaled), 2)
    with pytest.raises(ValueError, match="the first policy needs the missions' own observations"):
        scratch_start(SB3Adapter(scaled))
    with pytest.raises(ValueError, match="info_keys has 'position'; choose from energy_j"):
        SB3Adapter(env, info_keys=("position",))
    with pytest.raises(ValueError, match="senses_on_the_go needs the three parts"):
        SB3Adapter(
            HomewardVectorEnv(2, action_type="flat", autoreset_mode="SameStep"),
            senses_on_the_go=True,
        )
    with pytest.raises(ValueError, match="is no HomewardVectorEnv"):
        SB3Adapter(gym.make_vec("CartPole-v1", 2))


@pytest.mark.parametrize("mission", ["OutAndBack", "Survey", "Patrol"])
def test_the_inputs_of_a_mission_begin_anew_with_it(mission: str) -> None:
    def make(count: int) -> SB3Adapter:
        env = HomewardVectorEnv(
            count, mission=mission, autoreset_mode="SameStep", decision_s=DECISION_S
        )
        return SB3Adapter(env, 0.5, make_inputs(env.batch.known), late_is_lost=True)

    env, rng, ended = make(COUNT), np.random.default_rng(0), 0
    env.seed(5)
    inputs = env.reset()
    assert env.observation_space.contains(inputs[0])
    twin = make_inputs(env.missions.batch.known)
    np.testing.assert_array_equal(twin(inputs[:, : len(NAMES)], np.ones(COUNT, np.bool_)), inputs)
    for _ in range(60):
        seen, rewards, over, infos = env.step(draw_actions(rng, "discrete"))
        np.testing.assert_array_equal(
            twin(np.asarray(seen)[:, : len(NAMES)], over), np.asarray(seen)
        )
        assert np.isfinite(rewards).all() and not any(
            info.get("TimeLimit.truncated") for info in infos
        )
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
    assert (begun[which, INDEX["time"]] == 0.0).all() and (
        begun[which, INDEX["distance"]] == 0.0
    ).all()
    np.testing.assert_array_equal(begun[~which], seen[~which])


def test_who_learns_senses_on_the_go_alone() -> None:
    missions = HomewardVectorEnv(3, autoreset_mode="SameStep", decision_s=DECISION_S)
    env = SB3Adapter(missions, senses_on_the_go=True)
    env.seed(0)
    env.reset()
    seen = np.asarray(env.step(np.array([[4, 4, mode] for mode in range(3)]))[0])
    assert seen[:, INDEX["sensing"]].tolist() == [0.0, 1.0, 0.0]
