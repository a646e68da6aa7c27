"""Noise of a channel, from the channel alone, and the channel without it."""

import numpy as np
import pytest

from homeward.diagnosis.read.noise import smoothed, white_noise
from homeward.logs.channels import Array

WAVE: Array = np.sin(np.arange(2000) / 40.0)
"""A smooth signal."""


def noise(size: float, seed: int = 0, count: int = len(WAVE)) -> Array:
    return size * np.random.default_rng(seed).standard_normal(count)


@pytest.mark.parametrize("size", [0.02, 0.5])
def test_the_noise_of_a_smooth_signal_is_known(size: float) -> None:
    assert white_noise(WAVE + noise(size)) == pytest.approx(size, rel=0.05)


def test_a_line_has_no_noise_and_a_scale_is_kept() -> None:
    assert white_noise(np.arange(1.0, 100.0)) == 0.0
    assert white_noise(np.zeros(3)) == 0.0
    values = WAVE + noise(0.1)
    assert white_noise(-7.0 * values) == pytest.approx(7.0 * white_noise(values), rel=1e-12)


def test_rest_that_a_sensor_shows_without_noise_does_not_count() -> None:
    """Two thirds of the samples are exactly zero: the median of all would be."""
    moves = np.arange(len(WAVE)) % 300 < 100
    assert white_noise(np.where(moves, 2.0 + WAVE + noise(0.1), 0.0)) == pytest.approx(0.1, rel=0.1)


def test_the_error_of_what_is_smoothed_is_known() -> None:
    """Of signals whose second differences are normal, as the model has them: the posterior's spread
    is the error's."""
    errors, spreads = [], []
    for seed in range(5):
        signal = np.cumsum(np.cumsum(noise(1e-3, seed + 100)))
        found = smoothed(signal + noise(0.2, seed), order=2)
        assert found.noise == pytest.approx(0.2, rel=0.05)
        errors.append(float(np.std(found.values - signal)))
        spreads.append(float(found.draws.std()))
    assert max(errors) < 0.1
    assert np.mean(spreads) == pytest.approx(np.mean(errors), rel=0.07)


@pytest.mark.parametrize("order", [1, 2])
def test_what_the_model_holds_for_smooth_is_kept(order: int) -> None:
    """A constant has no first differences, a line no second ones: neither is bent, whatever its
    noise."""
    line = 3.0 + (0.01 * np.arange(500.0) if order == 2 else np.zeros(500))
    found = smoothed(line + noise(0.1, count=500), order)
    np.testing.assert_allclose(found.values, line, atol=0.04)
    assert np.abs(np.diff(found.values, order)).max() < 1e-3


def test_a_sample_without_weight_may_hold_any_number() -> None:
    values, weight = WAVE + noise(0.1), np.ones(len(WAVE))
    weight[500:520] = 0.0
    found = smoothed(values, 2, weight)
    values[500:520] = 1e6
    np.testing.assert_allclose(smoothed(values, 2, weight).values, found.values, atol=1e-9)
    np.testing.assert_allclose(found.values[500:520], WAVE[500:520], atol=0.1)


def test_a_kink_at_a_known_place_stays_sharp() -> None:
    kinked = np.abs(np.arange(-500.0, 500.0)) / 100.0
    breaks = np.ones(998)
    breaks[498:500] = 0.0
    values = kinked + noise(0.3, count=1000)
    near = slice(490, 511)
    blunt, sharp = (
        float(np.abs(smoothed(values, 2, breaks=one).values - kinked)[near].max())
        for one in (None, breaks)
    )
    assert sharp < 0.1 < blunt


@pytest.mark.parametrize("jumps", [False, True])
@pytest.mark.parametrize("height", [0.0, 1000.0])
def test_the_noise_of_a_line_is_known_however_stiff_it_is(jumps: bool, height: float) -> None:
    """Its differences have hardly any variance: the ratio to that of the noise is near what numbers
    can hold."""
    line = height + 0.1 * np.arange(200.0)
    found = smoothed(line + noise(0.01, count=200), 2, jumps=jumps)
    assert found.noise == pytest.approx(0.01, rel=0.15)
    np.testing.assert_allclose(found.values, line, atol=0.005)


def test_a_noise_that_is_known_is_taken() -> None:
    """Said to be larger than it is, the channel is smoothed more."""
    values = WAVE + noise(0.1)
    rough, smooth = (smoothed(values, 2, noise=size) for size in (0.1, 1.0))
    assert (rough.noise, smooth.noise) == pytest.approx((0.1, 1.0))
    assert np.sum(np.diff(smooth.values, 2) ** 2) < 0.9 * np.sum(np.diff(rough.values, 2) ** 2)


@pytest.mark.parametrize("size", [0.05, 0.2])
def test_noise_is_told_from_jumps(size: float) -> None:
    rng = np.random.default_rng(100)
    steps = np.repeat(rng.choice([0.0, 0.5, 1.0], 40), 50)
    found = smoothed(steps + size * rng.normal(size=2000), 1, jumps=True)
    assert found.noise == pytest.approx(size, rel=0.1)
    assert float(np.std(found.values - steps)) < 0.5 * size
