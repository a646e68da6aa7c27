"""Thresholds of the diagnosis: those that are derived are what is derived, and their order."""

import math

import pytest
from scipy.stats import norm

from homeward.diagnosis import rules


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    assert pytest.approx(rules.SIGNIFICANT) == 1.0 / (rules.PLACEBOS + 1)
    assert pytest.approx(norm.ppf(0.975), abs=0.005) == rules.NORMAL_95
    assert round(rules.NORMAL_95) == rules.CLEAR
    assert pytest.approx(math.log(2.0)) == rules.SEPARATING_GAIN
    assert 2.0 < 1.0 / math.sqrt(1.0 - rules.CONFOUNDED**2) < 2.5  # more than twice the standard error
    assert math.sqrt(rules.SHORTEST_LEVEL) == 2.0  # the mean of a level is known to half of the noise
    assert 1.0 - math.sqrt(1.0 - rules.SMALLEST_GAIN) < 0.03  # of the held-out RMSE
    assert 2.0 ** -(rules.ODOMETER_PARTS - 1) < rules.FALSE_ALARM_RATE
    assert 2.0 ** -(rules.FEWEST_BLOCKS - 1) < rules.FALSE_ALARM_RATE / 100.0  # patterns of signs, for many channels
    assert 2.0 * norm.sf(rules.CLEARLY_APART / 2.0) == pytest.approx(0.046, abs=0.001)
    assert math.sqrt(rules.COLLINEAR) == pytest.approx(0.01)  # a standard error a hundred times as large


def test_limits_of_one_thing_are_in_order() -> None:
    assert rules.SMALLEST_GAIN < rules.SMALLEST_GAIN_TO_NAME < rules.SMALLEST_GAIN_OF_A_FAULT
    assert rules.AS_FAST_IN_KMH < rules.TOO_FAST < 3.6
    assert rules.INFORMATION_GAIN < rules.SEPARATING_GAIN
    assert rules.CONFUSABLE_SHARE < rules.RIVAL_SHARE < 1.0
    assert math.tan(math.radians(30.0)) < rules.STEEPEST
    assert 1000.0 / rules.UNIT_RATIO > rules.RIGHT_ROBOT  # a wrong robot is no wrong unit
    assert rules.SPIKE_BEYOND > 1.0 < rules.BEYOND_NOISE
