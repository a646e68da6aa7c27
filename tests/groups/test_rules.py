"""Thresholds of comparing groups: those that are derived are what is derived."""

from homeward.diagnosis.rules import COLLINEAR, SIGNIFICANT
from homeward.groups import rules


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    assert rules.LEVEL == SIGNIFICANT
    assert rules.UPPER_95 == 0.975
    assert rules.OWN_SHARE**-0.5 == 10.0  # times the error
    assert COLLINEAR < rules.OWN_SHARE  # one run determines less than all together
    assert 0.04 < 0.5 * rules.STEADY < 2.0 * rules.STEADY < 0.5  # robots at rest, and drives
