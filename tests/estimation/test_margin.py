"""Margins: energy left less that of the way, against the range equations, scipy, and drawn
states."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize, stats
from scipy.special import stdtr, stdtrit

from homeward.estimation import WAY_DTYPE, Estimator, margin, thresholds
from homeward.estimation.margin import chance_below, quantile_of_sum
from homeward.estimation.prior import EAST, GUST_EAST, GUST_NORTH, NORTH, STATES
from homeward.estimation.wind import covariance_of_wind
from homeward.physics import mission_energy
from tests.estimation.world import CALM, COUNT, METER, ROBOT, World, alone, begin, drive, read

BEND = np.array([[0.8, 0.3], [0.3, -0.2]])
DRAWS = 400_000


def home_plan(estimator: Estimator, home_mps: float | None = None) -> Any:
    """Head home now; of electronics the model has the idle power on the way."""
    position_m = float(estimator.state["robot"]["position_m"][0])
    v = estimator.vehicle
    at_cruise_j = float(mission_energy(ROBOT, position_m, v.cruise_mps))
    return estimator.plans(np.array([at_cruise_j]), home_mps)


@pytest.mark.parametrize(("out_mps", "home_mps"), [(0.5, 0.5), (0.8, 0.5), (0.3, 1.0)])
def test_out_and_home_of_a_known_robot_is_eq_7(out_mps: float, home_mps: float) -> None:
    estimator = alone(CALM)
    plans = home_plan(estimator, home_mps)
    plans["onwards_m"], plans["speed_mps"], plans["onwards_s"] = 300.0, out_mps, 300.0 / out_mps
    plans["onwards_j"] = estimator.vehicle.idle_w * 300.0 / out_mps
    total = estimator.margin(plans, 1e-3).total[0]
    expected = float(mission_energy(ROBOT, 300.0, out_mps)) + float(
        mission_energy(ROBOT, 300.0, home_mps)
    )
    assert total["cost_j"] == pytest.approx(expected)
    assert total["left_j"] == pytest.approx(ROBOT.usable_energy_j)
    assert total["margin_j"] == pytest.approx(ROBOT.usable_energy_j - expected)
    # nothing is uncertain
    assert total["margin_low_j"] == pytest.approx(total["margin_j"], rel=1e-6)
    assert total["cost_share"] == pytest.approx(expected / ROBOT.usable_energy_j)
    assert total["margin_sd_j"] == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize(("position_m", "home_mps"), [(100.0, 0.5), (330.0, 0.5), (330.0, 0.9)])
def test_from_where_it_is_a_known_robot_gets_home_by_eq_7(
    position_m: float, home_mps: float
) -> None:
    estimator = alone(CALM)
    read(estimator, position_m / 0.5, position_m)
    total = estimator.margin(home_plan(estimator, home_mps), 0.0).total[0]
    home_j = float(mission_energy(ROBOT, position_m, home_mps))
    assert total["cost_j"] == pytest.approx(home_j)
    assert total["left_j"] == pytest.approx(
        ROBOT.usable_energy_j - float(mission_energy(ROBOT, position_m, 0.5))
    )
    assert total["margin_j"] == pytest.approx(total["left_j"] - home_j)


def test_a_slope_counts_the_other_way_round_on_the_way_home() -> None:
    estimator = alone(CALM)
    read(estimator, 400.0, 200.0, sine=0.05)
    v = estimator.vehicle
    down_j = float(mission_energy(ROBOT, 200.0, v.cruise_mps, -np.arcsin(0.05)))
    total = estimator.margin(estimator.plans(np.array([down_j])), 0.0).total[0]
    up_j = float(mission_energy(ROBOT, 200.0, 0.5, np.arcsin(0.05)))
    assert total["cost_j"] == pytest.approx(down_j)
    assert total["left_j"] == pytest.approx(ROBOT.usable_energy_j - up_j)


def test_a_head_wind_on_the_way_home_is_the_drag_of_both_speeds() -> None:
    """Wind from the west against a robot that drove out to the east: behind it out, against it
    home."""
    estimator = alone(CALM)
    read(estimator, 400.0, 200.0)
    h = estimator.state["hypotheses"]
    still = estimator.margin(home_plan(estimator), 0.0).total[0]["cost_j"]
    h["mean"][..., EAST] = -2.0
    windy = estimator.margin(home_plan(estimator), 0.0).total[0]["cost_j"]
    per_n2 = ROBOT.drag_ns2_per_m2 * 200.0 / ROBOT.traction_efficiency
    # Either component of the gusts has 0.3 of the wind as its standard deviation; that along the
    # way adds its square.
    assert windy - still == pytest.approx(per_n2 * (2.5**2 - 0.5**2 + (0.3 * 2.0) ** 2), rel=1e-6)


def test_present_gusts_fade_on_the_way_home() -> None:
    """On average over a way of duration T, a share (1 - exp(-T / tau)) tau / T of them remains."""
    estimator = alone(CALM)
    read(estimator, 400.0, 200.0)
    still = estimator.margin(home_plan(estimator), 0.0).total[0]["cost_j"]
    estimator.state["hypotheses"]["mean"][..., GUST_EAST] = -2.0
    gusty = estimator.margin(home_plan(estimator), 0.0).total[0]["cost_j"]
    share = (1.0 - np.exp(-400.0 / 1040.0)) * 1040.0 / 400.0
    per_n2 = ROBOT.drag_ns2_per_m2 * 200.0 / ROBOT.traction_efficiency
    assert gusty - still == pytest.approx(per_n2 * ((0.5 + 2.0 * share) ** 2 - 0.5**2), rel=1e-6)


def test_a_part_of_the_way_home_may_be_driven_at_another_speed() -> None:
    estimator = alone(CALM)
    read(estimator, 400.0, 200.0)
    plans = home_plan(estimator, 0.9)
    plans["onwards_m"], plans["speed_mps"], plans["onwards_s"] = -80.0, 0.3, 80.0 / 0.3
    plans["onwards_j"] = estimator.vehicle.idle_w * 80.0 / 0.3
    expected = float(mission_energy(ROBOT, 80.0, 0.3)) + float(mission_energy(ROBOT, 120.0, 0.9))
    assert estimator.margin(plans, 0.0).total[0]["cost_j"] == pytest.approx(expected)


def test_another_way_home_is_the_sum_of_its_stretches() -> None:
    estimator = alone(CALM)
    read(estimator, 400.0, 200.0)
    ways = np.array(
        [(120.0, 0.04, 0.0, 1.0, 0.5), (80.0, -0.5, 1.0, 0.0, 0.9), (30.0, 0.0, 1.0, 0.0, 0.5)],
        WAY_DTYPE,
    )
    expected, modelled = (
        sum(
            float(mission_energy(ROBOT, way["way_m"], mps, np.arcsin(way["sine"])))
            for way, mps in zip(ways, speeds, strict=True)
        )
        for speeds in (ways["speed_mps"], [0.5, 0.5, 0.5])
    )
    # Besides driving, a way home has what the model says at cruise, here the electronics.
    slower_j = estimator.vehicle.idle_w * float(
        np.sum(ways["way_m"] / ways["speed_mps"] - ways["way_m"] / 0.5)
    )
    plans = estimator.plans(np.array([modelled + slower_j]))
    plans["elsewhere"] = 1.0
    assert estimator.margin(plans, 0.0, ways).total[0]["cost_j"] == pytest.approx(expected)


def test_one_uncertain_capacity_gives_a_normal_margin() -> None:
    estimator = alone(CALM._replace(capacity=0.8, capacity_sd=0.02))
    for risk in (1e-6, 1e-3, 0.3, 0.5):
        total = estimator.margin(home_plan(estimator), risk).total[0]
        assert total["margin_j"] == pytest.approx(0.8 * ROBOT.usable_energy_j, rel=1e-3)
        assert total["margin_sd_j"] == pytest.approx(0.02 * ROBOT.usable_energy_j, rel=1e-2)
        expected = total["margin_j"] + stats.norm.ppf(risk) * total["margin_sd_j"]
        assert total["margin_low_j"] == pytest.approx(expected, rel=1e-4)


def test_what_a_plan_is_unsure_of_widens_the_margin() -> None:
    estimator = alone(CALM)
    plans = home_plan(estimator)
    plans["unsure_j"] = 700.0
    total = estimator.margin(plans, 1e-3).total[0]
    assert total["margin_sd_j"] == pytest.approx(700.0, rel=1e-6) == total["cost_sd_j"]


def test_without_a_risk_there_is_no_quantile_and_without_a_way_home_no_margin() -> None:
    estimator = alone(CALM)
    assert np.isnan(estimator.margin(home_plan(estimator), 0.0).total["margin_low_j"][0])
    given = estimator.margin(estimator.plans(np.array([np.nan])), 1e-3)
    assert not given.weight.any() and given.total["margin_j"][0] == 0.0


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
    # Half a way home that is driven first changes nothing: the same energy is taken before and
    # after.
    plans = estimator.plans(world.home_cost_j)
    plans["onwards_m"] = -0.5 * world.position_m
    plans["onwards_j"] = 0.588 * 0.5 * world.position_m / world.cruise_mps
    plans["onwards_s"] = 0.5 * world.position_m / world.cruise_mps
    assert np.allclose(
        estimator.margin(plans, 1e-3).total["margin_j"], now["margin_j"], rtol=0.02, atol=50.0
    )


def test_the_third_cumulant_is_that_of_drawn_states_and_gusts_to_come() -> None:
    rng = np.random.default_rng(2)
    root = 0.4 * rng.normal(size=(STATES, STATES))
    p, slope, stays, to_come = root @ root.T, 0.3 * rng.normal(size=STATES), 0.5, 0.3
    states = rng.multivariate_normal(np.zeros(STATES), p, DRAWS)
    come = rng.normal(0.0, to_come**0.5, (DRAWS, 2))
    wind = states[:, [EAST, NORTH]] + stays * states[:, [GUST_EAST, GUST_NORTH]] + come
    energy = (
        states @ slope
        + come @ slope[[EAST, NORTH]]
        + 0.5 * np.einsum("na,ab,nb->n", wind, BEND, wind)
    )
    expected = np.mean((energy - energy.mean()) ** 3)
    among = np.array(covariance_of_wind(p, stays, to_come))
    assert margin._third_cumulant(
        p, slope, np.array([0.8, 0.3, -0.2]), among, stays, to_come
    ) == pytest.approx(expected, rel=0.1)


def quantile(each: Any, risk: float) -> float:
    return float(margin._quantile(each, risk, float(stats.norm.ppf(risk))))


@pytest.mark.parametrize("skewness", [-1.0, -0.3, 0.0, 0.3, 1.0])
@pytest.mark.parametrize("risk", [1e-6, 1e-3, 0.1])
def test_a_quantile_is_that_of_a_skewed_distribution(skewness: float, risk: float) -> None:
    each = np.array([[0.0, 5.0, 1.0, 0.0], [1.0, 0.2, 0.03, skewness]])
    deviations = (quantile(each, risk) - 0.2) / 0.03
    assert deviations == pytest.approx(stats.pearson3.ppf(risk, skewness), rel=0.04)


def test_a_rare_hypothesis_counts_where_the_risk_is_as_small() -> None:
    each = np.array([[0.999, 1.0, 0.01, 0.0], [0.001, 0.2, 0.01, 0.0]])
    assert quantile(each, 0.01) > 0.9
    assert quantile(each, 1e-4) < 0.25


def test_a_mixture_has_the_quantile_that_a_root_search_finds() -> None:
    each = np.array(
        [[0.6, 1.0, 0.1, 0.0], [0.3, 0.5, 0.3, 0.0], [0.1, -2.0, 0.01, 0.0], [0.0, -99.0, 0.0, 0.0]]
    )
    weight, mean, sd, _ = each[:3].T
    for risk in (1e-6, 1e-3, 0.05, 0.1, 0.4, 0.9):
        expected = optimize.brentq(
            lambda x, r=risk: weight @ stats.norm.cdf((x - mean) / sd) - r, -5.0, 5.0
        )
        # The tolerance is in probability, and in a gap between hypotheses any number has the same.
        below = weight @ stats.norm.cdf((quantile(each, risk) - mean) / sd)
        assert quantile(each, risk) == pytest.approx(expected, abs=1e-3) or below == pytest.approx(
            risk, rel=2e-3
        )


@given(st.floats(-4.0, 4.0), st.floats(-1.0, 1.0))
def test_a_probability_undoes_its_deviations(z: float, skewness: float) -> None:
    deviations = margin._deviations(z, skewness)
    assert margin._below(deviations, skewness) == pytest.approx(stats.norm.cdf(z), rel=1e-6)


def test_a_sum_with_a_second_number_has_the_tails_of_student() -> None:
    each = np.array([[0.3, 1.0, 2.0, 0.0], [0.7, -2.0, 0.5, 0.0]])
    totals, weights = np.array([0.0, 3.0]), np.array([0.4, 0.6])
    for value in (-30.0, -4.0, 0.5, 6.0):
        expected = sum(
            part[0] * weight * float(stdtr(thresholds.DEGREES, (value - part[1] - total) / part[2]))
            for part in each
            for total, weight in zip(totals, weights, strict=True)
        )
        assert chance_below(each, totals, weights, value, 0.0) == pytest.approx(expected, rel=1e-6)
    for risk in (1e-6, 1e-3, 0.3):
        value = quantile_of_sum(
            each, totals, weights, risk, float(stdtrit(thresholds.DEGREES, risk))
        )
        assert chance_below(each, totals, weights, value, 0.0) == pytest.approx(risk, rel=0.05)


def test_a_sum_of_exact_numbers_is_certainly_below_or_not() -> None:
    """Without a deviation a value is infinitely many of them away."""
    each = np.array([[1.0, 5.0, 0.0, 0.0]])
    totals, weights = np.array([1.0]), np.array([1.0])
    for value, below in ((-1e9, 0.0), (5.9, 0.0), (6.1, 1.0), (1e9, 1.0)):
        assert chance_below(each, totals, weights, value, 0.0) == pytest.approx(below, abs=1e-12)


def test_the_quantile_of_a_sum_ends_where_no_number_is_between_its_parts() -> None:
    """Energies so large that neighbouring numbers are farther apart than what is asked for."""
    each = np.array(
        [[0.5, -2.58978540e18, 1.0466e17, 0.0], [0.5, -2.58978540e18, 1.0466e17, -1e-12]]
    )
    each[1, 1] = np.nextafter(each[0, 1], 0.0)
    value = quantile_of_sum(each, np.full(3, -1.728e6), np.full(3, 1.0 / 3.0), 1e-3, -4.785)
    assert value == pytest.approx(-2.58978540e18 - 4.785 * 1.0466e17, rel=0.01)
