"""The arithmetic of a hypothesis against closed forms, matrices and least squares."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from homeward.estimation.kalman import (
    add_energy_to_used,
    add_noise_along,
    follow_curve,
    kalman_update,
    propagate,
)
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

NO_JUMP = np.zeros(STATES)
# share of readings that say nothing, spread evenly from 0 to what was read or expected
OUTLIERS = 1e-3


def hypothesis(seed: int) -> tuple[Any, Any]:
    """Mean and covariance."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(STATES, STATES))
    return rng.normal(size=STATES), root @ root.T


def row(of: dict[int, float]) -> Any:
    values = np.zeros(STATES)
    for state, value in of.items():
        values[state] = value
    return values


def test_an_update_in_one_dimension_is_the_closed_form() -> None:
    """Prior N(1, 0.1^2), a reading of twice the state, 2.1, with a noise of 0.05: precisions
    add."""
    x, p = row({ROLLING: 1.0}), np.diag(row({ROLLING: 0.01}))
    variance = 4.0 * 0.01 + 0.05**2
    log_likelihood, nis = kalman_update(
        x, p, 0.1, variance, 2.0 * p[ROLLING], NO_JUMP, 0.0, 0.0, 2.1, 10.0
    )
    precision = 1.0 / 0.01 + 4.0 / 0.05**2
    # One reading in a thousand is an outlier, which moves the mean by that share less.
    assert x[ROLLING] == pytest.approx((1.0 / 0.01 + 2.0 * 2.1 / 0.05**2) / precision, rel=1e-4)
    assert p[ROLLING, ROLLING] == pytest.approx(1.0 / precision, rel=0.01)
    assert nis == pytest.approx(0.1**2 / variance, rel=1e-3)
    assert log_likelihood == pytest.approx(stats.norm.logpdf(0.1, 0.0, variance**0.5), abs=2e-3)
    # Of an outlier the energy counts: the meter read 0.1 more than expected.
    assert x[USED] == pytest.approx(0.1 * OUTLIERS / 2.1 / np.exp(log_likelihood))
    assert not np.delete(x, [ROLLING, USED]).any() and np.count_nonzero(np.diag(p)) == 2


def test_updates_one_by_one_are_least_squares_of_all() -> None:
    """So large a known part of the readings that an outlier, which could lie anywhere in it, is
    improbable."""
    rng = np.random.default_rng(3)
    mean, covariance = hypothesis(4)
    truth = rng.multivariate_normal(mean, covariance)
    measured, noise = rng.normal(size=(30, STATES)), 1e-2
    readings = measured @ truth + noise * rng.normal(size=30)
    x, p = mean.copy(), covariance.copy()
    for h, reading in zip(measured, readings, strict=True):
        shared = p @ h
        kalman_update(
            x, p, reading - h @ x, h @ shared + noise**2, shared, NO_JUMP, 0.0, 0.0, 1e12, 0.0
        )
    information = np.linalg.inv(covariance) + measured.T @ measured / noise**2
    expected = np.linalg.solve(
        information, np.linalg.solve(covariance, mean) + measured.T @ readings / noise**2
    )
    after = np.linalg.inv(information)
    assert np.abs((x - expected) / np.sqrt(np.diag(after))).max() < 1e-3
    np.testing.assert_allclose(p, after, atol=1e-3 * np.diag(after).max())


@pytest.mark.parametrize("innovation", [0.0, -0.4, 3.0, 40.0])
def test_the_three_hypotheses_are_mixed_by_their_probabilities(innovation: float) -> None:
    """Nothing changed, the ground changed, the reading is an outlier: each alone, then the moments
    of the mixture."""
    mean, covariance = hypothesis(5)
    covariance *= 0.01
    h, jump = row({ROLLING: 0.7, WEIGHT: 0.2}), row({ROLLING: 1.0, ROLLED: 0.3})
    noise, change, change_sd, predicted = 0.02, 0.2, 0.35, 2.0
    jump[USED] = h @ jump  # by how much the predicted energy changes
    read = predicted + innovation
    parts = []
    for share, before, density in (
        (1.0 - change, covariance, None),
        (change, covariance + change_sd**2 * np.outer(jump, jump), None),
        (
            1.0,
            covariance + change * change_sd**2 * np.outer(jump, jump),
            OUTLIERS / max(read, predicted),
        ),
    ):
        shared = covariance @ h + (before - covariance)[:, ROLLING] * jump[USED]
        variance = (
            h @ covariance @ h
            + noise**2
            + (before - covariance)[ROLLING, ROLLING] * jump[USED] ** 2
        )
        if density is None:
            density = stats.norm.pdf(innovation, 0.0, variance**0.5)
            gain = shared / variance
            parts.append((share * density, gain * innovation, before - np.outer(gain, shared)))
        else:  # it says nothing of the robot, but its energy was drawn
            parts.append((share * density, innovation * row({USED: 1.0}), before))
    total = sum(weight for weight, _, _ in parts)
    moved = sum(weight * shift for weight, shift, _ in parts) / total
    after = sum(weight * (own + np.outer(shift, shift)) for weight, shift, own in parts) / total
    x, p = mean.copy(), covariance.copy()
    log_likelihood, _ = kalman_update(
        x,
        p,
        innovation,
        h @ covariance @ h + noise**2,
        covariance @ h,
        jump,
        change,
        change_sd,
        read,
        50.0,
    )
    np.testing.assert_allclose(x, mean + moved, rtol=1e-9)
    np.testing.assert_allclose(p, after - np.outer(moved, moved), rtol=1e-9, atol=1e-12)
    assert log_likelihood == pytest.approx(np.log(total))


def test_an_absurd_reading_changes_nothing() -> None:
    mean, covariance = hypothesis(6)
    x, p, h = mean.copy(), covariance.copy(), row({ROLLING: 1.0})
    variance = covariance[ROLLING, ROLLING] + 0.01
    log_likelihood, nis = kalman_update(
        x, p, 1e3, variance, covariance @ h, NO_JUMP, 0.0, 0.0, 1e3, 10.0
    )
    np.testing.assert_allclose(x, mean)
    np.testing.assert_allclose(p, covariance)
    assert log_likelihood == pytest.approx(np.log(OUTLIERS / 1e3)) and nis == pytest.approx(
        0.0, abs=1e-9
    )


def used_after(p: Any, slope: Any) -> tuple[Any, Any]:
    """Covariance, and that with the energy, after the energy is added to the energy used: the
    matrix form."""
    moves = np.eye(STATES)
    moves[USED] += slope
    return moves @ p @ moves.T, moves @ p @ slope


def test_energy_is_added_to_the_energy_used() -> None:
    _, p = hypothesis(7)
    slope = row({GAIN: 0.3, ROLLING: 1.2, EAST: -0.4, ROLLED: 0.8})
    expected, with_energy = used_after(p, slope)
    shared = p @ slope
    add_energy_to_used(p, shared, slope)
    np.testing.assert_allclose(shared, with_energy)
    np.testing.assert_allclose(p, expected)


@pytest.mark.parametrize(("kept", "factor"), [(1.0, 0.4), (0.3, 0.0), (0.0, 1.0), (-0.5, 2.0)])
def test_a_state_becomes_a_sum_of_two(kept: float, factor: float) -> None:
    _, p = hypothesis(9)
    moves = np.eye(STATES)
    moves[ROLLED] = 0.0
    moves[ROLLED, ROLLED], moves[ROLLED, ROLLING] = kept, factor
    expected = moves @ p @ moves.T
    propagate(p, ROLLED, kept, ROLLING, factor)
    np.testing.assert_allclose(p, expected, atol=1e-12)


def test_a_random_change_adds_its_variance_along_its_direction() -> None:
    _, p = hypothesis(10)
    direction = row({ROLLING: 1.0, ROLLED: 0.2, USED: 0.1})
    expected = p + 0.3 * np.outer(direction, direction)
    add_noise_along(p, direction, 0.3)
    np.testing.assert_allclose(p, expected)


def test_one_wind_follows_the_parabola() -> None:
    """Rolling plus b/2 w^2 is as read: w moves by 1.5 from the point of the tangent, rolling falls
    by b/2 1.5^2 and its slope there is -b w."""
    x, p = row({ROLLING: 2.0}), np.diag(row({EAST: 0.4}))
    follow_curve(
        x, p, ROLLING, np.array([[0.6, 0.0, 0.0], [0.0, 0.0, 0.0]]), 1.0, (1.5, 0.0), (0.0, 0.0)
    )
    assert x[ROLLING] == pytest.approx(2.0 - 0.5 * 0.6 * 1.5**2)
    assert p[ROLLING, EAST] == pytest.approx(-0.6 * 1.5 * 0.4)
    assert p[ROLLING, ROLLING] == pytest.approx((0.6 * 1.5) ** 2 * 0.4)


def test_mean_wind_and_gusts_follow_the_curve_together() -> None:
    """The gusts act with the mean wind on the ground of the second row, which counts for both."""
    x, p = hypothesis(11)
    bend, factor = np.array([[0.6, 0.2, 0.5], [0.3, 0.1, 0.2]]), 0.7
    mean, gust = np.array([1.5, -0.4]), np.array([0.3, 0.8])
    whole, among = (np.array([[one[0], one[1]], [one[1], one[2]]]) for one in bend)
    curve = factor * np.block([[whole, among], [among, among]])
    by = curve @ np.concatenate((mean, gust))
    moves = np.eye(STATES)
    moves[ROLLED, [EAST, NORTH, GUST_EAST, GUST_NORTH]] = -by
    expected = moves @ p @ moves.T
    lower = x[ROLLED] - 0.5 * by @ np.concatenate((mean, gust))
    others = np.delete(x, ROLLED)
    follow_curve(x, p, ROLLED, bend, factor, tuple(mean), tuple(gust))
    assert x[ROLLED] == pytest.approx(lower)
    np.testing.assert_array_equal(np.delete(x, ROLLED), others)
    np.testing.assert_allclose(p, expected, atol=1e-12)
    assert p[PER_CAPACITY, PER_CAPACITY] > 0.0
