"""Bounded least squares on a Gram matrix: the weights are those of SciPy on the rows."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from homeward.diagnosis.fit.bounded import bounded


@given(
    seed=st.integers(0, 10_000), columns=st.integers(1, 6), wide=st.sampled_from([0.01, 0.3, 10.0])
)
def test_the_best_weights_within_bounds_are_those_of_least_squares(
    seed: int, columns: int, wide: float
) -> None:
    """Whatever the units of the columns."""
    rng = np.random.default_rng(seed)
    matrix, target = rng.standard_normal((40, columns)), rng.standard_normal(40)
    low, high = -wide * rng.uniform(size=columns), wide * rng.uniform(size=columns)
    unit = 10.0 ** rng.uniform(-3.0, 3.0, columns)
    scaled = matrix * unit
    found = bounded(scaled.T @ scaled, scaled.T @ target, low / unit, high / unit) * unit
    assert (found >= low - 1e-9).all() and (found <= high + 1e-9).all()
    best = lsq_linear(matrix, target, (low, high), method="bvls").x
    assert np.sum((matrix @ found - target) ** 2) <= np.sum((matrix @ best - target) ** 2) + 1e-6


def test_without_columns_there_are_no_weights() -> None:
    assert bounded(np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(0)).shape == (0,)


def test_columns_that_are_the_same_share_their_weight_and_one_of_zeros_has_none() -> None:
    column = np.arange(10.0)
    matrix = np.column_stack([column, column, 0.0 * column])
    free = np.full(3, np.inf)
    found = bounded(matrix.T @ matrix, matrix.T @ (6.0 * column), -free, free)
    np.testing.assert_allclose(found, [3.0, 3.0, 0.0], rtol=1e-6)
