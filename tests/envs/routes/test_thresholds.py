"""Thresholds of routes and tracks: those that are derived are what is derived, and their order."""

import math

import pytest
from scipy.stats import norm

from homeward import thresholds as shared
from homeward.envs.conditions.instruments import STEEPEST_READ
from homeward.envs.routes import thresholds
from homeward.envs.routes.tracks import GRID_M, SIGMA_M


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    assert thresholds.SHORTEST_M == 4.0 * SIGMA_M
    assert thresholds.SPACING_M == GRID_M == shared.POSITION_M
    assert math.degrees(math.asin(thresholds.STEEPEST_OF_TRACK)) == pytest.approx(30.0)
    assert 300.0 < 0.5 / norm.sf(thresholds.NOISE_DEVIATIONS) < 500.0


def test_limits_of_one_thing_are_in_order() -> None:
    assert (
        thresholds.STEEPEST_OF_TRACK
        < thresholds.STEEPEST_SINE
        < math.sin(shared.STEEPEST_RAD)
        < STEEPEST_READ
    )
    assert thresholds.CAPPED_SHARE < thresholds.MISSING_SHARE
    assert thresholds.SPACING_M < thresholds.SHORTEST_M < thresholds.JUMP_M
