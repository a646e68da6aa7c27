"""Thresholds of comparing groups: those that are derived are what is derived."""

from homeward.diagnosis.thresholds import SIGNIFICANT
from homeward.groups import thresholds


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    assert thresholds.LEVEL == SIGNIFICANT
    assert thresholds.UPPER_95 == 0.975
    # robots at rest, and drives
    assert 0.04 < 0.5 * thresholds.STEADY < 2.0 * thresholds.STEADY < 0.5
