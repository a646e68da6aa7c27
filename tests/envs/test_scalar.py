"""What Gymnasium and stable-baselines3 ask of an environment, and that it travels between
processes."""

from __future__ import annotations

import copy
import itertools
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.wrappers import RecordEpisodeStatistics, TimeLimit
from gymnasium.wrappers.vector import DictInfoToList
from gymnasium.wrappers.vector import RecordEpisodeStatistics as RecordVectorEpisodeStatistics

from homeward.envs import IDS
from homeward.envs.conditions.difficulty import DIFFICULTIES
from homeward.envs.conditions.instruments import INSTRUMENTS
from homeward.envs.features import FEATURES
from homeward.envs.options import OptionError
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import CAUSES
from tests.envs.rollouts import IN_PARTS, MISSIONS, SHORT_S, make, random_actions

COMBINATIONS = list(itertools.product(MISSIONS, DIFFICULTIES, INSTRUMENTS, IN_PARTS))


def made(
    mission: str, difficulty: str, instruments: str, action_type: str, **options: Any
) -> gym.Env[Any, Any]:
    options = {
        "difficulty": difficulty,
        "instruments": instruments,
        "action_type": action_type,
    } | options
    return gym.make(IDS[mission], **options)


@pytest.mark.parametrize("combination", COMBINATIONS, ids="-".join)
def test_gymnasium_finds_nothing_to_say(combination: tuple[str, str, str, str]) -> None:
    check_env(made(*combination).unwrapped)


@pytest.mark.parametrize("combination", COMBINATIONS, ids="-".join)
def test_stable_baselines3_finds_nothing_to_say(combination: tuple[str, str, str, str]) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(made(*combination).unwrapped)


@pytest.mark.parametrize(
    "others",
    [{"shaping": "none"}, {"weather": "still", "action_type": "flat"}, {"route": "hidden_wind"}],
    ids=str,
)
@pytest.mark.parametrize("mission", MISSIONS)
def test_neither_has_anything_to_say_of_other_variants(
    mission: str, others: dict[str, Any]
) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    for check in (check_env, checker.check_env):
        check(gym.make(IDS[mission], **others).unwrapped)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (
            {"route": "flat"},
            "reset does not know the option 'route'; it knows none; options of missions are given to make",
        ),
        (["route"], r"options = \['route'\] of reset is not allowed; give a dictionary or None"),
    ],
)
def test_options_of_a_reset_that_would_do_nothing_are_refused(options: Any, expected: str) -> None:
    env = make("Survey")
    with pytest.raises(OptionError, match=expected):
        env.reset(seed=0, options=options)
    with pytest.raises(OptionError, match=r"does not know the option 'mask'; it knows reset_mask"):
        HomewardVectorEnv(2).reset(options={"mask": np.ones(2, np.bool_)})


def test_ids_hold_their_mission() -> None:
    for mission, env_id in IDS.items():
        env = gym.make(env_id).unwrapped
        assert isinstance(env, HomewardEnv)
        assert env.options.mission == mission and gym.spec(env_id).id == f"homeward/{mission}-v0"


def test_an_id_imports_the_package_by_itself(root: Path) -> None:
    program = (
        "import sys, gymnasium\n"
        "assert 'homeward' not in sys.modules\n"
        "env = gymnasium.make('homeward:homeward/Survey-v0', difficulty='harsh')\n"
        "import homeward; gymnasium.register_envs(homeward)\n"
        "gymnasium.make('homeward/OutAndBack-v0').reset(seed=0)\n"
        "observation, info = env.reset(seed=0)\n"
        "print(observation.shape, env.step(env.action_space.sample())[1] != 0.0)\n"
        "envs = gymnasium.make_vec('homeward:homeward/Patrol-v0', 3, vectorization_mode='vector_entry_point')\n"
        "print(envs.reset(seed=0)[0].shape, type(envs).__name__)\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        f"({len(FEATURES)},) True",
        f"(3, {len(FEATURES)}) HomewardVectorEnv",
    ]


@pytest.mark.parametrize("mode", AutoresetMode)
def test_the_native_vector_env_is_made_by_its_id(mode: AutoresetMode) -> None:
    for autoreset_mode in (mode, mode.value):
        envs = gym.make_vec(
            IDS["Patrol"],
            4,
            vectorization_mode="vector_entry_point",
            autoreset_mode=autoreset_mode,
            difficulty="harsh",
        )
        assert isinstance(envs, HomewardVectorEnv)
        assert envs.metadata["autoreset_mode"] is mode
        assert (envs.num_envs, envs.options.mission, envs.options.difficulty) == (
            4,
            "Patrol",
            "harsh",
        )
        observations, _ = envs.reset(seed=1)
        assert observations in envs.observation_space
        envs.step(envs.action_space.sample())


@pytest.mark.parametrize("vectorization", ["sync", "async"])
def test_gymnasiums_own_vector_envs_carry_the_same_missions(vectorization: str) -> None:
    """The async one starts fresh processes, as on systems without fork."""
    options: dict[str, Any] = {"difficulty": "harsh", "decision_s": SHORT_S}
    started = {"context": "spawn"} if vectorization == "async" else {}
    theirs: Any = gym.make_vec(IDS["Survey"], 2, vectorization, vector_kwargs=started, **options)
    ours = gym.make_vec(IDS["Survey"], 2, "vector_entry_point", **options)
    try:
        rng = np.random.default_rng(0)
        np.testing.assert_array_equal(theirs.reset(seed=5)[0], ours.reset(seed=5)[0])
        for _ in range(30):
            actions = random_actions(rng, "discrete", 2)
            expected, found = theirs.step(actions), ours.step(actions)
            for one, other in zip(expected[:4], found[:4], strict=True):
                np.testing.assert_array_equal(one, other)
            for key in ("score", "cost", "position_m", "home", "stranded"):
                np.testing.assert_array_equal(expected[4][key], found[4][key])
            for cause, joules in found[4]["energy_j"].items():
                assert [ledger[cause] for ledger in expected[4]["energy_j"]] == joules.tolist()
    finally:
        theirs.close()
        ours.close()


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_gymnasiums_vector_wrappers_take_the_info(mode: AutoresetMode) -> None:
    """`DictInfoToList` goes through it to the last number, beside what `RecordEpisodeStatistics`
    adds."""
    options: dict[str, Any] = {"mission": "Survey", "autoreset_mode": mode, "decision_s": SHORT_S}
    plain, wrapped = HomewardVectorEnv(3, **options), HomewardVectorEnv(3, **options)
    listed: Any = DictInfoToList(RecordVectorEpisodeStatistics(wrapped))
    plain.reset(seed=0)
    assert [info["score"] for info in listed.reset(seed=0)[1]] == [0.0, 0.0, 0.0]
    rng, returns, ends = np.random.default_rng(0), np.zeros(3), 0
    for _ in range(40):
        actions = random_actions(rng, "discrete", 3, home=0.1)
        _, rewards, terminated, truncated, info = plain.step(actions)
        infos = listed.step(actions)[4]
        over = terminated | truncated
        returns += rewards
        for i in range(3):
            for key in ("score", "cost", "position_m", "home", "stranded"):
                assert infos[i][key] == info[key][i]
            for key in ("energy_j", "reward_terms"):
                assert infos[i][key] == {name: values[i] for name, values in info[key].items()}
            if over[i] and mode is AutoresetMode.SAME_STEP:
                final = infos[i]["final_info"]
                assert final["energy_j"] == {
                    cause: joules[i] for cause, joules in info["final_info"]["energy_j"].items()
                }
            if over[i]:
                assert infos[i]["episode"]["r"] == pytest.approx(returns[i])
        returns[over] = 0.0
        ends += int(over.sum())
        if mode is AutoresetMode.DISABLED and over.any():
            plain.reset(options={"reset_mask": over})
            listed.reset(options={"reset_mask": over})
    assert ends > 3


def test_what_a_vector_env_tells_cannot_be_written() -> None:
    envs = HomewardVectorEnv(2, decision_s=SHORT_S, autoreset_mode=AutoresetMode.SAME_STEP)
    _, info = envs.reset(seed=0)
    for values in (info["score"], info["_score"], info["energy_j"]["rolling"]):
        with pytest.raises(ValueError, match="read-only"):
            values[:] = 1
    *_, info = envs.step(np.array([[4, 0, RETURN]] * 2))
    with pytest.raises(ValueError, match="read-only"):
        info["final_info"]["energy_j"]["rolling"][:] = 1.0


def test_the_scalar_ledger_shows_its_numbers() -> None:
    env = make("Survey")
    ledger = env.reset(seed=0)[1]["energy_j"]
    assert repr(ledger).startswith("{'sensing': 0.0, ")
    assert ledger == dict.fromkeys(CAUSES, 0.0) and ledger.total() == 0.0


def travelled(env: Any, way: str) -> Any:
    return copy.deepcopy(env) if way == "deepcopy" else pickle.loads(pickle.dumps(env))


@pytest.mark.parametrize("way", ["pickle", "deepcopy"])
@pytest.mark.parametrize("action_type", IN_PARTS)
def test_a_copied_mission_goes_on_alike(way: str, action_type: str) -> None:
    env = make("Survey", action_type=action_type, difficulty="harsh")
    env.reset(seed=3)
    rng = np.random.default_rng(1)
    for action in random_actions(rng, action_type, 5, home=0.0):
        env.step(action)
    other = travelled(env, way)
    ends = 0
    for action in random_actions(rng, action_type, 40):
        ours, theirs = env.step(action), other.step(action)
        np.testing.assert_array_equal(ours[0], theirs[0])
        assert ours[1:4] == theirs[1:4]
        assert dict(ours[4]["energy_j"]) == dict(theirs[4]["energy_j"])
        if ours[2] or ours[3]:
            ends += 1
            # No seed: each continues its own copy of the generator.
            np.testing.assert_array_equal(env.reset()[0], other.reset()[0])
    assert ends >= 2


@pytest.mark.parametrize("way", ["pickle", "deepcopy"])
def test_a_copy_has_a_life_of_its_own(way: str) -> None:
    env = make("OutAndBack")
    env.reset(seed=3)
    other = travelled(env, way)
    other.step([4, 0, GO])
    assert env.batch.records["position_m"][0] == 0.0 < other.batch.records["position_m"][0]


@pytest.mark.parametrize("way", ["pickle", "deepcopy"])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_copied_vector_missions_go_on_alike(way: str, mode: AutoresetMode) -> None:
    envs = HomewardVectorEnv(5, mission="Patrol", autoreset_mode=mode, decision_s=SHORT_S)
    envs.reset(seed=3)
    rng = np.random.default_rng(2)
    for _ in range(12):
        envs.step(random_actions(rng, "discrete", 5))
    others = travelled(envs, way)
    for _ in range(40):
        actions = random_actions(rng, "discrete", 5)
        for ours, theirs in zip(envs.step(actions)[:4], others.step(actions)[:4], strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_a_copy_that_has_not_begun_can_begin() -> None:
    for way in ("pickle", "deepcopy"):
        env, envs = (
            travelled(make("Survey"), way),
            travelled(HomewardVectorEnv(2, decision_s=SHORT_S), way),
        )
        np.testing.assert_array_equal(env.reset(seed=4)[0], envs.reset(seed=4)[0][0])


def test_episode_statistics_of_a_mission() -> None:
    env = RecordEpisodeStatistics(
        made("OutAndBack", "known", "exact", "discrete", shaping="none", decision_s=SHORT_S)
    )
    env.reset(seed=0)
    rewards = []
    for action in ([4, 0, GO], [4, 0, GO], [4, 0, RETURN], [4, 0, GO], [4, 0, GO], [4, 0, GO]):
        _, reward, terminated, _, info = env.step(action)
        rewards.append(float(reward))
        if terminated:
            break
    assert info["home"] and info["episode"]["l"] == len(rewards)
    assert info["episode"]["r"] == pytest.approx(sum(rewards)) and sum(rewards) > 0.0


@pytest.mark.parametrize("mode", AutoresetMode)
def test_episode_statistics_of_many_missions(mode: AutoresetMode) -> None:
    envs: VectorEnv[Any, Any, Any] = RecordVectorEpisodeStatistics(
        HomewardVectorEnv(3, mission="OutAndBack", autoreset_mode=mode, decision_s=SHORT_S)
    )
    envs.reset(seed=0)
    returns, lengths = np.zeros(3), np.zeros(3, int)
    over, rng, ends = np.zeros(3, bool), np.random.default_rng(0), 0
    for _ in range(40):
        _, rewards, terminated, truncated, info = envs.step(random_actions(rng, "discrete", 3))
        counted = ~over if mode is AutoresetMode.NEXT_STEP else np.ones(3, bool)
        returns[over], lengths[over] = 0.0, 0
        returns += rewards * counted
        lengths += counted
        over = terminated | truncated
        if over.any():
            ends += int(over.sum())
            np.testing.assert_allclose(info["episode"]["r"][over], returns[over], rtol=1e-5)
            np.testing.assert_array_equal(info["episode"]["l"][over], lengths[over])
            if mode is AutoresetMode.DISABLED:
                envs.reset(options={"reset_mask": over})
    assert ends > 3


def test_a_time_limit_truncates() -> None:
    env = TimeLimit(gym.make(IDS["Survey"]).unwrapped, 3)
    env.reset(seed=0)
    assert [env.step([0, 0, STOP])[2:4] for _ in range(3)] == [
        (False, False),
        (False, False),
        (False, True),
    ]


def test_what_is_returned_is_kept() -> None:
    """Observations of both forms and the scalar form's info do not change under the feet of who
    keeps them."""
    env, envs = make("Survey"), HomewardVectorEnv(1, decision_s=SHORT_S)
    env.reset(seed=0)
    envs.reset(seed=0)
    action = np.array([4, 2, GO])
    kept, vector_kept = env.step(action), envs.step(action[None])
    observation, spent_j, results = (
        kept[0].copy(),
        dict(kept[4]["energy_j"]),
        copy.deepcopy(vector_kept[:4]),
    )
    env.step(action)
    envs.step(action[None])
    np.testing.assert_array_equal(kept[0], observation)
    for one, other in zip(vector_kept[:4], results, strict=True):
        np.testing.assert_array_equal(one, other)
    assert dict(kept[4]["energy_j"]) == spent_j


def test_stable_baselines3_makes_its_own_vector_env(monkeypatch: pytest.MonkeyPatch) -> None:
    """It asks for pictures and gets them; without pygame a `TypeError` tells it to go on without
    them."""
    sb3 = pytest.importorskip("stable_baselines3.common.env_util")
    pytest.importorskip("pygame")
    env = sb3.make_vec_env("homeward/Survey-v0", n_envs=2, seed=0)
    assert env.reset().shape == (2, *env.observation_space.shape)
    assert env.render().shape == (2 * 540, 960, 3)
    env.close()
    monkeypatch.setattr("importlib.util.find_spec", lambda name, *rest: None)
    env = sb3.make_vec_env("homeward/Survey-v0", n_envs=2, seed=0)
    assert env.reset().shape == (2, *env.observation_space.shape)
    env.close()


@pytest.mark.parametrize("action", [3, "go", [1, 2], None])
def test_an_action_of_another_shape_is_refused_with_the_one_that_is_needed(action: Any) -> None:
    env = gym.make(IDS["Survey"], disable_env_checker=True)
    env.reset(seed=0)
    with pytest.raises(
        OptionError, match=r"an action has shape \(.*\); give \(3,\): speed, sensing and mode"
    ):
        env.step(action)
