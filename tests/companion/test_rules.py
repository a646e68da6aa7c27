"""Thresholds of the companion: those that are derived are what is derived, and limits of one thing are in order."""

import math

import pytest

from homeward.companion import rules
from homeward.companion.companion import WINDOWS
from homeward.estimation import Prior
from homeward.rules import POSITION_M


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    assert rules.MOST_CUTOFF > 4.2 / 3.6
    assert rules.OFF_ROUTE_M == 10.0 * POSITION_M
    assert rules.STANDS_WINDOWS / WINDOWS == 0.015
    assert pytest.approx(0.1 * rules.DEAD_RECKONING_ERROR) == rules.STILL_M / rules.DRIVEN_M
    assert 1.0 - math.cos(math.radians(32.0)) == pytest.approx(rules.STRAIGHT, abs=0.005)
    assert pytest.approx(2.0 * 0.5 * 1.2 * 1.2 * 0.03, rel=0.1) == rules.MOST_AIR  # air, drag coefficient, area


def test_limits_of_one_thing_are_in_order() -> None:
    assert rules.RISKS[0] < rules.RISK < rules.RISKS[1]
    assert rules.WINDOWS_S[0] < rules.LEAST_HOLD_S < rules.WINDOWS_S[1]
    assert rules.SOC_SLACK < rules.SOC_MISMATCH
    assert Prior().model_error == rules.LEAST_MODEL_ERROR
