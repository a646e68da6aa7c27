"""A seed is an episode: the same in both forms and in NumPy's own streams, whatever the difficulty."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from homeward.envs import difficulty as difficulties
from homeward.envs.difficulty import DIFFICULTIES
from homeward.envs.routes import GENERATED, HIDDEN_WIND, generate
from homeward.envs.state import GO, MISSION_DTYPE, PLACE_DTYPE, ROUTE_DTYPE, SHARED_DTYPE
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
    for name in ("capacity_j", "temperature_c", "wind_mps", "gauge_bias"):
        assert len(np.unique(envs.batch.records[name])) == 50
    for name in ("rolling_resistance", "payload_mass_kg", "surface_gain"):
        assert len(np.unique(envs.batch.robots[name])) == 50


def test_a_seed_is_the_same_day_at_every_difficulty() -> None:
    days = []
    for difficulty in DIFFICULTIES:
        env = make("OutAndBack", difficulty=difficulty)
        env.reset(seed=23)
        days.append(env.batch.routes["places"][0][list(GROUND)].copy())
    np.testing.assert_array_equal(days[0], days[1])
    np.testing.assert_array_equal(days[0], days[2])


@pytest.mark.parametrize("route", [GENERATED, HIDDEN_WIND])
@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_the_stream_is_numpys(difficulty: str, route: str) -> None:
    """The day as plain Python draws it from NumPy's generator, and the generator in the same state afterwards."""
    env = make("Survey", difficulty=difficulty, route=route)
    env.reset(seed=99)
    m, p, places, rng = by_python(env, seed=99)
    batch = env.batch
    for name in ("capacity_j", "energy_j", "gauge_bias", "temperature_c"):
        assert batch.records[name][0] == pytest.approx(float(m[name]), rel=1e-12)
    if difficulty != "known":  # the paper's robot feels no wind
        assert batch.records["wind_mps"][0] == pytest.approx(float(m["wind_mps"]), rel=1e-12)
        assert batch.records["wind_from_rad"][0] == pytest.approx(float(m["wind_from_rad"]), rel=1e-6)
    for name in ("rolling_resistance", "payload_mass_kg", "wind_exposure", "surface_gain", "effects"):
        assert batch.robots[name][0] == pytest.approx(float(p[name]), rel=1e-12)
    for name in GROUND:
        used = slice(int(batch.known.shared["places"][0]))
        np.testing.assert_allclose(batch.routes["places"][name][0, used], places[name][used], rtol=1e-5, atol=1e-7)
    assert env.np_random.bit_generator.state == rng.bit_generator.state


def by_python(env: Any, seed: int) -> tuple[Any, Any, Any, np.random.Generator]:
    known, rng = env.batch.known, np.random.default_rng(seed)
    m, route = np.recarray(1, MISSION_DTYPE)[0], np.recarray(1, ROUTE_DTYPE)[0]
    nominal, p = (known.robot.record().view(np.recarray)[0] for _ in range(2))
    assert nominal.dtype == ROBOT_DTYPE and route.places.dtype == PLACE_DTYPE
    shared = known.shared.copy().view(np.recarray)[0]
    assert shared.dtype == SHARED_DTYPE
    difficulties.draw(rng, p, nominal, m, shared)
    generate(rng, route, m, int(shared.places), float(shared.length_m), bool(shared.hidden_wind))
    return m, p, route.places, rng


def test_missions_do_not_draw_while_they_run() -> None:
    env = make("Patrol", difficulty="harsh")
    env.reset(seed=1)
    before = env.np_random.bit_generator.state
    env.step([4, 4, GO])
    assert env.np_random.bit_generator.state == before
