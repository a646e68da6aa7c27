"""Robots that are not what they take themselves for, and robots that differ on the same routes."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from homeward import RobotError, load_robot
from homeward.envs.conditions.difficulty import DIFFICULTIES
from homeward.envs.options import OptionError
from homeward.envs.scalar import HomewardEnv
from homeward.envs.vector import HomewardVectorEnv
from tests.envs.rollouts import MISSIONS, drive, mission, random_actions

BELIEVED = load_robot("husky")
TRUE = dataclasses.replace(
    BELIEVED,
    rolling_resistance=0.2,
    rated_energy_j=0.9 * BELIEVED.rated_energy_j,
    effects={"turning": {"scrub": 0.6}, "surface": {"gain": 1.0}, "compute": {"power_w": 40.0}},
)
SCALES = ("length_m", "reach_m", "link_m", "backlog_limit", "radio_hz", "saturation_per_m", "decision_s",
          "max_decisions", "pit_stop_s", "score_scale", "information_per_m")  # fmt: skip


def missions(options: dict[str, Any]) -> tuple[HomewardEnv, list[Any]]:
    """A mission under random commands: its environment and, of every step, the observation and what
    was consumed."""
    env = HomewardEnv(**options)
    env.reset(seed=3)
    steps = drive(env, random_actions(np.random.default_rng(3), "discrete", 150, home=0.02))
    return env, [(step.observation, step.reward, dict(step.info["energy_j"])) for step in steps]


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
@pytest.mark.parametrize("mission_id", MISSIONS)
def test_a_robot_that_is_what_it_takes_itself_for_is_the_usual_one(
    mission_id: str, difficulty: str
) -> None:
    options: dict[str, Any] = {"mission": mission_id, "difficulty": difficulty, "robot": BELIEVED}
    same = dataclasses.replace(BELIEVED, name="same")
    _, alone = missions(options)
    _, given = missions(options | {"true_robot": same, "scaled_for": same})
    assert len(alone) == len(given) > 20
    for one, other in zip(alone, given, strict=True):
        np.testing.assert_array_equal(one[0], other[0])
        assert one[1:] == other[1:]


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_it_consumes_what_the_true_robot_does_and_maps_what_it_believes(difficulty: str) -> None:
    common: dict[str, Any] = {"mission": "Survey", "difficulty": difficulty}
    mistaken, steps = missions(common | {"robot": BELIEVED, "true_robot": TRUE})
    aware, expected = missions(common | {"robot": TRUE, "scaled_for": BELIEVED})
    right, _ = missions(common | {"robot": BELIEVED})
    # The one is the other but for what it believes.
    assert [one[2] for one in steps] == [one[2] for one in expected]
    assert mission(mistaken)["energy_j"] == mission(aware)["energy_j"]
    assert mission(mistaken)["position_m"] == mission(aware)["position_m"]
    assert mission(mistaken)["modelled_j"] < 0.9 * mission(aware)["modelled_j"]
    # The map home of the places that both came to is that of the file.
    seen = min(mission(mistaken)["mapped"], mission(right)["mapped"])
    for name in ("home_cost_j", "out_j_per_m", "standing_w"):
        np.testing.assert_array_equal(
            mistaken.batch.routes["places"][name][0, :seen],
            right.batch.routes["places"][name][0, :seen],
        )


def test_its_gauge_shows_a_share_of_what_it_believes_in() -> None:
    env = HomewardEnv(robot=BELIEVED, true_robot=TRUE, difficulty="known")
    observation, _ = env.reset(seed=0)
    assert observation[0] == 1.0
    assert mission(env)["capacity_j"] == pytest.approx(TRUE.usable_energy_j)
    assert env.batch.known.robot is BELIEVED


@pytest.mark.parametrize("difficulty", ["known", "uncertain"])
@pytest.mark.parametrize("count", [4, 300])  # one after another, and on all cores
def test_side_by_side_it_goes_as_alone(count: int, difficulty: str) -> None:
    options: dict[str, Any] = {
        "mission": "Survey",
        "robot": BELIEVED,
        "true_robot": TRUE,
        "difficulty": difficulty,
    }
    env = HomewardVectorEnv(count, **options)
    observations, _ = env.reset(seed=11)
    alone = HomewardEnv(**options)
    last = count - 1
    np.testing.assert_array_equal(alone.reset(seed=11 + last)[0], observations[last])
    for _ in range(30):
        observations, rewards, *_ = env.step(np.tile([3, 2, 1], (count, 1)))
        observation, reward, *_ = alone.step([3, 2, 1])
        np.testing.assert_array_equal(observation, observations[last])
        assert reward == rewards[last]
    assert (env.batch.robots["compute_power_w"] == 40.0).all()


@pytest.mark.parametrize("mission_id", MISSIONS)
def test_robots_scaled_for_one_meet_the_same_routes_and_limits(mission_id: str) -> None:
    envs = [
        HomewardEnv(mission=mission_id, robot=robot, scaled_for=BELIEVED, difficulty="known")
        for robot in (BELIEVED, TRUE)
    ]
    for env in envs:
        env.reset(seed=5)
    nominal, other = (env.batch for env in envs)
    for name in ("sin_grade", "roughness", "curvature_per_m", "interest"):
        np.testing.assert_array_equal(nominal.routes["places"][name], other.routes["places"][name])
    for name in SCALES:
        assert nominal.known.shared[name] == other.known.shared[name], name
    assert other.known.shared["usable_j"] == pytest.approx(TRUE.usable_energy_j)
    assert other.known.shared["energy_per_m"] > nominal.known.shared["energy_per_m"]


@pytest.mark.parametrize("option", ["true_robot", "scaled_for"])
def test_a_robot_that_is_none_is_refused(option: str) -> None:
    unknown: dict[str, Any] = {option: "huskie"}
    with pytest.raises(RobotError, match="robot 'huskie' is neither a preset nor a file"):
        HomewardEnv(**unknown)
    downhill = {"regeneration": {"share": 0.9}, "hidden_grade": {"slope": -0.5}}
    endless: dict[str, Any] = {option: dataclasses.replace(BELIEVED, effects=downhill)}
    with pytest.raises(OptionError, match="'husky' never runs empty on level ground"):
        HomewardEnv(**endless)
