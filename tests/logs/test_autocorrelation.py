"""Autocorrelation times are those of known processes, within runs only, and steps are no noise."""

import math

import numpy as np
import pytest

from homeward.logs import thresholds
from homeward.logs.autocorrelation import correlation_windows, independent_windows, noise_of
from homeward.logs.channels import Index
from tests.diagnosis.made_up import autoregressive

ONE_RUN: Index = np.zeros(20_000, dtype=np.intp)


def test_its_thresholds_are_what_they_are_derived_from() -> None:
    assert 1.0 / math.sqrt(thresholds.LONGEST_LAG) == pytest.approx(thresholds.UNCORRELATED)
    assert pytest.approx(19.0) == (1.0 + thresholds.MOST_CORRELATED) / (
        1.0 - thresholds.MOST_CORRELATED
    )


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.8])
def test_the_autocorrelation_time_is_that_of_the_process(phi: float) -> None:
    """(1 + phi) / (1 - phi) of an autoregressive process."""
    residual, expected = autoregressive(phi, len(ONE_RUN)), (1.0 + phi) / (1.0 - phi)
    assert correlation_windows(residual, ONE_RUN) == pytest.approx(expected, rel=0.1)
    assert independent_windows(residual, ONE_RUN) == pytest.approx(20_000 / expected, rel=0.1)
    found = noise_of(residual, ONE_RUN, lags=(1, 2))
    assert found.correlation == pytest.approx(expected, rel=0.2, abs=0.5)
    assert found.long_run == pytest.approx(1.0 / (1.0 - phi), rel=0.25)


def test_noise_is_not_taken_from_a_few_changes_of_level() -> None:
    steps = 30.0 * (np.arange(20_000) // 2000 % 2)
    found = noise_of(autoregressive(0.5, len(ONE_RUN)) + steps, ONE_RUN, lags=(1, 2))
    assert found.long_run == pytest.approx(2.0, rel=0.25)


def test_what_lies_in_two_runs_does_not_correlate() -> None:
    """Each run of two windows begins where the one before ended."""
    residual = np.repeat(np.random.default_rng(0).standard_normal(2000), 2)[1:-1]
    assert correlation_windows(residual, np.repeat(np.arange(len(residual) // 2), 2)) == 1.0
    assert correlation_windows(residual, ONE_RUN[: len(residual)]) > 1.8


def test_a_residual_of_nothing_has_two_windows_at_least() -> None:
    assert correlation_windows(np.zeros(100), ONE_RUN[:100]) == 1.0
    assert independent_windows(np.arange(40.0), ONE_RUN[:40]) >= 2.0
