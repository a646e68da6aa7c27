"""Thresholds of comparing groups: those that are derived are what is derived."""

from homeward.diagnosis.rules import SIGNIFICANT
from homeward.groups import rules


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    assert rules.LEVEL == SIGNIFICANT
    assert rules.UPPER_95 == 0.975
    assert 0.04 < 0.5 * rules.STEADY < 2.0 * rules.STEADY < 0.5  # robots at rest, and drives
