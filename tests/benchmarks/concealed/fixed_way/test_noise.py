"""Noise has the size and the smoothness that are asked for."""

import numpy as np
import pytest

from benchmarks.concealed.fixed_way.noise import drift, texture


def test_drift_has_its_deviation_and_correlation_time() -> None:
    series = drift(np.random.default_rng(1), 200_000, dt_s=0.1, correlation_s=5.0, deviation=3.0)
    assert series.std() == pytest.approx(3.0, rel=0.05)
    after_correlation_s = np.corrcoef(series[:-50], series[50:])[0, 1]
    assert after_correlation_s == pytest.approx(np.exp(-1.0), abs=0.05)


def test_texture_has_mean_0_and_deviation_1_and_is_smooth() -> None:
    series = texture(np.random.default_rng(2), 1000, width=16)
    assert series.shape == (1000,)
    assert series.mean() == pytest.approx(0.0, abs=1e-12)
    assert series.std() == pytest.approx(1.0)
    assert np.abs(np.diff(series)).max() < 1.0
