"""Thresholds of the agents: their order."""

from homeward.agents import thresholds
from homeward.agents.shield import RISK
from homeward.estimation import thresholds as estimation_thresholds


def test_limits_of_one_thing_are_in_order() -> None:
    assert RISK == thresholds.RISK < thresholds.MISSED
    assert estimation_thresholds.MISSED == 10.0 * thresholds.MISSED
    assert thresholds.AT_END < 1.0 < 1.0 / (1.0 - 0.17) < thresholds.HOME_TIME
