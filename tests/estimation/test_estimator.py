"""The estimator in a world of its own: calibrated, sharp, and hard to fool."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from homeward.estimation import Estimator, Prior, vehicle_of
from homeward.estimation.prior import EAST, GAIN, NORTH, ROLLING, USED, WEIGHT
from homeward.physics import load_robot
from tests.estimation.world import EXACT, GAUGE, METER, PLACES, Array, Instruments, World, prior_of

ROBOT = load_robot("rusti_computer")
COUNT = 300


def begin(world: World, rough: bool = False, **prior: Any) -> Estimator:
    known = prior_of(world.robot, world.instruments, rough=rough, route_m=world.route_m, **prior)
    estimator = Estimator(vehicle_of(world.robot, world.place_m), known, PLACES, world.count)
    estimator.begin(np.ones(world.count, np.bool_), *world.forecast.T)
    return estimator


def drive(world: World, estimator: Estimator, decisions: int, change: Any = None) -> None:
    """Drive out, every eighth decision at half speed; `change` may spoil what is read."""
    for decision in range(decisions):
        world.drive(1.0, 0.55 if decision % 8 == 1 else world.cruise_mps, 0.0)
        readings = world.read()
        if change is not None:
            change(decision, readings)
        estimator.update(readings, np.ones(world.count, np.bool_))


def home_error(world: World, estimator: Estimator) -> tuple[Array, Array, Array]:
    """Way home beyond what was believed, its standard deviation, and whether the margin is below its 1e-3 quantile."""
    home_j = world.way_home_j(99)
    total = estimator.margin(estimator.plans(world.home_cost_j), 1e-3).total
    margin_j = (world.capacity_j - world.used_j - home_j) * world.gain
    return home_j / world.capacity_j - total["cost_share"], total["cost_share_sd"], margin_j < total["margin_low_j"]


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


def nothing(decision: int, readings: Array) -> None:
    readings["power_w"] = np.where(decision % 3 == 1, np.nan, readings["power_w"])


def absurd(decision: int, readings: Array) -> None:
    readings["power_w"] *= 100.0 if decision in (5, 20) else 1.0


def stuck(decision: int, readings: Array) -> None:
    if decision >= 10:
        readings["soc"] = 0.95


def dead(decision: int, readings: Array) -> None:
    readings["soc"] = np.nan


@pytest.mark.parametrize("change", [nothing, absurd, stuck, dead])
def test_bad_readings_do_not_fool_it(change: Any) -> None:
    world = World(ROBOT, COUNT, 9, METER)
    estimator = begin(world)
    drive(world, estimator, 30, change)
    error, deviation, below = home_error(world, estimator)
    assert np.mean(np.abs(error) < 1.645 * deviation) > 0.8
    assert np.mean(below) < 0.04


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


def test_a_reading_that_is_repeated_counts_once() -> None:
    world = World(ROBOT, 3, 10, METER)
    once = begin(world)
    drive(world, once, 5)
    state = once.state.copy()
    once.update(world.read(), np.ones(3, np.bool_))
    assert state.tobytes() == once.state.tobytes()


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


def test_standing_for_long_costs_what_it_costs() -> None:
    world = World(ROBOT, COUNT, 13, GAUGE, rough=True)
    estimator = begin(world, rough=True)
    drive(world, estimator, 15)
    for _ in range(30):
        world.drive(1.0, 0.0, 0.0, 10.0 * world.decision_s)
        estimator.update(world.read(), np.ones(COUNT, np.bool_))
    error, deviation, below = home_error(world, estimator)
    assert np.mean(np.abs(error) < 1.645 * deviation) > 0.8
    assert np.mean(below) < 0.03
    assert np.abs(estimator.estimate().mean[:, GAIN] - 1.0).max() < 0.1


def test_irregular_times() -> None:
    world = World(ROBOT, COUNT, 14, METER)
    estimator = begin(world)
    for _ in range(30):
        lasts_s = world.decision_s * np.exp(world.rng.uniform(-0.8, 0.8))
        world.drive(1.0, world.rng.choice([0.55, 1.0]), 0.0, lasts_s)
        estimator.update(world.read(), np.ones(COUNT, np.bool_))
    error, deviation, below = home_error(world, estimator)
    assert np.mean(np.abs(error) < 1.645 * deviation) > 0.8
    assert np.mean(below) < 0.03


def test_going_on_costs_more_than_turning() -> None:
    world = World(ROBOT, COUNT, 15, METER)
    estimator = begin(world)
    drive(world, estimator, 20)
    plans = estimator.plans(world.home_cost_j)
    now = estimator.margin(plans, 1e-3).total
    plans["onwards_m"], plans["onwards_s"] = world.decision_s * world.cruise_mps, world.decision_s
    plans["onwards_j"] = 0.588 * world.decision_s
    later = estimator.margin(plans, 1e-3).total
    assert np.all(later["margin_j"] < now["margin_j"])
    assert np.all(later["margin_low_j"] < now["margin_low_j"])
    # Half a way home that is driven first changes nothing: the same energy is taken before and after.
    plans = estimator.plans(world.home_cost_j)
    plans["onwards_m"] = -0.5 * world.position_m
    plans["onwards_j"] = 0.588 * 0.5 * world.position_m / world.cruise_mps
    plans["onwards_s"] = 0.5 * world.position_m / world.cruise_mps
    assert np.allclose(estimator.margin(plans, 1e-3).total["margin_j"], now["margin_j"], rtol=0.02, atol=50.0)


def test_prior_can_be_changed_in_one_number() -> None:
    assert Prior()._replace(missed=0.5).missed == 0.5
