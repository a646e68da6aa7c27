"""Robots drawn as uncertain as their file says it is."""

import dataclasses
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from homeward.agents.belief import prior_of
from homeward.envs.conditions.difficulty import DIFFICULTY
from homeward.envs.options import OptionError, Options, constants_of, known_of
from homeward.envs.vector import HomewardVectorEnv
from homeward.physics import Robot, load_robot
from homeward.physics.uncertainty import Uncertainty


@pytest.fixture
def sure() -> Robot:
    table = Uncertainty(
        "a test",
        ("rolling", "capacity"),
        ((0.0016, 0.0), (0.0, 0.0004)),
        0.03,
        0.1,
        5.0,
        (("power_noise", 0.02),),
    )
    return dataclasses.replace(load_robot("husky"), uncertainty=table)


def changed(robot: Robot, **table: Any) -> Robot:
    """The robot with another table."""
    assert robot.uncertainty is not None
    return dataclasses.replace(robot, uncertainty=dataclasses.replace(robot.uncertainty, **table))


def test_robots_are_as_uncertain_as_the_file(sure: Robot) -> None:
    env = HomewardVectorEnv(4000, mission="OutAndBack", robot=sure, randomise="file")
    env.reset(seed=0)
    rolling = env.batch.robots["rolling_resistance"] / sure.rolling_resistance
    health = env.batch.records["capacity_j"] / sure.usable_energy_j
    assert rolling.mean() == pytest.approx(1.0, abs=0.005)
    assert rolling.std() == pytest.approx(np.hypot(0.04, 0.03), rel=0.05)  # and between runs
    assert health.mean() == pytest.approx(1.0, abs=0.005) and health.std() == pytest.approx(
        0.02, rel=0.05
    )


def test_agents_have_it_as_their_prior_and_the_instruments_are_its_own(sure: Robot) -> None:
    known = known_of(Options("OutAndBack", robot=sure, randomise="file"))
    prior = prior_of(known, 0.2)
    assert (prior.rolling, prior.capacity) == pytest.approx((1.0, 1.0))
    assert prior.rolling_sd == pytest.approx(0.05) and prior.capacity_sd == pytest.approx(0.02)
    # of which it says nothing: the difficulty's meter
    assert prior.power_noise == 0.02 and prior.soc_step == 1e-3
    assert known.difficulty.payload == DIFFICULTY["uncertain"].payload  # it does not say
    often = changed(sure, instruments=(("power_noise", 0.02), ("reading_s", 0.1)))
    # what is read is a mean over a decision
    mean = known_of(Options("OutAndBack", robot=often, randomise="file"))
    assert mean.instruments.power_noise == pytest.approx(
        0.02 * (0.1 / mean.shared["decision_s"][0]) ** 0.5
    )


def test_of_one_run_it_is_not_known_how_runs_differ(sure: Robot) -> None:
    one = changed(sure, between_runs=None)
    known = known_of(Options("OutAndBack", robot=one, randomise="file"))
    assert known.difficulty.rolling == DIFFICULTY["uncertain"].rolling
    measured = known_of(Options("OutAndBack", robot=changed(one, of="force"), randomise="file"))
    # as a coast-down test states it
    assert measured.difficulty.rolling.deviation == pytest.approx(0.04)


def test_charge_of_motors_is_no_energy(sure: Robot) -> None:
    charge = changed(sure, of="charge")
    with pytest.raises(OptionError, match="no table"):
        known_of(Options("OutAndBack", robot=charge, randomise="file"))


def test_without_it_nothing_changes(sure: Robot) -> None:
    plain, generic = (
        constants_of(Options("Survey", robot=one))[1].record for one in (load_robot("husky"), sure)
    )
    assert plain.tobytes() == generic.tobytes()


def test_it_is_a_keyword_of_make(sure: Robot) -> None:
    env = gym.make("homeward:homeward/OutAndBack-v0", robot=sure, randomise="file")
    env.reset(seed=0)
    env.close()


@pytest.mark.parametrize(
    ("robot", "difficulty", "said"),
    [("husky", "uncertain", "has no table"), (None, "known", "nothing is hidden at `known`")],
)
def test_where_there_is_nothing_to_draw(
    sure: Robot, robot: str | None, difficulty: str, said: str
) -> None:
    with pytest.raises(OptionError, match=said):
        known_of(
            Options("OutAndBack", robot=robot or sure, difficulty=difficulty, randomise="file")
        )
    with pytest.raises(OptionError, match="randomise = 'wide'"):
        Options("OutAndBack", randomise="wide")
