"""The filter: against least squares and closed forms where all is linear, and in a world where it
is not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from homeward.estimation import Prior, vehicle_of
from homeward.estimation.drive import climbing, drag, rolling
from homeward.estimation.filter import HYPOTHESIS_DTYPE, PLACE_DTYPE, _likeliest, place_of
from homeward.estimation.prior import (
    EAST,
    GAIN,
    GUST_EAST,
    GUST_NORTH,
    NORTH,
    PER_CAPACITY,
    ROLLED,
    ROLLING,
    STATES,
    USED,
    WEIGHT,
)
from homeward.physics import mission_energy
from tests.estimation.world import (
    CALM,
    COUNT,
    GAUGE,
    METER,
    PLACE_M,
    ROBOT,
    Array,
    World,
    alone,
    begin,
    drive,
    home_error,
    read,
)


def test_where_all_is_linear_it_is_least_squares() -> None:
    """In still air a reading is gain, rolling and weight times what the model and the slopes say:
    regression on all three, with the prior as three more readings."""
    prior = CALM._replace(
        gain_sd=0.02, rolling_sd=0.144, mass_sd=0.058, rolling=1.05, mass=1.1, power_noise=0.05
    )  # fmt: skip
    estimator = alone(prior)
    v, rng = estimator.vehicle, np.random.default_rng(0)
    before = estimator.estimate()
    truth, of = np.array([1.03, 1.3, 1.18]), [GAIN, ROLLING, WEIGHT]
    sines = rng.normal(0.0, 0.03, 40)
    rows, readings = [], []
    for k, sine in enumerate(sines):
        # From the middle of a place to that of the next: half of the way has the slope of each.
        parts = [(0.5 * PLACE_M, one) for one in sines[max(k - 1, 0) : k + 1]]
        way_m = sum(length_m for length_m, _ in parts)
        dt_s = way_m / 0.5
        rolls_j = sum(rolling(v, one) * length_m for length_m, one in parts)
        climbs_j = sum(climbing(v, one) * length_m for length_m, one in parts)
        others_j = drag(v, 0.5, 0.0) * way_m + v.idle_w * dt_s
        rows.append(np.array([others_j, rolls_j, climbs_j]) / v.full_j)
        readings.append(rows[-1] @ truth * (1.0 + 0.05 * rng.normal()))
        read(
            estimator,
            dt_s,
            (k + 0.5) * PLACE_M,
            power_w=float(readings[-1]) * v.full_j / dt_s,
            sine=sine,
        )
    measured, precision = np.array(rows), 1.0 / (0.05 * np.array(readings)) ** 2
    own = before.covariance[0][np.ix_(of, of)]
    covariance = np.linalg.inv(np.linalg.inv(own) + measured.T * precision @ measured)
    mean = covariance @ (
        np.linalg.solve(own, before.mean[0, of]) + measured.T * precision @ np.array(readings)
    )
    after = estimator.estimate()
    # Up to the one reading in a thousand that may be an outlier.
    sd = np.sqrt(np.diag(covariance))
    assert np.abs((after.mean[0, of] - mean) / sd).max() < 0.02
    scale = np.outer(sd, sd)
    np.testing.assert_allclose(
        after.covariance[0][np.ix_(of, of)] / scale, covariance / scale, atol=0.03
    )
    # The energy used is the sum of what was driven, and that of the ground between home and here
    # its rolling part.
    whole = measured.sum(axis=0)
    assert after.mean[0, USED] == pytest.approx(whole @ mean, rel=1e-3)
    with_used = covariance @ whole / sd
    np.testing.assert_allclose(
        after.covariance[0, USED, of] / sd, with_used, atol=0.03 * np.abs(with_used).max()
    )
    assert after.mean[0, ROLLED] == pytest.approx(whole[1] * mean[1], rel=1e-3)
    assert after.covariance[0, ROLLED, ROLLING] == pytest.approx(
        whole[1] * covariance[1, 1], rel=0.03
    )


def test_on_even_ground_the_whole_way_rolls_as_its_end_does_whatever_wind_is_learnt() -> None:
    """Each turn tells wind from rolling, and moves what the way consumed and what new ground will
    by the same share."""
    estimator = alone(CALM._replace(rolling_sd=0.144, wind_sd_mps=1.5, forecast_sd_mps=1.0))
    v, rng, rolls = estimator.vehicle, np.random.default_rng(0), 0.0
    for k in range(1, 41):
        east, north = float(np.cos(0.15 * k)), float(np.sin(0.15 * k))
        force_n = 1.2 * rolling(v, 0.0) + drag(v, 0.5, 2.0 * east)
        power_w = (v.idle_w + 0.5 * force_n) * (1.0 + 0.01 * rng.normal())
        read(estimator, 100.0, 50.0 * k, power_w=power_w, east=east, north=north)
        rolls += rolling(v, 0.0) * 50.0 / v.full_j
        mean = estimator.mean()[0]
        assert mean[ROLLED] == pytest.approx(rolls * mean[ROLLING], rel=1e-3)


def test_states_of_charge_are_least_squares_of_the_capacity() -> None:
    """Of a robot of which all else is known: charge used is energy used over the capacity."""
    prior = CALM._replace(capacity=0.9, capacity_sd=0.058, soc_noise=0.01)
    estimator = alone(prior)
    rng, capacity, used = np.random.default_rng(1), 0.83, []
    before = estimator.estimate()
    first, variance = before.mean[0, PER_CAPACITY], before.covariance[0, PER_CAPACITY, PER_CAPACITY]
    total = first / variance
    for k in range(1, 13):
        used.append(float(mission_energy(ROBOT, 100.0 * k, 0.5)) / ROBOT.usable_energy_j)
        error = float(rng.normal(0.0, 0.01))
        read(estimator, 200.0, 100.0 * k, soc=1.0 - used[-1] / capacity + error)
        total += used[-1] * (used[-1] / capacity - error) / 0.01**2
    precision = 1.0 / variance + float(np.sum(np.square(used))) / 0.01**2
    after = estimator.estimate()
    assert after.mean[0, USED] == pytest.approx(used[-1])
    assert after.mean[0, PER_CAPACITY] == pytest.approx(total / precision, rel=1e-5)
    assert after.covariance[0, PER_CAPACITY, PER_CAPACITY] == pytest.approx(
        1.0 / precision, rel=1e-4
    )


def test_a_lasting_error_of_the_state_of_charge_is_no_capacity() -> None:
    """Its errors are alike as long as little is used: least squares weighted by their
    covariance."""
    noise, error, lasts = 1e-3, 0.02, 0.05
    prior = CALM._replace(
        capacity=0.9, capacity_sd=0.058, soc_noise=noise, soc_error=error, soc_error_lasts=lasts
    )
    estimator = alone(prior)
    before, capacity = estimator.estimate(), 0.88
    first, variance = before.mean[0, PER_CAPACITY], before.covariance[0, PER_CAPACITY, PER_CAPACITY]
    used = np.array(
        [float(mission_energy(ROBOT, 50.0 * k, 0.5)) / ROBOT.usable_energy_j for k in range(1, 9)]
    )
    covariance = error**2 * np.exp(
        -np.abs(np.subtract.outer(used, used)) / lasts
    ) + noise**2 * np.eye(len(used))
    errors = np.random.default_rng(2).multivariate_normal(np.zeros(len(used)), covariance)
    for k, of in enumerate(errors):
        read(estimator, 100.0, 50.0 * (k + 1), soc=1.0 - used[k] / capacity + of)
    weights = np.linalg.solve(covariance, used)
    precision = 1.0 / variance + weights @ used
    after = estimator.estimate()
    expected = (first / variance + weights @ (used / capacity - errors)) / precision
    assert after.mean[0, PER_CAPACITY] == pytest.approx(expected, rel=1e-5)
    assert after.covariance[0, PER_CAPACITY, PER_CAPACITY] == pytest.approx(
        1.0 / precision, rel=1e-4
    )


@pytest.mark.parametrize("parts", [1, 7])
def test_a_state_of_charge_lags_by_a_first_order_filter(parts: int) -> None:
    """Standing at constant power: by P tau (1 - exp(-t / tau)), however often it is read."""
    estimator = alone(CALM._replace(soc_lag_s=60.0))
    for _ in range(parts):
        read(estimator, 90.0 / parts, 0.0, speed_mps=0.0)
    used_w = estimator.vehicle.idle_w / estimator.vehicle.full_j
    assert estimator.state["robot"]["lag"][0] == pytest.approx(used_w * 60.0 * (1.0 - np.exp(-1.5)))
    assert estimator.mean()[0, USED] == pytest.approx(used_w * 90.0)


def test_out_and_home_of_a_known_robot_is_the_mission_of_eq_7() -> None:
    estimator = alone(CALM)
    for position_m in (30.0, 95.0, 210.0, 150.0, 40.0, 0.0):
        before_m = float(estimator.state["robot"]["position_m"][0])
        read(estimator, abs(position_m - before_m) / 0.5, position_m)
        mean = estimator.mean()[0]
        assert mean[ROLLED] == pytest.approx(
            rolling(estimator.vehicle, 0.0) * position_m / estimator.vehicle.full_j
        )
    assert mean[USED] == pytest.approx(
        float(mission_energy(ROBOT, 420.0, 0.5)) / ROBOT.usable_energy_j
    )


def test_gusts_fade_to_their_spread() -> None:
    """An Ornstein-Uhlenbeck process: the present gusts fade by exp(-t / tau), and new ones come."""
    prior = Prior(gust_s=600.0, missed=0.0)
    estimator = alone(prior, east_mps=4.0, north_mps=-1.0)
    before = estimator.state["hypotheses"][0, 0].copy()
    assert before["mean"][GUST_EAST] > 0.1
    read(estimator, 300.0, 0.0, speed_mps=0.0)
    after, kept = estimator.state["hypotheses"][0, 0], np.exp(-0.5)
    gusts = [GUST_EAST, GUST_NORTH]
    np.testing.assert_allclose(after["mean"][gusts], kept * before["mean"][gusts])
    wind = [EAST, NORTH]
    square = np.sum(before["mean"][wind] ** 2) + np.sum(np.diag(before["covariance"])[wind])
    spread = prior.gust_share**2 * square
    expected = kept**2 * np.diag(before["covariance"])[gusts] + spread * (1.0 - kept**2)
    np.testing.assert_allclose(np.diag(after["covariance"])[gusts], expected)
    np.testing.assert_allclose(
        after["covariance"][EAST, GUST_EAST], kept * before["covariance"][EAST, GUST_EAST]
    )
    np.testing.assert_array_equal(after["mean"][wind], before["mean"][wind])


def test_slopes_are_noted_by_place() -> None:
    """A slope is the mean of the readings in its place, and that of the places that were passed
    since the last one."""
    estimator = alone(CALM)
    for position, sine in ((0.2, 0.01), (0.8, 0.03), (3.5, -0.02), (3.9, np.nan), (2.5, 0.5)):
        read(estimator, 20.0, position * PLACE_M, sine=sine)
    places = estimator.state["places"][0]
    np.testing.assert_allclose(places["sine"][:5], [0.02, -0.02, -0.02, -0.02, 0.0])
    # Driven were 0.2 of the first place at 0.01 and the rest at the mean, as known then.
    np.testing.assert_allclose(
        places["sine_driven"][:4], [0.2 * 0.01 + 0.8 * 0.02, -0.02, -0.02, -0.02]
    )


def test_a_position_is_in_a_place_and_beyond_the_last_in_the_last() -> None:
    vehicle = vehicle_of(ROBOT, PLACE_M)
    places = np.zeros(4, PLACE_DTYPE)
    assert [place_of(vehicle, x * PLACE_M, places) for x in (0.0, 0.99, 1.0, 3.99, 4.0, 1e6)] == [
        0,
        0,
        1,
        3,
        3,
        3,
    ]


@pytest.mark.parametrize("likeliest", range(3))
def test_the_likeliest_hypothesis_decides_for_all_whether_it_coasts(likeliest: int) -> None:
    hypotheses = np.zeros(3, HYPOTHESIS_DTYPE).view(np.recarray)
    hypotheses.log_weight = [-2.0, -np.inf, -3.0]
    hypotheses.log_weight[likeliest] = -0.5
    assert _likeliest(hypotheses) == likeliest


def test_weights_sum_to_one_and_none_is_lost() -> None:
    """A hypothesis that the readings refute may recover: it keeps a millionth of the likeliest."""
    world = World(ROBOT, 20, 18, METER)
    estimator = begin(world)
    drive(world, estimator, 25)
    log_weight = estimator.state["hypotheses"]["log_weight"]
    np.testing.assert_allclose(np.exp(log_weight).sum(axis=1), 1.0)
    relative = log_weight - log_weight.max(axis=1, keepdims=True)
    assert relative.min() == pytest.approx(np.log(1e-6), abs=0.2)


def test_covariances_stay_symmetric_and_positive() -> None:
    world = World(ROBOT, 20, 19, GAUGE, rough=True)
    estimator = begin(world, rough=True)
    drive(world, estimator, 25)
    for _ in range(10):
        world.drive(-1.0, world.cruise_mps, 0.0)
        estimator.update(world.read(), np.ones(20, np.bool_))
    covariance = estimator.state["hypotheses"]["covariance"]
    np.testing.assert_allclose(covariance, covariance.swapaxes(-1, -2), rtol=1e-9, atol=1e-15)
    sd = np.sqrt(np.einsum("nkaa->nka", covariance))
    used = [GAIN, ROLLING, EAST, NORTH, GUST_EAST, GUST_NORTH, USED, PER_CAPACITY, ROLLED]
    correlation = covariance / np.maximum(sd[..., :, None] * sd[..., None, :], 1e-300)
    assert np.all(sd[..., used] > 0.0)
    assert np.linalg.eigvalsh(correlation).min() > -1e-6
    assert covariance.shape[-1] == STATES


def test_a_robot_that_stood_for_a_part_of_the_time_drove_at_the_speed_that_was_read() -> None:
    """Of 100 s it drove 60, at 0.5 m/s: air drag is that of 0.5 m/s, not of the mean of 0.3."""
    used = []
    for speed_mps in (0.5, 0.3):
        estimator = alone(CALM)
        read(estimator, 100.0, 30.0, speed_mps=speed_mps)
        used.append(float(estimator.mean()[0, USED]))
    v = vehicle_of(ROBOT, PLACE_M, 0.5)
    more_j = 30.0 * float(drag(v, 0.5, 0.0) - drag(v, 0.3, 0.0))
    assert (used[0] - used[1]) * v.full_j == pytest.approx(more_j, rel=1e-6)


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


def test_a_reading_that_is_repeated_counts_once() -> None:
    world = World(ROBOT, 3, 10, METER)
    once = begin(world)
    drive(world, once, 5)
    state = once.state.copy()
    once.update(world.read(), np.ones(3, np.bool_))
    assert state.tobytes() == once.state.tobytes()


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
