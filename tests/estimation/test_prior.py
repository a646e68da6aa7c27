"""What the filter believes at the start: Bayes' rule for the forecast, and moments of the drawn
robots."""

import numpy as np
import pytest

from homeward.estimation.prior import (
    EAST,
    GAIN,
    GUST_EAST,
    GUST_NORTH,
    HYPOTHESES,
    NORTH,
    OFFSET,
    PER_CAPACITY,
    ROLLING,
    STATES,
    WEIGHT,
    Prior,
    first_hypotheses,
)

FULL_J = 5e4
FORECASTS = 7  # hypotheses around the forecast come first


def first(
    prior: Prior, east_mps: float = 0.0, north_mps: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    mean, covariance, probability = first_hypotheses(
        prior, FULL_J, np.array([[east_mps, north_mps]])
    )
    assert mean.shape == (1, HYPOTHESES, STATES) and covariance.shape == (
        1,
        HYPOTHESES,
        STATES,
        STATES,
    )
    return mean[0], covariance[0], probability[0]


@pytest.mark.parametrize("forecast_mps", [(0.0, 0.0), (3.0, -2.0)])
def test_together_the_hypotheses_of_a_forecast_are_the_posterior_of_wind_and_gust(
    forecast_mps: tuple[float, float],
) -> None:
    """The forecast is mean wind + gust + error: the posterior of both, given it, is a regression on
    it."""
    prior = Prior(wind_sd_mps=1.5, forecast_sd_mps=1.2, gust_share=0.4, missed=0.1)
    mean, covariance, probability = first(prior, *forecast_mps)
    before = np.diag([1.5**2, 2.0 * (0.4 * 1.5) ** 2])
    gain = before.sum(axis=1) / (before.sum() + 1.2**2)
    weight = probability[:FORECASTS] / probability[:FORECASTS].sum()
    for states, given_mps in (
        ((EAST, GUST_EAST), forecast_mps[0]),
        ((NORTH, GUST_NORTH), forecast_mps[1]),
    ):
        of = np.ix_(range(FORECASTS), states)
        average = weight @ mean[of]
        apart = mean[of] - average
        spread = np.einsum(
            "k,kab->ab", weight, covariance[np.ix_(range(FORECASTS), states, states)]
        )
        spread += np.einsum("k,ka,kb->ab", weight, apart, apart)
        np.testing.assert_allclose(average, gain * given_mps, atol=1e-12)
        np.testing.assert_allclose(spread, before - np.outer(gain, before.sum(axis=1)), atol=1e-12)


def test_winds_that_the_forecast_lacks_come_from_all_directions_with_its_probability() -> None:
    mean, covariance, probability = first(
        Prior(missed=0.2, missed_mps=5.0, missed_sd_mps=1.1), 9.0, 9.0
    )
    ring = mean[FORECASTS:, [EAST, NORTH]]
    np.testing.assert_allclose(np.hypot(*ring.T), 5.0)
    np.testing.assert_allclose(ring.sum(axis=0), 0.0, atol=1e-12)
    assert len({tuple(wind) for wind in ring.round(6)}) == HYPOTHESES - FORECASTS
    assert np.all(covariance[FORECASTS:, EAST, EAST] == pytest.approx(1.1**2))
    assert probability.sum() == pytest.approx(1.0) and probability[
        FORECASTS:
    ].sum() == pytest.approx(0.2)


def test_without_wind_nothing_is_divided_by_zero() -> None:
    mean, covariance, _ = first(Prior(wind_sd_mps=0.0, forecast_sd_mps=0.0))
    states = [EAST, NORTH, GUST_EAST, GUST_NORTH]
    assert not mean[:FORECASTS, states].any()
    assert not covariance[:FORECASTS][:, states].any()


def test_robots_have_the_moments_of_drawn_ones() -> None:
    """To first order; the inverse of a capacity of U(0.8, 1) has E[1/c] = 5 ln 1.25 and E[1/c^2] =
    1.25."""
    prior = Prior(gain_sd=0.02, rolling_sd=0.03, mass_sd=0.04)
    mean, covariance, _ = first(prior)
    rng = np.random.default_rng(0)
    drawn = rng.normal([1.0, prior.rolling, prior.mass], [0.02, 0.03, 0.04], (400_000, 3))
    gain, rolling, mass = drawn.T
    states = np.stack((gain, gain * rolling * mass, gain * mass))
    np.testing.assert_allclose(mean[0, [GAIN, ROLLING, WEIGHT]], states.mean(axis=1), rtol=5e-3)
    np.testing.assert_allclose(covariance[0, :3, :3], np.cov(states), rtol=0.03)
    exact = Prior()
    mean, covariance, _ = first(exact)
    assert mean[0, PER_CAPACITY] == pytest.approx(5.0 * np.log(1.25), rel=1e-3)
    spread = np.sqrt(1.25 - (5.0 * np.log(1.25)) ** 2)
    assert np.sqrt(covariance[0, PER_CAPACITY, PER_CAPACITY]) == pytest.approx(spread, rel=0.02)


@pytest.mark.parametrize(
    "prior", [Prior(), Prior(gain_sd=0.02, offset_sd_w=0.3, wind_sd_mps=2.0, gust_share=1.0)]
)
def test_every_covariance_is_one(prior: Prior) -> None:
    _, covariance, _ = first(prior, 2.0, 1.0)
    np.testing.assert_array_equal(covariance, covariance.swapaxes(-1, -2))
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    assert covariance[0, OFFSET, OFFSET] == pytest.approx((prior.offset_sd_w / FULL_J) ** 2)


def test_a_state_of_charge_errs_by_noise_and_rounding() -> None:
    """Rounding to steps of 1 % is uniform within a step: its standard deviation is a step over the
    root of 12."""
    rounding = np.std(np.random.default_rng(1).uniform(-0.005, 0.005, 200_000))
    assert Prior(soc_step=0.01).soc_sd == pytest.approx(rounding, rel=0.01)
    assert Prior(soc_noise=0.004, soc_step=0.003 * 12**0.5).soc_sd == pytest.approx(0.005)
    assert Prior().soc_sd == 0.0
