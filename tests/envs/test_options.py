"""What cannot be used is refused in one line that says what is allowed, and nothing is stepped."""

from __future__ import annotations

import dataclasses
import math
import pickle
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import NameNotFound, ResetNeeded
from gymnasium.vector import AutoresetMode

from homeward import Robot, RobotError, load_robot
from homeward.envs import IDS
from homeward.envs.batch import Batch
from homeward.envs.options import Hidden, OptionError, Options, known_of
from homeward.envs.routes import Route
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, RETURN, SHARED_DTYPE
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import preset_names
from tests.envs.rollouts import SHORT_S, drive, make

OPTIONS: list[tuple[dict[str, Any], str]] = [
    (
        {"difficulty": "easy"},
        "difficulty = 'easy' is not allowed; choose from known, uncertain, harsh",
    ),
    ({"difficulty": 1}, "known, uncertain, harsh"),
    ({"difficulty": None}, "known, uncertain, harsh"),
    ({"difficulty": ["known"]}, "known, uncertain, harsh"),
    ({"difficulty": np.array(["known", "harsh"])}, "known, uncertain, harsh"),
    (
        {"action_type": "box"},
        "action_type = 'box' is not allowed; choose from discrete, continuous",
    ),
    ({"shaping": True}, "shaping = True is not allowed; choose from dmax, none"),
    ({"shaping": None}, "dmax, none"),
    ({"discount": 0.0}, "discount = 0.0 is not allowed; give a number in (0, 1]"),
    ({"discount": 1.01}, "(0, 1]"),
    ({"discount": math.nan}, "(0, 1]"),
    ({"discount": "0.99"}, "(0, 1]"),
    ({"discount": True}, "(0, 1]"),
    ({"discount": np.bool_(True)}, "(0, 1]"),
    ({"discount": 10**400}, "(0, 1]"),
    ({"decision_s": 0.0}, "decision_s = 0.0 is not allowed; give a number in (0, 1e+09]"),
    ({"decision_s": -1.0}, "(0, 1e+09]"),
    ({"decision_s": math.inf}, "(0, 1e+09]"),
    ({"decision_s": np.float32(np.nan)}, "(0, 1e+09]"),
    ({"decision_s": "30"}, "(0, 1e+09]"),
    ({"decision_s": 1j}, "(0, 1e+09]"),
    ({"decision_s": True}, "decision_s = True is not allowed; give a number in (0, 1e+09]"),
    (
        {"decision_s": 1e-6},
        "decision_s = 1e-06 is not allowed; give 0.29 to 1200 s, as the battery of",
    ),
    ({"decision_s": 0.28}, "'rusti_computer' lasts 5804 s: 5 to 20000 decisions"),
    ({"decision_s": 1201.0}, "decision_s = 1201 is not allowed; give 0.29 to 1200 s"),
    (
        {"decision_s": 1e9, "robot": "husky"},
        "give 0.54 to 2200 s, as the battery of 'husky' lasts 10868 s",
    ),
    ({"dificulty": "known"}, "unknown keyword 'dificulty' (did you mean 'difficulty'?)"),
    (
        {"colour": "red"},
        "unknown keyword 'colour'; allowed: robot, route, difficulty, instruments, weather, action_type",
    ),
    (
        {"robot": "rusty"},
        "presets: f1tenth, husky, jackal, rusti, rusti_computer, turtlebot3_burger (did you mean",
    ),
    ({"robot": "no/such.toml"}, "presets: f1tenth, husky, jackal"),
    ({"robot": None}, "robot = None is not a preset name"),
    ({"route": "incline2"}, "known: generated, hidden_wind, box, incline"),
]


def makers() -> dict[str, Callable[..., Any]]:
    return {
        "make": lambda **options: gym.make(IDS["Survey"], **options),
        "make_vec": lambda **options: gym.make_vec(
            IDS["Survey"], 2, "vector_entry_point", **options
        ),
    }


@pytest.mark.parametrize("maker", makers())
@pytest.mark.parametrize(("options", "says"), OPTIONS, ids=lambda value: str(value)[:40])
def test_options_that_cannot_be_used_say_what_can(
    maker: str, options: dict[str, Any], says: str
) -> None:
    with pytest.raises(ValueError) as caught:
        makers()[maker](**options)
    assert says in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "number", [30, 30.0, np.float32(30.0), np.float64(30.0), np.int64(30), Fraction(30)]
)
def test_any_real_number_is_a_number(number: Any) -> None:
    env = HomewardEnv(decision_s=number, discount=type(number)(1))
    shared = env.batch.known.shared[0]
    assert (shared["decision_s"], shared["discount"]) == (30.0, 1.0)
    assert type(env.options.decision_s) is type(env.options.discount) is float


@pytest.mark.parametrize("decision_s", [0.29, 1200.0])
def test_the_bounds_of_a_decision_are_allowed_as_they_are_told(decision_s: float) -> None:
    env = HomewardEnv(mission="OutAndBack", decision_s=decision_s)
    env.reset(seed=0)
    *_, info = env.step([4, 0, GO])
    assert info["position_m"] == pytest.approx(decision_s)


@pytest.mark.parametrize("robot", preset_names())
def test_a_decision_a_second_is_allowed_for_every_preset(robot: str) -> None:
    assert HomewardEnv(robot=robot, decision_s=1).options.decision_s == 1.0


def test_a_wrong_keyword_lists_the_right_ones() -> None:
    options = (
        "robot, route, difficulty, instruments, weather, action_type, shaping, discount, decision_s, randomise, "
        "true_robot, scaled_for, docks, time_limit_s, "
    )
    with pytest.raises(OptionError, match=options + "render_mode$"):
        gym.make(IDS["Patrol"], rute="box")
    with pytest.raises(OptionError, match=options + "num_envs, autoreset_mode, render_mode$"):
        gym.make_vec(IDS["Patrol"], 2, "vector_entry_point", rute="box")


def test_an_unknown_id_names_the_known_ones() -> None:
    with pytest.raises(NameNotFound, match=r"Did you mean: `Survey`"):
        gym.make("homeward/Survei-v0")
    with pytest.raises(OptionError, match="choose from OutAndBack, Survey, Patrol"):
        HomewardEnv(mission="Survei")
    with pytest.raises(OptionError, match="choose from OutAndBack, Survey, Patrol"):
        HomewardVectorEnv(2, mission="survey")


@pytest.mark.parametrize("count", [0, -1, 2.0, "2", None])
def test_a_number_of_missions_that_is_none(count: Any) -> None:
    with pytest.raises(OptionError, match=r"num_envs = .* whole number of at least 1"):
        HomewardVectorEnv(count)


def test_modes_that_do_not_exist() -> None:
    with pytest.raises(OptionError, match="choose from NextStep, SameStep, Disabled"):
        HomewardVectorEnv(2, autoreset_mode="later")
    with pytest.raises(OptionError, match="choose from None, human, rgb_array, ansi"):
        HomewardEnv(render_mode="rgb")
    with pytest.raises(OptionError, match="render a scalar environment"):
        HomewardVectorEnv(2, render_mode="ansi")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("mass_kg = 0.78", "mass_kg = -0.78"), "body.mass_kg = -0.78"),
        (("mass_kg = 0.78", "mass = 0.78"), "body.mass = 0.78 is not a known field"),
        (("mass_kg = 0.78", ""), "body.mass_kg is missing"),
        (("mass_kg = 0.78", "mass_kg = nan"), "body.mass_kg = nan"),
        (("[body]", "[body"), "not a readable TOML file"),
    ],
)
def test_a_broken_robot_file_is_named_with_its_field(
    tmp_path: Path, change: tuple[str, str], says: str
) -> None:
    path = tmp_path / "robot.toml"
    text = load_robot("rusti").to_toml()
    assert change[0] in text
    path.write_text(text.replace(*change), encoding="utf-8")
    with pytest.raises(RobotError) as caught:
        gym.make(IDS["Survey"], robot=path)
    assert says in str(caught.value) and str(path) in str(caught.value)


def test_a_robot_that_never_runs_empty_is_refused() -> None:
    downhill = {"regeneration": {"share": 0.9}, "hidden_grade": {"slope": -0.5}}
    with pytest.raises(OptionError, match="'rusti' never runs empty"):
        HomewardEnv(robot=dataclasses.replace(load_robot("rusti"), effects=downhill))


DISCRETE: list[tuple[Any, str]] = [
    (
        [5, 0, 1],
        "[5, 0, 1] of env 0 is not allowed; give speed and sensing levels 0 to 4 and 0 (stop)",
    ),
    ([0, 0, 3], "1 (go) or 2 (return)"),
    ([0, -1, 1], "[0, -1, 1]"),
    ([0.0, 0.0, 1.0], "dtype float64; give int64"),
    ([math.nan, 0, 1], "dtype float64; give int64"),
    ([True, False, True], "dtype bool; give int64"),
    (["a", "b", "c"], "dtype <U1; give int64"),
    ([0, 0], "shape (2,); give (3,)"),
    ([[0, 0, 1]], "shape (1, 3); give (3,)"),
    (1, "shape (); give (3,)"),
    (None, "give (3,)"),
    (np.array([2**63, 0, 1], np.uint64), "is not allowed"),
]
CONTINUOUS: list[tuple[Any, str]] = [
    ([1.5, 0.0, 0.0], "[1.5, 0.0, 0.0] of env 0 is not allowed; give three numbers within [-1, 1]"),
    ([0.0, -1.001, 0.0], "within [-1, 1]"),
    ([0.0, 0.0, math.nan], "within [-1, 1]"),
    ([math.inf, 0.0, 0.0], "within [-1, 1]"),
    ([-math.inf, 0.0, 0.0], "within [-1, 1]"),
    ([1e300, 0.0, 0.0], "within [-1, 1]"),
    ([1j, 0.0, 0.0], "dtype complex128; give float32"),
    (["a", "b", "c"], "dtype <U1; give float32"),
    ([0.0, 0.0], "shape (2,); give (3,)"),
    (0.0, "shape (); give (3,)"),
]


@pytest.mark.parametrize(
    ("action_type", "action", "says"),
    [("discrete", *case) for case in DISCRETE] + [("continuous", *case) for case in CONTINUOUS],
)
def test_actions_that_are_none_step_nothing(action_type: str, action: Any, says: str) -> None:
    env = make("Survey", action_type=action_type)
    env.reset(seed=0)
    before = env.batch.records.copy()
    with pytest.raises(OptionError) as caught:
        env.step(action)
    assert says in str(caught.value) and "\n" not in str(caught.value)
    np.testing.assert_array_equal(env.batch.records, before)
    *_, info = env.step([4, 0, GO] if action_type == "discrete" else [1.0, -1.0, 0.0])
    assert info["position_m"] > 0.0


@pytest.mark.parametrize("count", [3, 600])
def test_one_bad_action_steps_none_of_the_missions(count: int) -> None:
    """Wherever it is, and with the kernel of small and of large vector environments."""
    envs = HomewardVectorEnv(count, action_type="continuous")
    envs.reset(seed=0)
    before = envs.batch.records.copy()
    for index in (0, 1, count - 1):
        actions = np.zeros((count, 3), np.float32)
        actions[index, 1] = math.nan
        with pytest.raises(OptionError, match=rf"of env {index} is not allowed"):
            envs.step(actions)
        np.testing.assert_array_equal(envs.batch.records, before)
    with pytest.raises(OptionError, match=rf"shape \({count - 1}, 3\); give \({count}, 3\)"):
        envs.step(np.zeros((count - 1, 3), np.float32))


def test_integers_of_any_width_and_lists_are_actions() -> None:
    for action in (
        [4, 0, 1],
        (4, 0, 1),
        np.array([4, 0, 1], np.uint8),
        np.array([4, 0, 1], np.int32),
    ):
        env = make("OutAndBack")
        env.reset(seed=0)
        assert env.step(action)[4]["position_m"] == pytest.approx(300.0)
    for level in (np.float16, np.float64, np.int64):
        env = make("OutAndBack", action_type="continuous")
        env.reset(seed=0)
        assert env.step(np.array([1, -1, 0], level))[4]["position_m"] == pytest.approx(300.0)


def test_a_step_before_the_first_reset_is_refused() -> None:
    with pytest.raises(ResetNeeded, match=r"call reset\(\)"):
        HomewardEnv().step([4, 0, GO])
    for mode in AutoresetMode:
        with pytest.raises(ResetNeeded, match=r"call reset\(\)"):
            HomewardVectorEnv(2, autoreset_mode=mode).step(np.zeros((2, 3), np.int64))


def test_a_step_after_the_end_is_refused() -> None:
    env = make("OutAndBack")
    env.reset(seed=0)
    *_, last = drive(env, [[4, 0, RETURN]])
    assert last.terminated
    with pytest.raises(ResetNeeded, match=r"over .* call reset\(\)"):
        env.step([4, 0, GO])
    env.reset()
    env.step([4, 0, GO])


def test_without_autoreset_missions_that_are_over_need_a_reset() -> None:
    envs = HomewardVectorEnv(3, autoreset_mode=AutoresetMode.DISABLED, decision_s=SHORT_S)
    envs.reset(seed=0)
    envs.step(np.array([[4, 0, RETURN], [4, 0, GO], [4, 0, RETURN]]))
    before = envs.batch.records.copy()
    with pytest.raises(OptionError, match=r"missions \[0, 2\] are over"):
        envs.step(np.array([[4, 0, GO]] * 3))
    np.testing.assert_array_equal(envs.batch.records, before)
    envs.reset(options={"reset_mask": np.array([True, False, False])})
    with pytest.raises(OptionError, match=r"missions \[2\] are over"):
        envs.step(np.array([[4, 0, GO]] * 3))


@pytest.mark.parametrize(
    "seed",
    [[1, 2], [1, 2, 3, 4], (), "abc", 1.5, [1.5, 2, 3], -1, [0, 1, -5], np.zeros((3, 1), int)],
)
def test_seeds_that_are_none(seed: Any) -> None:
    envs = HomewardVectorEnv(3)
    with pytest.raises(OptionError, match="seed"):
        envs.reset(seed=seed)
    envs.reset(seed=np.array([1, 2, 3]))  # type: ignore[arg-type]
    np.testing.assert_array_equal(envs.reset(seed=[1, 2, 3])[0], envs.reset(seed=np.int64(1))[0])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "mask",
    [
        np.array([True, False]),
        np.array([1, 0, 1]),
        np.zeros(3, bool),
        np.ones((3, 1), bool),
        "all",
        None,
    ],
)
def test_masks_that_are_none(mask: Any) -> None:
    envs = HomewardVectorEnv(3)
    envs.reset(seed=0)
    with pytest.raises(OptionError, match=r"reset_mask must be a bool array of shape \(3,\)"):
        envs.reset(options={"reset_mask": mask})


def test_a_mask_before_the_first_reset_is_refused() -> None:
    with pytest.raises(OptionError, match=r"call reset\(\) without one first"):
        HomewardVectorEnv(2).reset(options={"reset_mask": np.array([True, False])})


SECRET_ROBOT = dataclasses.replace(
    load_robot("rusti"),
    name="secret",
    mass_kg=0.7654321,
    rolling_resistance=0.8765432,
    rated_energy_j=65432.1,
)
SECRET_ROUTE = Route(
    300.0, np.full(8, 0.0543219), np.full(8, 0.6543217), np.linspace(1.0, 2.0, 8), np.full(8, 1.2345678), 17.654321,
    4.3210987, 2.3456789,
)  # fmt: skip


def leaves(value: Any, seen: dict[int, Any]) -> Iterator[Any]:
    """Everything that can be reached through fields, items and elements."""
    if id(value) in seen:
        return
    seen[id(value)] = value  # kept, so that no other comes to have its id
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield value
        for name in dir(value):
            if not name.startswith("_") and not callable(getattr(value, name)):
                yield from leaves(getattr(value, name), seen)
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from leaves(item, seen)
    elif isinstance(value, np.ndarray | np.void) and value.dtype.names:
        for name in value.dtype.names:
            yield from leaves(np.atleast_1d(value[name]), seen)
    elif isinstance(value, np.ndarray | np.void):
        yield from np.atleast_1d(value).ravel().tolist()
    elif isinstance(value, list | tuple):
        for item in value:
            yield from leaves(item, seen)
    else:
        yield value


@pytest.mark.parametrize("source", ["options", "batch"])
@pytest.mark.parametrize("difficulty", ["uncertain", "harsh"])
@pytest.mark.parametrize("mission", IDS)
def test_what_is_known_holds_nothing_hidden(mission: str, difficulty: str, source: str) -> None:
    """Walked through to the last number: no true robot, no route, no weather and no meter's
    error."""
    options: dict[str, Any] = {
        "difficulty": difficulty,
        "true_robot": SECRET_ROBOT,
        "route": SECRET_ROUTE,
    }
    env = HomewardEnv(mission=mission, **options)
    env.reset(seed=0)
    env.step([4, 4, GO])
    known = env.batch.known if source == "batch" else known_of(Options(mission, **options))
    found = list(leaves(known, {}))
    assert len(found) > 100
    for value in found:
        assert not isinstance(value, Route | Hidden | Batch)
        assert not isinstance(value, Robot) or value == known.robot != SECRET_ROBOT
    numbers = np.array([float(value) for value in found if isinstance(value, int | float)])
    m, p = env.batch.records[0], env.batch.robots[0]
    hidden = [float(m[name]) for name in ("capacity_j", "energy_j", "wind_mps", "wind_from_rad", "mean_east_mps",
              "gust_east_mps", "gust_keeps", "temperature_c", "warming_k", "meter_gain", "key")]  # fmt: skip
    hidden += [float(m["meter_offset_w"])] if difficulty == "harsh" else []
    hidden += [float(p[name]) for name in ("mass_kg", "rolling_resistance", "payload_mass_kg")]
    hidden += [SECRET_ROBOT.usable_energy_j, SECRET_ROBOT.mass_kg, SECRET_ROBOT.rolling_resistance]
    hidden += [
        0.0543219,
        float(np.sin(0.0543219)),
        0.6543217,
        1.2345678,
        17.654321,
        4.3210987,
        2.3456789,
    ]
    for secret in hidden:
        assert not np.isclose(numbers, secret, rtol=1e-6, atol=0.0).any(), secret


def test_what_is_known_is_the_same_whatever_is_hidden() -> None:
    """Another true robot and another wind; of a given route, its length, mean interest and places
    are known."""
    calm = dataclasses.replace(
        SECRET_ROUTE, wind_mps=0.0, temperature_c=3.0, grade_rad=-SECRET_ROUTE.grade_rad
    )
    for changes in ({"true_robot": SECRET_ROBOT}, {"route": calm}):
        options: dict[str, Any] = {"route": SECRET_ROUTE}
        one, other = (known_of(Options("Survey", **each)) for each in (options, options | changes))
        assert (one.mission, one.robot, one.difficulty, one.instruments) == (
            other.mission, other.robot, other.difficulty, other.instruments
        )  # fmt: skip
        np.testing.assert_array_equal(one.shared, other.shared)


def test_what_is_known_is_made_without_anything_hidden() -> None:
    """Of its own memory; a batch lays it out beside what is hidden, for its kernels."""
    known = known_of(Options("Survey", true_robot=SECRET_ROBOT))
    assert known.shared.base is None and known.shared.dtype == SHARED_DTYPE
    batch_known = HomewardEnv(true_robot=SECRET_ROBOT).batch.known
    travelled = pickle.loads(pickle.dumps(batch_known))
    np.testing.assert_array_equal(travelled.shared, known.shared)
    memory = travelled.shared.base
    assert memory is None or memoryview(memory).nbytes == known.shared.nbytes
    assert (travelled.robot, travelled.difficulty, travelled.instruments) == (
        known.robot, known.difficulty, known.instruments
    )  # fmt: skip
