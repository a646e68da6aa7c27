"""Thresholds of the companion: those that are derived are what is derived, and limits of one thing
are in order."""

import math

import pytest

from homeward.companion import thresholds
from homeward.companion.companion import WINDOWS
from homeward.estimation import Prior
from homeward.thresholds import POSITION_M


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    assert thresholds.MOST_CUTOFF > 4.2 / 3.6
    assert thresholds.OFF_ROUTE_M == 10.0 * POSITION_M
    assert thresholds.STANDS_WINDOWS / WINDOWS == 0.015
    assert (
        pytest.approx(0.1 * thresholds.DEAD_RECKONING_ERROR)
        == thresholds.STILL_M / thresholds.DRIVEN_M
    )
    assert 1.0 - math.cos(math.radians(32.0)) == pytest.approx(thresholds.STRAIGHT, abs=0.005)
    # air, drag coefficient, area
    assert pytest.approx(2.0 * 0.5 * 1.2 * 1.2 * 0.03, rel=0.1) == thresholds.MOST_AIR


def test_limits_of_one_thing_are_in_order() -> None:
    assert thresholds.RISKS[0] < thresholds.RISK < thresholds.RISKS[1]
    assert thresholds.WINDOWS_S[0] < thresholds.LEAST_HOLD_S < thresholds.WINDOWS_S[1]
    assert thresholds.SOC_SLACK < thresholds.SOC_MISMATCH
    assert Prior().model_error == thresholds.LEAST_MODEL_ERROR
