"""Thresholds of the estimator: those that are derived are what is derived."""

import math

import pytest
from scipy import stats

from homeward.agents.shield import RISK
from homeward.estimation import Prior, rules


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    same_deviations = stats.t(rules.DEGREES).cdf(stats.norm.ppf(RISK))
    assert same_deviations == pytest.approx(1e-3, rel=0.1)
    assert math.exp(rules.LEAST_LOG_WEIGHT) == pytest.approx(1e-6, rel=0.2)
    assert math.sqrt(rules.DOUBT) == 3.0
    prior = Prior()
    assert pytest.approx(5.0 * prior.rolling_sd, rel=0.05) == rules.SURELY_CONSUMES
    assert rules.LEAST_SOC_ERROR > 2.0 / 2.0**24  # single precision


def test_excitation_begins_within_its_period() -> None:
    still, changing = rules.EXCITATION_EVERY
    assert rules.EXCITATION_AT < changing < still
