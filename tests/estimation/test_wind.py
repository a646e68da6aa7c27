"""Covariance and second order of the wind, against matrices and drawn winds."""

from __future__ import annotations

import numpy as np
import pytest

from homeward.estimation.prior import EAST, GUST_EAST, GUST_NORTH, NORTH, STATES
from homeward.estimation.wind import covariance_of_wind, quadratic_cumulants

BEND = np.array([[0.8, 0.3], [0.3, -0.2]])
DRAWS = 400_000


def triple(matrix: np.ndarray) -> np.ndarray:
    return np.array([matrix[0, 0], matrix[0, 1], matrix[1, 1]])


def test_the_covariance_of_the_wind_is_that_of_mean_and_gusts() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(STATES, STATES))
    p, stays, to_come = root @ root.T, 0.4, 0.7
    takes = np.zeros((2, STATES))
    takes[0, EAST], takes[0, GUST_EAST], takes[1, NORTH], takes[1, GUST_NORTH] = (
        1.0,
        stays,
        1.0,
        stays,
    )
    expected = takes @ p @ takes.T + to_come * np.eye(2)
    np.testing.assert_allclose(covariance_of_wind(p, stays, to_come), triple(expected))


def test_cumulants_of_the_second_order_are_those_of_drawn_winds() -> None:
    wind = np.array([[1.5, 0.4], [0.4, 0.6]])
    drawn = np.random.default_rng(1).multivariate_normal(np.zeros(2), wind, DRAWS)
    energy = 0.5 * np.einsum("na,ab,nb->n", drawn, BEND, drawn)
    mean, variance, third = quadratic_cumulants(triple(BEND), triple(wind))
    assert mean == pytest.approx(energy.mean(), rel=0.02)
    assert variance == pytest.approx(energy.var(), rel=0.02)
    assert third == pytest.approx(np.mean((energy - energy.mean()) ** 3), rel=0.1)
