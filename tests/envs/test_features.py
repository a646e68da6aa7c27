"""Observations: what their names say, within their space, and nothing that the robot cannot know."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from homeward import load_robot
from homeward.envs.difficulty import DIFFICULTIES
from homeward.envs.features import FEATURES, NAMES
from homeward.envs.options import ACTION_TYPES
from homeward.envs.scalar import HomewardEnv
from homeward.envs.state import GO, RETURN, STOP
from homeward.envs.vector import HomewardVectorEnv
from tests.envs.rollouts import MISSIONS, SHORT_S, drive, feature, make, mission, random_actions, route_file, windy

MEASURED = {"energy", "margin", "consumption"}
"""Features through which hidden parameters may show: the fuel gauge, and what follows from it."""
HILLS = "distance_m,grade_rad,interest\n0,0.02,1\n1000,0.1,2\n2000,-0.05,0.5\n3000,0.06,3\n"


def differing(one: Any, other: Any) -> set[str]:
    return {name for name, a, b in zip(NAMES, one, other, strict=True) if a != b}


@pytest.mark.parametrize("action_type", ACTION_TYPES)
@pytest.mark.parametrize("difficulty", DIFFICULTIES)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_observations_stay_in_their_space(mission_id: str, difficulty: str, action_type: str) -> None:
    envs = HomewardVectorEnv(
        30, mission=mission_id, difficulty=difficulty, action_type=action_type, decision_s=SHORT_S, route="hidden_wind"
    )
    observations, _ = envs.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(40):
        assert observations in envs.observation_space and observations.dtype == np.float32
        observations, rewards, *_ = envs.step(random_actions(rng, action_type, 30))
        assert np.isfinite(rewards).all()


def test_the_table_names_every_feature_once() -> None:
    assert len(set(NAMES)) == len(FEATURES) == len(make("Survey").reset()[0])
    assert all(unit and meaning for _, unit, meaning in FEATURES)


@pytest.mark.parametrize("difficulty", ["uncertain", "harsh"])
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_hidden_parameters_show_in_the_consumption_only(tmp_path: Path, mission_id: str, difficulty: str) -> None:
    """On one route, another seed is another battery, payload, rolling resistance and gauge."""
    path = route_file(tmp_path, HILLS)
    envs = HomewardVectorEnv(8, mission=mission_id, difficulty=difficulty, route=path, decision_s=60.0)
    observations, _ = envs.reset(seed=0)
    assert len(np.unique(envs.batch.records["capacity_j"])) == 8
    for other in observations[1:]:
        assert not differing(observations[0], other)
    for action in [[4, 2, GO]] * 6 + [[2, 1, STOP], [3, 4, GO], [4, 0, RETURN], [4, 0, RETURN]]:
        observations, _, terminated, *_ = envs.step(np.array([action] * 8))
        assert not terminated.any()
        for other in observations[1:]:
            assert differing(observations[0], other) == MEASURED


@pytest.mark.parametrize("column", ["roughness", "wind_mps"])
@pytest.mark.parametrize("difficulty", ["uncertain", "harsh"])
def test_wind_and_ground_show_in_the_consumption_only(tmp_path: Path, difficulty: str, column: str) -> None:
    seen = []
    for value in (0, 3):
        path = route_file(tmp_path, f"distance_m,{column}\n0,{value}\n3000,{value}\n", f"{value}.csv")
        env = make("Survey", difficulty=difficulty, route=path)
        first, _ = env.reset(seed=4)
        seen.append([first, *(step.observation for step in drive(env, [[4, 2, GO]] * 3))])
    assert not differing(seen[0][0], seen[1][0])
    felt = column == "wind_mps" or difficulty == "harsh"
    for one, other in zip(seen[0][1:], seen[1][1:], strict=True):
        assert differing(one, other) == (MEASURED if felt else set())


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_harsh_looks_like_uncertain_until_it_is_driven(mission_id: str) -> None:
    uncertain, harsh = (make(mission_id, difficulty=difficulty) for difficulty in ("uncertain", "harsh"))
    for seed in range(5):
        assert not differing(uncertain.reset(seed=seed)[0], harsh.reset(seed=seed)[0])


def test_the_gauge_of_harsh_is_biased_and_that_of_uncertain_is_not() -> None:
    for difficulty in DIFFICULTIES:
        envs = HomewardVectorEnv(20, difficulty=difficulty, mission="OutAndBack", decision_s=SHORT_S)
        envs.reset(seed=0)
        for _ in range(5):
            observations, *_ = envs.step(np.array([[4, 0, GO]] * 20))
        records = envs.batch.records
        used = 1.0 - records["energy_j"] / records["capacity_j"]
        off = np.abs(1.0 - observations[:, NAMES.index("energy")] - used)
        assert (off < 1e-6).all() if difficulty != "harsh" else (off > 1e-4).all()


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_only_a_known_route_is_seen_beyond_sight(tmp_path: Path, difficulty: str) -> None:
    """Two routes that part after three of 31 places, with the same mean grade and length."""
    rows = np.full((63, 2), 0.02), np.full((63, 2), 0.02)
    for table, swing in zip(rows, (0.05, -0.05), strict=True):
        table[:, 1] = 1.0
        table[20:30, 0] += swing
        table[40:50, 0] -= swing
        table[20:30, 1] += 20.0 * swing
        table[40:50, 1] -= 20.0 * swing
    firsts = []
    for i, table in enumerate(rows):
        lines = [f"{50.0 * k},{np.arcsin(grade)},{interest}" for k, (grade, interest) in enumerate(table)]
        path = route_file(tmp_path, "\n".join(["distance_m,grade_rad,interest", *lines]), f"{i}.csv")
        firsts.append(make("OutAndBack", difficulty=difficulty, route=path).reset(seed=0)[0])
    assert differing(*firsts) <= {"grade_far", "interest_far", "grade_mean"}
    far = {"grade_far", "interest_far"}
    assert differing(*firsts) & far == (far if difficulty == "known" else set())
    assert feature(firsts[0], "grade_mean") == pytest.approx(feature(firsts[1], "grade_mean"), abs=1e-4)
    if difficulty != "known":
        assert feature(firsts[0], "grade_far") == feature(firsts[0], "interest_far") == 0.0


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_the_headwind_is_told_only_when_nothing_is_hidden(tmp_path: Path, difficulty: str) -> None:
    path = route_file(tmp_path, "distance_m,wind_mps,wind_from_rad\n0,4,0\n3000,4,0\n")
    env = make(
        "OutAndBack", difficulty=difficulty, route=path, robot=windy(load_robot("rusti_computer")), decision_s=60.0
    )
    first, _ = env.reset(seed=0)
    out, back = (step.observation for step in drive(env, [[4, 0, GO], [0, 0, RETURN]]))
    headwinds = [feature(observation, "headwind") for observation in (first, out, back)]
    assert headwinds == pytest.approx([0.4, 0.4, -0.4] if difficulty == "known" else [0.0, 0.0, 0.0])


def test_features_are_what_they_are_called(tmp_path: Path) -> None:
    path = route_file(tmp_path, HILLS)
    env = make("Survey", difficulty="known", route=path, decision_s=100.0)
    first, _ = env.reset(seed=0)
    shared, m = env.batch.known.shared[0], mission(env)
    zero = "distance home_cost consumption modelled returning speed sensing backlog score time pit_stop"
    assert {name: feature(first, name) for name in zero.split()} == dict.fromkeys(zero.split(), 0.0)
    assert (
        feature(first, "energy")
        == feature(first, "margin")
        == feature(first, "outbound")
        == feature(first, "link")
        == 1.0
    )
    assert feature(first, "temperature") == pytest.approx(0.5)
    step = next(drive(env, [[2, 3, GO]]))
    seen = {name: feature(step.observation, name) for name in NAMES}
    position_m = 100.0 * 0.55
    place = env.batch.routes["places"][0, int(position_m // shared["place_m"])]
    expected = {
        "energy": m["energy_j"] / shared["usable_j"],
        "distance": position_m / shared["reach_m"],
        "margin": seen["energy"] - seen["home_cost"],
        "speed": 0.55 / env.batch.known.robot.max_speed_mps,
        "sensing": 0.75,
        "grade": 10.0 * place["sin_grade"],
        "interest": 0.5 * place["interest"],
        "backlog": m["backlog"] / shared["backlog_limit"],
        "link": 1.0 / (1.0 + (position_m / shared["link_m"]) ** 2),
        "score": step.info["score"] / shared["score_scale"],
        "time": 1.0 / shared["max_decisions"],
        "modelled": m["modelled_j"] / shared["usable_j"],
        "returning": 0.0,
        "outbound": 1.0,
    }
    assert {name: seen[name] for name in expected} == pytest.approx(expected, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("robot", ["rusti", "husky"])
def test_the_robots_own_model_is_right_where_nothing_is_hidden(tmp_path: Path, robot: str) -> None:
    """Consumption reads 0, and the cost of the way home is what the way home then costs, at cruise."""
    path = route_file(tmp_path, HILLS)
    env = HomewardEnv(mission="OutAndBack", robot=robot, difficulty="known", route=path)
    env.reset(seed=0)
    *_, out = drive(env, [[4, 0, GO]] * 25)
    assert feature(out.observation, "consumption") == pytest.approx(0.0, abs=1e-4)
    cost = feature(out.observation, "home_cost")
    *_, home = drive(env, itertools.repeat([4, 0, RETURN], 300))
    assert home.info["home"]
    spent = feature(out.observation, "energy") - feature(home.observation, "energy")
    assert spent == pytest.approx(cost, rel=1e-3)
    assert feature(home.observation, "home_cost") == pytest.approx(0.0, abs=1e-6)


def test_measured_over_modelled_consumption_tells_more_of_the_way_home() -> None:
    """Most of what is hidden scales both ways alike; the wind does not."""
    scaled, unscaled = [], []
    for seed in range(30):
        env = HomewardEnv(mission="OutAndBack", difficulty="uncertain")
        env.reset(seed=seed)
        *_, out = drive(env, [[4, 0, GO]] * 50)
        *_, home = drive(env, itertools.repeat([4, 0, RETURN], 300))
        assert home.info["home"]
        cost = feature(out.observation, "home_cost")
        spent = feature(out.observation, "energy") - feature(home.observation, "energy")
        unscaled.append(abs(spent / cost - 1.0))
        scaled.append(abs(spent / (cost * (1.0 + feature(out.observation, "consumption"))) - 1.0))
    assert np.median(scaled) < 0.1 < np.median(unscaled)
