"""The estimator in a world of its own: calibrated, sharp, and hard to fool."""

from __future__ import annotations

import numpy as np
import pytest

from homeward.estimation import Estimator
from homeward.estimation.prior import EAST, NORTH, ROLLING, USED, WEIGHT
from tests.estimation.world import (
    COUNT,
    EXACT,
    GAUGE,
    METER,
    PLACES,
    ROBOT,
    Instruments,
    World,
    begin,
    drive,
    home_error,
)


@pytest.mark.parametrize(("instruments", "rough"), [(METER, False), (GAUGE, True)])
def test_intervals_hold_what_they_say_and_are_narrow(instruments: Instruments, rough: bool) -> None:
    world = World(ROBOT, COUNT, 5, instruments, rough=rough)
    estimator = begin(world, rough)
    drive(world, estimator, 30)
    error, deviation, below = home_error(world, estimator)
    assert 0.83 < np.mean(np.abs(error) < 1.645 * deviation) < 0.97
    assert abs(np.mean(error)) < 0.003
    assert np.mean(deviation) < 0.02
    assert np.mean(below) < 0.03


def test_with_exact_instruments_and_nothing_hidden_it_knows() -> None:
    world = World(ROBOT, COUNT, 6, EXACT, wind_sd_mps=0.0)
    estimator = begin(world, wind_sd_mps=0.0, forecast_sd_mps=0.0, missed=0.0)
    drive(world, estimator, 30)
    mean = estimator.estimate().mean
    assert np.median(np.abs(mean[:, ROLLING] - world.rolling * world.mass)) < 0.02
    assert np.median(np.abs(mean[:, WEIGHT] - world.mass)) < 0.03
    error, _, _ = home_error(world, estimator)
    assert np.sqrt(np.mean(error**2)) < 0.003


def test_wind_is_found_on_a_route_that_turns() -> None:
    world = World(ROBOT, COUNT, 7, METER)
    estimator = begin(world)
    before = np.hypot(*(world.forecast - world.wind).T)
    drive(world, estimator, 40)
    after = np.hypot(*(estimator.estimate().mean[:, [EAST, NORTH]] - world.wind).T)
    assert np.median(after) < 0.7 * np.median(before)


def test_on_the_way_home_it_stays_sure() -> None:
    world = World(ROBOT, COUNT, 8, GAUGE, rough=True)
    estimator = begin(world, rough=True)
    drive(world, estimator, 30)
    for _ in range(15):
        world.drive(-1.0, world.cruise_mps, 0.0)
        estimator.update(world.read(), np.ones(COUNT, np.bool_))
    error, deviation, below = home_error(world, estimator)
    assert np.mean(np.abs(error) < 1.645 * deviation) > 0.8
    assert np.sqrt(np.mean(error**2)) < 0.015
    assert np.mean(below) < 0.03


@pytest.mark.parametrize("straight", [True, False])
def test_a_forecast_that_is_wrong_by_far_strands_few(straight: bool) -> None:
    world = World(ROBOT, COUNT, 16, METER, straight=straight)
    angle = world.rng.uniform(0.0, 2.0 * np.pi, COUNT)
    world.forecast = world.wind + 6.0 * np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    estimator = begin(world)
    drive(world, estimator, 30)
    error, _, below = home_error(world, estimator)
    assert np.sqrt(np.mean(error**2)) < 0.05
    assert np.mean(below) < 0.08


def test_a_state_that_is_put_back_goes_on_alike() -> None:
    world = World(ROBOT, 3, 11, GAUGE, rough=True)
    one = begin(world, rough=True)
    drive(world, one, 5)
    other = Estimator(one.vehicle, one.prior, PLACES, 3)
    other.state[:] = one.state
    world.drive(1.0, world.cruise_mps, 0.0)
    readings = world.read()
    for estimator in (one, other):
        estimator.update(readings, np.ones(3, np.bool_))
    assert one.state.tobytes() == other.state.tobytes()


def test_only_asked_robots_change() -> None:
    world = World(ROBOT, 3, 12, METER)
    estimator = begin(world)
    drive(world, estimator, 3)
    state = estimator.state.copy()
    world.drive(1.0, world.cruise_mps, 0.0)
    estimator.update(world.read(), np.array([False, True, False]))
    estimator.begin(np.array([False, False, True]), np.zeros(3), np.zeros(3))
    assert estimator.state[0] == state[0]
    assert estimator.estimate().mean[1, USED] > state["hypotheses"]["mean"][1, 0, USED]
    assert estimator.estimate().mean[2, USED] == 0.0
