"""Second order of the wind, and the tail that it gives to a margin: against drawn winds and scipy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from homeward.estimation import margin
from homeward.estimation.prior import EAST, GUST_EAST, GUST_NORTH, NORTH, STATES
from homeward.estimation.wind import covariance_of_wind, curvature

BEND = np.array([[0.8, 0.3], [0.3, -0.2]])
DRAWS = 400_000


def triple(matrix: np.ndarray) -> np.ndarray:
    return np.array([matrix[0, 0], matrix[0, 1], matrix[1, 1]])


def test_the_covariance_of_the_wind_is_that_of_mean_and_gusts() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(STATES, STATES))
    p, stays, to_come = root @ root.T, 0.4, 0.7
    takes = np.zeros((2, STATES))
    takes[0, EAST], takes[0, GUST_EAST], takes[1, NORTH], takes[1, GUST_NORTH] = 1.0, stays, 1.0, stays
    expected = takes @ p @ takes.T + to_come * np.eye(2)
    np.testing.assert_allclose(covariance_of_wind(p, stays, to_come), triple(expected))


def test_cumulants_of_the_second_order_are_those_of_drawn_winds() -> None:
    wind = np.array([[1.5, 0.4], [0.4, 0.6]])
    drawn = np.random.default_rng(1).multivariate_normal(np.zeros(2), wind, DRAWS)
    energy = 0.5 * np.einsum("na,ab,nb->n", drawn, BEND, drawn)
    mean, variance, third = curvature(triple(BEND), triple(wind))
    assert mean == pytest.approx(energy.mean(), rel=0.02)
    assert variance == pytest.approx(energy.var(), rel=0.02)
    assert third == pytest.approx(np.mean((energy - energy.mean()) ** 3), rel=0.1)


def test_the_third_cumulant_is_that_of_drawn_states_and_gusts_to_come() -> None:
    rng = np.random.default_rng(2)
    root = 0.4 * rng.normal(size=(STATES, STATES))
    p, slope, stays, to_come = root @ root.T, 0.3 * rng.normal(size=STATES), 0.5, 0.3
    states = rng.multivariate_normal(np.zeros(STATES), p, DRAWS)
    come = rng.normal(0.0, to_come**0.5, (DRAWS, 2))
    wind = states[:, [EAST, NORTH]] + stays * states[:, [GUST_EAST, GUST_NORTH]] + come
    energy = states @ slope + come @ slope[[EAST, NORTH]] + 0.5 * np.einsum("na,ab,nb->n", wind, BEND, wind)
    expected = np.mean((energy - energy.mean()) ** 3)
    among = np.array(covariance_of_wind(p, stays, to_come))
    assert margin._third_cumulant(p, slope, triple(BEND), among, stays, to_come) == pytest.approx(expected, rel=0.1)


def quantile(each: Any, risk: float) -> float:
    return float(margin._quantile(each, risk, margin._normal_quantile(risk)))


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
