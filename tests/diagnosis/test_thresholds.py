"""Thresholds of the diagnosis: the numbers that their origins state, and their order."""

import math

import pytest
from scipy.stats import norm

from homeward.diagnosis import thresholds


def test_numbers_are_what_their_origins_state() -> None:
    assert thresholds.CLEAR == 2.0
    # the error of one of two
    assert 1.0 / math.sqrt(1.0 - thresholds.NEARLY_ALL**2) == pytest.approx(5.0 / 3.0)
    # the mean of a level is known to half of the noise
    assert math.sqrt(thresholds.SHORTEST_LEVEL) == 2.0
    assert 1.0 - math.sqrt(1.0 - thresholds.SMALLEST_GAIN) < 0.03  # of the held-out RMSE
    # Patterns of signs, for many channels.
    assert 2.0 ** -(thresholds.FEWEST_BLOCKS - 1) < thresholds.FALSE_ALARM_RATE / 100.0
    assert 2.0 * norm.sf(thresholds.FAR_APART / 2.0) == pytest.approx(0.046, abs=0.001)
    assert 1.0 - math.sqrt(1.0 - thresholds.SMALLEST_GAIN_TO_NAME) == pytest.approx(0.05, abs=0.002)
    # an angle more acute than the corners of a triangle with equal sides
    assert math.degrees(2.0 * math.acos(thresholds.SHARP)) == pytest.approx(52.0, abs=0.5)
    assert 2.0 * (4.0 * thresholds.CLOSED) ** 2 < thresholds.AS_FAR  # odometry, four times over
    # a standard error a hundred times as large
    assert math.sqrt(thresholds.COLLINEAR) == pytest.approx(0.01)


def test_limits_of_one_thing_are_in_order() -> None:
    assert (
        thresholds.SMALLEST_GAIN
        < thresholds.SMALLEST_GAIN_TO_NAME
        < thresholds.SMALLEST_GAIN_OF_THE_FLEXIBLE
    )
    assert (
        thresholds.HALF < thresholds.NEARLY_ALL < thresholds.RIVAL_SHARE < 1.0 < thresholds.NO_WORSE
    )
    assert thresholds.HALF_AGAIN < 3.6
    assert math.tan(math.radians(30.0)) < thresholds.STEEPEST
    assert 1000.0 / thresholds.UNIT_RATIO > thresholds.TWICE  # a wrong robot is no wrong unit
