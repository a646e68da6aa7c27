"""Thresholds of the diagnosis: those that are derived are what is derived, and their order."""

import math

import pytest
from scipy.stats import norm

from homeward.diagnosis import thresholds


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    assert pytest.approx(norm.ppf(0.975), abs=0.005) == thresholds.NORMAL_95
    assert round(thresholds.NORMAL_95) == thresholds.CLEAR
    assert 2.0 < 1.0 / math.sqrt(1.0 - thresholds.CONFOUNDED**2) < 2.5  # more than twice the standard error
    assert math.sqrt(thresholds.SHORTEST_LEVEL) == 2.0  # the mean of a level is known to half of the noise
    assert 1.0 - math.sqrt(1.0 - thresholds.SMALLEST_GAIN) < 0.03  # of the held-out RMSE
    assert 2.0 ** -(thresholds.ODOMETER_PARTS - 1) < thresholds.FALSE_ALARM_RATE
    assert (
        2.0 ** -(thresholds.FEWEST_BLOCKS - 1) < thresholds.FALSE_ALARM_RATE / 100.0
    )  # patterns of signs, for many channels
    assert 2.0 * norm.sf(thresholds.CLEARLY_APART / 2.0) == pytest.approx(0.046, abs=0.001)
    assert math.sqrt(thresholds.COLLINEAR) == pytest.approx(0.01)  # a standard error a hundred times as large


def test_limits_of_one_thing_are_in_order() -> None:
    assert thresholds.SMALLEST_GAIN < thresholds.SMALLEST_GAIN_TO_NAME < thresholds.SMALLEST_GAIN_OF_A_FAULT
    assert thresholds.AS_FAST_IN_KMH < thresholds.TOO_FAST < 3.6
    assert (
        thresholds.HALF
        < thresholds.NEARLY_ALL
        < thresholds.RIVAL_SHARE
        < 1.0
        < thresholds.SPIKE_BEYOND
        < thresholds.TWICE
    )
    assert math.tan(math.radians(30.0)) < thresholds.STEEPEST
    assert 1000.0 / thresholds.UNIT_RATIO > thresholds.TWICE  # a wrong robot is no wrong unit
