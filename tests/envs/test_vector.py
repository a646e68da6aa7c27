"""The vector environment equals as many scalar ones, step for step."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import Any

import numba
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.typing import NDArray

from homeward.envs import batch, kernel
from homeward.envs.conditions.difficulty import DIFFICULTIES
from homeward.envs.conditions.instruments import INSTRUMENTS, Instruments
from homeward.envs.options import ACTION_TYPES
from homeward.envs.reward import TERMS
from homeward.envs.scalar import HomewardEnv
from homeward.envs.threads import Threads
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import CAUSES
from tests.envs.rollouts import IN_PARTS, INFO_KEYS, MISSIONS, SHORT_S, make, random_actions

COUNT, STEPS = 6, 45
SEEDS = [11, 3, 3, 2**31, 0, 12345]  # two alike, and in no order


class TwoThreads(Threads):
    """Two threads for every step, however few missions there are."""

    def __init__(self, missions: int) -> None:
        self.number = 2

    @staticmethod
    def worthwhile(missions: int) -> bool:
        return missions >= 2

    def record(self, seconds: float) -> None:
        pass


def cases() -> list[tuple[str, AutoresetMode, str, str, str, bool]]:
    """Which kernel steps which missions: all settings in one autoreset mode, and in others each of
    them somewhere.

    How missions begin anew knows nothing of difficulties and types of actions, and neither does the
    number of threads. The last entry says whether there are docks: on patrols, with either kernel
    in every mode.
    """
    chosen = [
        ("in_turn", AutoresetMode.NEXT_STEP, *setting, False)
        for setting in itertools.product(MISSIONS, DIFFICULTIES, IN_PARTS)
    ]
    for first, mode in enumerate(AutoresetMode):
        for second, mission in enumerate(MISSIONS):
            difficulty, action_type = (
                list(DIFFICULTIES)[(first + second) % 3],
                IN_PARTS[(first + second) % 2],
            )
            setting = mission, difficulty, action_type, mission == "Patrol"
            chosen += [(kernel_of, mode, *setting) for kernel_of in ("in_turn", "in_parallel")]
    return list(dict.fromkeys(chosen))


@pytest.fixture
def threads(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Let small vector environments use the kernel of large ones."""
    if request.param == "in_parallel":
        monkeypatch.setattr(batch, "Threads", TwoThreads)
    return str(request.param)


def plain(info: dict[str, Any], index: int | None = None) -> dict[str, Any]:
    """An info of a scalar environment, or of one mission of a vector environment."""

    def of_one(values: Any) -> Any:
        if isinstance(values, Mapping):
            return {name: of_one(one) for name, one in values.items()}
        return values if index is None else values[index]

    return {key: of_one(info[key]) for key in INFO_KEYS}


class Scalars:
    """Scalar environments, begun anew by hand as an autoreset mode says."""

    def __init__(self, mode: AutoresetMode, mission: str, seeds: list[int], **options: Any) -> None:
        self.mode = mode
        self.envs = [make(mission, **options) for _ in seeds]
        self.first = [env.reset(seed=seed) for env, seed in zip(self.envs, seeds, strict=True)]
        self.over = np.zeros(len(seeds), bool)

    def step(self, actions: NDArray[Any]) -> list[tuple[Any, ...]]:
        """Observation, reward, terminated, truncated, info, and final observation and info or None,
        of each."""
        results = [self._step(i, action) for i, action in enumerate(actions)]
        self.over = np.array([result[2] or result[3] for result in results])
        return results

    def _step(self, i: int, action: NDArray[Any]) -> tuple[Any, ...]:
        env = self.envs[i]
        if self.over[i] and self.mode is AutoresetMode.NEXT_STEP:
            observation, info = env.reset()
            return observation, 0.0, False, False, info, None
        observation, reward, terminated, truncated, info = env.step(action)
        if (terminated or truncated) and self.mode is AutoresetMode.SAME_STEP:
            final = observation, info
            observation, info = env.reset()
            return observation, reward, terminated, truncated, info, final
        return observation, reward, terminated, truncated, info, None


@pytest.mark.parametrize(
    ("threads", "mode", "mission", "difficulty", "action_type", "docks"),
    cases(),
    indirect=["threads"],
)
def test_vector_equals_scalar(
    mode: AutoresetMode, mission: str, difficulty: str, action_type: str, docks: bool, threads: str
) -> None:
    options: dict[str, Any] = {
        "difficulty": difficulty,
        "action_type": action_type,
        "decision_s": SHORT_S,
    }
    if docks:
        options |= {"docks": ((0.0, 60.0), (75.0, 90.0)), "time_limit_s": 20.0 * SHORT_S}
    scalars = Scalars(mode, mission, SEEDS, **options)
    envs = HomewardVectorEnv(COUNT, mission=mission, autoreset_mode=mode, **options)
    observations, info = envs.reset(seed=SEEDS)
    for i, (observation, one) in enumerate(scalars.first):
        np.testing.assert_array_equal(observations[i], observation)
        assert plain(info, i) == plain(one)
    ends: set[tuple[int, int]] = set()
    rng = np.random.default_rng(7)
    for step in range(STEPS):
        actions = random_actions(rng, action_type, COUNT)
        observations, rewards, terminated, truncated, info = envs.step(actions)
        for i, (observation, *rest, one, final) in enumerate(scalars.step(actions)):
            np.testing.assert_array_equal(observations[i], observation)
            assert [rewards[i], terminated[i], truncated[i]] == rest
            assert plain(info, i) == plain(one)
            if mode is AutoresetMode.SAME_STEP and "_final_obs" in info:
                assert info["_final_obs"][i] == info["_final_info"][i] == (final is not None)
            if final is not None:
                np.testing.assert_array_equal(info["final_obs"][i], final[0])
                assert plain(info["final_info"], i) == plain(final[1])
        over = terminated | truncated
        ends |= {(step, i) for i in np.flatnonzero(over).tolist()}
        if mode is AutoresetMode.DISABLED and over.any():
            observations, info = envs.reset(options={"reset_mask": over})
            for i in np.flatnonzero(over).tolist():
                observation, one = scalars.envs[i].reset()
                np.testing.assert_array_equal(observations[i], observation)
                assert plain(info, i) == plain(one)
            scalars.over[:] = False
    assert len({step for step, _ in ends}) > 4, "the resets are to be staggered"
    assert {i for _, i in ends} == set(range(COUNT))


ALL_NOISY = Instruments(0.02, 0.01, 100.0, 0.1, 0.05, 0.05, 0.05, 0.01)


@pytest.mark.parametrize(
    ("threads", "instruments"),
    [
        *(("in_turn", instruments) for instruments in (*INSTRUMENTS, ALL_NOISY)),
        ("in_parallel", ALL_NOISY),
    ],
    indirect=["threads"],
)
@pytest.mark.parametrize("mission", MISSIONS)
def test_vector_equals_scalar_with_any_instruments(
    mission: str, instruments: str | Instruments, threads: str
) -> None:
    """And with decisions so short that a return takes several of them."""
    mode = AutoresetMode.SAME_STEP
    for difficulty, action_type in zip(DIFFICULTIES, ACTION_TYPES, strict=True):
        options: dict[str, Any] = {
            "difficulty": difficulty, "action_type": action_type, "decision_s": 50.0, "instruments": instruments
        }  # fmt: skip
        scalars = Scalars(mode, mission, SEEDS, **options)
        envs = HomewardVectorEnv(COUNT, mission=mission, autoreset_mode=mode, **options)
        np.testing.assert_array_equal(
            envs.reset(seed=SEEDS)[0], np.stack([first for first, _ in scalars.first])
        )
        rng, ends = np.random.default_rng(7), 0
        for _ in range(40):
            actions = random_actions(rng, action_type, COUNT, home=0.35)
            observations, rewards, terminated, truncated, info = envs.step(actions)
            for i, (observation, *rest, one, _) in enumerate(scalars.step(actions)):
                np.testing.assert_array_equal(observations[i], observation)
                assert [rewards[i], terminated[i], truncated[i]] == rest
                assert plain(info, i) == plain(one)
            ends += int((terminated | truncated).sum())
        assert ends > 2


@pytest.mark.parametrize("mode", AutoresetMode)
def test_native_equals_gymnasiums_vector_env(mode: AutoresetMode) -> None:
    options: dict[str, Any] = {"difficulty": "harsh", "decision_s": SHORT_S}
    theirs: Any = SyncVectorEnv([lambda: make("Survey", **options)] * COUNT, autoreset_mode=mode)
    ours = HomewardVectorEnv(COUNT, mission="Survey", autoreset_mode=mode, **options)
    np.testing.assert_array_equal(theirs.reset(seed=list(SEEDS))[0], ours.reset(seed=SEEDS)[0])
    rng, ends = np.random.default_rng(8), 0
    for _ in range(STEPS):
        actions = random_actions(rng, "discrete", COUNT)
        expected: Any
        found: Any
        expected, found = theirs.step(actions), ours.step(actions)
        for one, other in zip(expected[:4], found[:4], strict=True):
            np.testing.assert_array_equal(one, other)
            assert one.dtype == other.dtype
        same_info(expected[4], found[4])
        over = found[2] | found[3]
        ends += int(over.sum())
        if mode is AutoresetMode.DISABLED and over.any():
            observations = theirs.reset(options={"reset_mask": over.copy()})[0]
            np.testing.assert_array_equal(observations, ours.reset(options={"reset_mask": over})[0])
        if mode is AutoresetMode.SAME_STEP:
            assert ("final_obs" in found[4]) == ("final_obs" in expected[4]) == over.any()
            for i in np.flatnonzero(over).tolist():
                np.testing.assert_array_equal(expected[4]["final_obs"][i], found[4]["final_obs"][i])
            if over.any():
                np.testing.assert_array_equal(expected[4]["_final_obs"], found[4]["_final_obs"])
                same_info(expected[4]["final_info"], found[4]["final_info"])
    assert ends > COUNT


def same_info(expected: dict[str, Any], found: dict[str, Any]) -> None:
    assert set(expected) == set(found)
    for key in INFO_KEYS:
        mask = expected[f"_{key}"]
        np.testing.assert_array_equal(mask, found[f"_{key}"])
        if key == "energy_j":
            for cause in CAUSES:
                spent_j = [ledger[cause] for ledger in expected[key][mask]]
                np.testing.assert_array_equal(spent_j, found[key][cause][mask])
        elif key == "reward_terms":
            for term in TERMS:
                np.testing.assert_array_equal(expected[key][term][mask], found[key][term][mask])
        else:
            assert expected[key].dtype == found[key].dtype
            np.testing.assert_array_equal(expected[key][mask], found[key][mask])


@pytest.mark.parametrize("threads", ["in_turn", "in_parallel"], indirect=True)
def test_the_order_of_missions_does_not_matter(threads: str) -> None:
    order = np.random.default_rng(0).permutation(COUNT)
    envs, others = (
        HomewardVectorEnv(COUNT, mission="Survey", decision_s=SHORT_S) for _ in range(2)
    )
    first, other_first = envs.reset(seed=SEEDS)[0], others.reset(seed=[SEEDS[i] for i in order])[0]
    np.testing.assert_array_equal(first[order], other_first)
    rng = np.random.default_rng(9)
    for _ in range(STEPS):
        actions = random_actions(rng, "discrete", COUNT)
        found, permuted = envs.step(actions), others.step(actions[order])
        for i in range(4):
            one: Any = found[i]
            np.testing.assert_array_equal(one[order], permuted[i])


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_large_vector_envs_equal_small_ones(mode: str) -> None:
    """At a size from which several threads may step them, and with all missions in turn."""
    count, allowed = 256, numba.get_num_threads()
    options: dict[str, Any] = {"difficulty": "harsh", "decision_s": SHORT_S, "autoreset_mode": mode}
    parallel, in_turn = (HomewardVectorEnv(count, mission="Patrol", **options) for _ in range(2))
    assert parallel.batch.threads and in_turn.batch.threads
    parallel.batch.threads, in_turn.batch.threads = TwoThreads(count), None
    one = make("Patrol", difficulty="harsh")
    np.testing.assert_array_equal(parallel.reset(seed=1)[0], in_turn.reset(seed=1)[0])
    one.reset(seed=count)  # the last one's
    rng, begun = np.random.default_rng(3), False
    for _ in range(STEPS):
        actions = random_actions(rng, "discrete", count)
        found, expected = parallel.step(actions), in_turn.step(actions)
        for ours, theirs in zip(found[:4], expected[:4], strict=True):
            np.testing.assert_array_equal(ours, theirs)
        for cause in CAUSES:
            np.testing.assert_array_equal(
                found[4]["energy_j"][cause], expected[4]["energy_j"][cause]
            )
        begun = begun or bool(found[2][-1] | found[3][-1])
        if not begun:
            np.testing.assert_array_equal(found[0][-1], one.step(actions[-1])[0])
    assert begun
    assert numba.get_num_threads() == allowed


def test_one_seed_stands_for_a_row_of_them() -> None:
    envs, others = HomewardVectorEnv(3), HomewardVectorEnv(3)
    np.testing.assert_array_equal(envs.reset(seed=40)[0], others.reset(seed=[40, 41, 42])[0])


def test_a_mask_begins_some_missions_and_leaves_the_rest() -> None:
    envs = HomewardVectorEnv(4, mission="OutAndBack", autoreset_mode=AutoresetMode.DISABLED)
    envs.reset(seed=0)
    before, *_ = envs.step(np.array([[4, 0, 1]] * 4))
    records = envs.batch.records.copy()
    mask = np.array([True, False, False, True])
    observations, info = envs.reset(seed=[7, 8, 9, 10], options={"reset_mask": mask})
    np.testing.assert_array_equal(observations[~mask], before[~mask])
    np.testing.assert_array_equal(envs.batch.records[~mask], records[~mask])
    np.testing.assert_array_equal(info["position_m"] == 0.0, mask)
    for i, seed in ((0, 7), (3, 10)):
        np.testing.assert_array_equal(
            observations[i], HomewardEnv(mission="OutAndBack").reset(seed=seed)[0]
        )


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_final_info_is_kept_when_missions_go_on(mode: AutoresetMode) -> None:
    """Live views show the missions that run; what ended in the same step is a copy."""
    envs = HomewardVectorEnv(2, mission="OutAndBack", autoreset_mode=mode, decision_s=SHORT_S)
    envs.reset(seed=0)
    go, home = np.array([[4, 0, 1]] * 2), np.array([[4, 0, 2], [4, 0, 1]])
    envs.step(go)
    *_, info = envs.step(home)
    ended = info["final_info"] if mode is AutoresetMode.SAME_STEP else info
    score = ended["score"][0]
    envs.step(go)
    assert (ended["score"][0] == score) == (mode is AutoresetMode.SAME_STEP)
    assert score > 0.0


@pytest.mark.parametrize("number", [1, 2])
def test_the_kernel_is_the_one_for_so_many_threads(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    called: list[str] = []

    def note(name: str) -> Callable[..., int]:
        def kernel_of(*arguments: Any) -> int:
            called.append(name)
            return 0

        return kernel_of

    for name in ("step_in_turn", "step_in_parallel"):
        monkeypatch.setattr(kernel, name, note(name))
    envs = HomewardVectorEnv(256)
    assert envs.batch.threads and envs.batch.threads.number == 1
    envs.batch.threads.number = number
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())
    assert called == ["step_in_parallel" if number == 2 else "step_in_turn"]
