"""Thresholds of watching: their order."""

from homeward.companion import rules as companion_rules
from homeward.watch import rules
from homeward.watch.online.node import PERIOD_S


def test_limits_of_one_thing_are_in_order() -> None:
    least, most = rules.CALIBRATED
    assert least < 0.9 < most < 1.0
    assert rules.SOC_STEP < rules.CHARGED
    assert rules.BEHIND_S < rules.JUMP_S
    assert rules.SAME_FRAME_M < companion_rules.OFF_ROUTE_M
    assert rules.SHORTEST_INTERVAL_S >= PERIOD_S  # messages of one period come at once
