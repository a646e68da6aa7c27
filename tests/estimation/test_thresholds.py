"""Thresholds of the estimator: those that are derived are what is derived."""

import math

import pytest
from scipy import stats

from homeward.agents.shield import RISK
from homeward.estimation import Prior, thresholds


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    same_deviations = stats.t(thresholds.DEGREES).cdf(stats.norm.ppf(RISK))
    assert same_deviations == pytest.approx(1e-3, rel=0.1)
    assert math.exp(thresholds.LEAST_LOG_WEIGHT) == pytest.approx(1e-6, rel=0.2)
    assert math.sqrt(thresholds.DOUBT) == 3.0
    prior = Prior()
    assert pytest.approx(5.0 * prior.rolling_sd, rel=0.05) == thresholds.SURELY_CONSUMES
    assert thresholds.LEAST_SOC_ERROR > 2.0 / 2.0**24  # single precision


def test_excitation_begins_within_its_period() -> None:
    still, changing = thresholds.EXCITATION_EVERY
    assert thresholds.EXCITATION_AT < changing < still
