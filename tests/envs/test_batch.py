"""A seed is an episode: the same in both forms and in NumPy's own streams, whatever the difficulty
and instruments."""

from __future__ import annotations

import ctypes
import itertools
import signal
from typing import Any

import numpy as np
import pytest

from homeward.envs.conditions import difficulty as difficulties
from homeward.envs.conditions import instruments, weather
from homeward.envs.conditions.difficulty import DIFFICULTIES
from homeward.envs.conditions.instruments import INSTRUMENTS
from homeward.envs.routes.route import GENERATED, HIDDEN_WIND, generate
from homeward.envs.state import (
    GO,
    HIDDEN_DTYPE,
    MISSION_DTYPE,
    PLACE_DTYPE,
    ROUTE_DTYPE,
    SHARED_DTYPE,
)
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics.robot import ROBOT_DTYPE
from tests.envs.rollouts import MISSIONS, drive, make, random_actions

GROUND = ("sin_grade", "roughness", "curvature_per_m", "east", "north", "interest")


@pytest.mark.parametrize("mission", MISSIONS)
@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_the_same_seed_is_the_same_episode(mission: str, difficulty: str) -> None:
    actions = random_actions(np.random.default_rng(0), "discrete", 40)
    episodes = []
    for env in (make(mission, difficulty=difficulty), make(mission, difficulty=difficulty)):
        for _ in range(2):  # another episode in between
            first, _ = env.reset(seed=17)
            episodes.append([first, *(step.observation for step in drive(env, actions))])
    for episode in episodes[1:]:
        np.testing.assert_array_equal(episode, episodes[0])


def test_without_a_seed_the_generator_goes_on() -> None:
    env, same = make("Survey"), make("Survey")
    env.reset(seed=5)
    same.reset(seed=5)
    days = [env.batch.routes.copy()]
    for _ in range(3):
        np.testing.assert_array_equal(env.reset()[0], same.reset()[0])
        days.append(env.batch.routes.copy())
    for i, day in enumerate(days):
        assert not any((day == other).all() for other in days[i + 1 :])


def test_without_any_seed_episodes_differ() -> None:
    first, second = make("Survey"), make("Survey")
    first.reset()
    second.reset()
    assert first.np_random_seed != second.np_random_seed
    assert not (first.batch.routes == second.batch.routes).all()


def test_different_seeds_are_different_episodes() -> None:
    envs = HomewardVectorEnv(50, difficulty="harsh")
    envs.reset(seed=0)
    for name in (
        "capacity_j",
        "temperature_c",
        "wind_mps",
        "meter_gain",
        "meter_offset_w",
        "gust_keeps",
        "key",
    ):
        assert len(np.unique(envs.batch.records[name])) == 50
    for name in ("rolling_resistance", "payload_mass_kg", "surface_gain"):
        assert len(np.unique(envs.batch.robots[name])) == 50


def test_a_seed_is_the_same_day_at_every_difficulty() -> None:
    days: list[Any] = []
    for difficulty in DIFFICULTIES:
        env = make("OutAndBack", difficulty=difficulty)
        env.reset(seed=23)
        days.append(env.batch.routes["places"][0][list(GROUND)].copy())
    np.testing.assert_array_equal(days[0], days[1])
    np.testing.assert_array_equal(days[0], days[2])


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_a_seed_is_the_same_mission_with_any_instruments(difficulty: str) -> None:
    """What is read differs, and nothing that happens; what an instrument lacks is drawn all the
    same."""
    envs = [
        HomewardVectorEnv(4, difficulty=difficulty, instruments=name, autoreset_mode="Disabled")
        for name in INSTRUMENTS
    ]
    read = {
        "soc",
        "metered",
        "metered_j",
        "read_w",
        "read_mps",
        "soc_followed",
        "meter_gain",
        "meter_offset_w",
    }
    read |= {
        "metered_followed",
        "sum_used_metered",
        "sum_metered_squared",
        "gauge",
        "gauge_shift",
        "soc_lowest",
    }
    read |= {"here", "potential", "shaping_reward"}  # grades are read too
    actions = random_actions(np.random.default_rng(0), "discrete", 4 * 30, home=0.0).reshape(
        30, 4, 3
    )
    for env in envs:
        env.reset(seed=5)
        for action in actions:
            env.step(action)
    exact, *others = (env.batch for env in envs)
    for other in others:
        differ = {
            name
            for name in MISSION_DTYPE.names or ()
            if (other.records[name] != exact.records[name]).any()
        }
        assert {"soc", "metered", "read_w", "read_mps"} <= differ <= read | {"modelled_j"}
        np.testing.assert_array_equal(other.robots, exact.robots)
        for name in GROUND:
            np.testing.assert_array_equal(
                other.routes["places"][name], exact.routes["places"][name]
            )
        states = [[one.bit_generator.state for one in batch.generators] for batch in (exact, other)]
        assert states[0] == states[1]


@pytest.mark.parametrize("route", [GENERATED, HIDDEN_WIND])
@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_the_stream_is_numpys(difficulty: str, route: str) -> None:
    """The day as plain Python draws it from NumPy's generator, and the generator in the same state
    afterwards."""
    env = make("Survey", difficulty=difficulty, route=route)
    env.reset(seed=99)
    m, p, places, rng = by_python(env, seed=99)
    batch = env.batch
    for name in (
        "capacity_j",
        "energy_j",
        "temperature_c",
        "key",
        "meter_gain",
        "meter_offset_w",
        "gust_keeps",
    ):
        assert batch.records[name][0] == pytest.approx(float(m[name]), rel=1e-12)
    if difficulty != "known":  # the paper's robot feels no wind
        assert batch.records["wind_mps"][0] == pytest.approx(float(m["wind_mps"]), rel=1e-12)
        for name in (
            "wind_from_rad",
            "gust_east_mps",
            "gust_north_mps",
            "forecast_east_mps",
            "forecast_north_mps",
        ):
            assert batch.records[name][0] == pytest.approx(float(m[name]), rel=1e-6), name
    for name in (
        "rolling_resistance",
        "payload_mass_kg",
        "wind_exposure",
        "surface_gain",
        "effects",
    ):
        assert batch.robots[name][0] == pytest.approx(float(p[name]), rel=1e-12)
    for name in GROUND:
        used = slice(int(batch.known.shared["places"][0]))
        np.testing.assert_allclose(
            batch.routes["places"][name][0, used], places[name][used], rtol=1e-5, atol=1e-7
        )
    assert env.np_random.bit_generator.state == rng.bit_generator.state


def by_python(env: Any, seed: int) -> tuple[Any, Any, Any, np.random.Generator]:
    batch, rng = env.batch, np.random.default_rng(seed)
    m, route = np.recarray(1, MISSION_DTYPE)[0], np.recarray(1, ROUTE_DTYPE)[0]
    truth, p = (batch.known.robot.record().view(np.recarray)[0] for _ in range(2))
    assert truth.dtype == ROBOT_DTYPE and route.places.dtype == PLACE_DTYPE
    shared, hidden = (
        record.copy().view(np.recarray)[0] for record in (batch.known.shared, batch.hidden.record)
    )
    assert shared.dtype == SHARED_DTYPE and hidden.dtype == HIDDEN_DTYPE
    m.key = np.uint64(2.0**53 * rng.random())
    with np.errstate(over="ignore"):  # of unsigned integers, as in compiled code
        instruments.begin(m, shared, rng.random(), rng.random())
    difficulties.draw(rng, p, truth, m, hidden)
    generate(rng, route, m, int(shared.places), float(shared.length_m), bool(hidden.hidden_wind))
    weather.begin(m, rng, shared, hidden)
    return m, p, route.places, rng


# numba reads each generator by six; at the later three it would crash
@pytest.mark.parametrize("call", range(6))
def test_ctrl_c_while_numba_reads_a_generator_comes_after_it(
    call: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = make("Survey")
    env.reset(seed=5)
    cast, calls = ctypes.cast, itertools.count()

    def pressed(*arguments: Any) -> Any:
        if next(calls) == call:
            signal.raise_signal(signal.SIGINT)
        return cast(*arguments)

    monkeypatch.setattr(ctypes, "cast", pressed)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            env.reset(seed=6)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert next(calls) > call
    same = make("Survey")
    np.testing.assert_array_equal(env.reset(seed=7)[0], same.reset(seed=7)[0])


def test_missions_do_not_draw_while_they_run() -> None:
    env = make("Patrol", difficulty="harsh")
    env.reset(seed=1)
    before = env.np_random.bit_generator.state
    env.step([4, 4, GO])
    assert env.np_random.bit_generator.state == before
