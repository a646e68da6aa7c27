"""Thresholds of watching: their order."""

from homeward.companion import thresholds as companion_thresholds
from homeward.watch import thresholds
from homeward.watch.online.node import PERIOD_S


def test_limits_of_one_thing_are_in_order() -> None:
    least, most = thresholds.CALIBRATED
    assert least < 0.9 < most < 1.0
    assert thresholds.SOC_STEP < thresholds.CHARGED
    assert thresholds.BEHIND_S < thresholds.JUMP_S
    assert thresholds.SAME_FRAME_M < companion_thresholds.OFF_ROUTE_M
    assert thresholds.SHORTEST_INTERVAL_S >= PERIOD_S  # messages of one period come at once
