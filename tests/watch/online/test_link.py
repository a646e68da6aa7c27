"""What is told of an advice, whatever carries it."""

import dataclasses

import pytest

from homeward.companion import Advice, Companion
from homeward.watch.online.link import can_reach_home, reserve

FULL_J = 1.7e6


@pytest.fixture(scope="module")
def advice() -> Advice:
    """Of a robot with a full battery, 100 m from home."""
    companion = Companion("husky")
    companion.update(0.0, position=100.0)
    return companion.update(1.0, position=100.0)


@pytest.mark.parametrize(
    ("chance", "reached"), [(1.0, True), (0.98, True), (0.9799, False), (0.0, False)]
)
def test_home_is_reached_at_the_accepted_risk(advice: Advice, chance: float, reached: bool) -> None:
    assert can_reach_home(dataclasses.replace(advice, chance_home=chance, risk=0.02)) == reached


def test_the_reserve_is_the_share_that_the_way_home_leaves_at_the_risk(advice: Advice) -> None:
    margin = advice.margin_j
    for risk in (0.001, 0.05):
        given = dataclasses.replace(advice, risk=risk, turn_now=False)
        expected = margin.quantile(risk) / FULL_J
        assert 0.0 < expected < 1.0 and reserve(given, FULL_J) == pytest.approx(expected)
    assert reserve(dataclasses.replace(advice, turn_now=True), FULL_J) == 0.0
    assert reserve(dataclasses.replace(advice, margin_j=margin._replace(mean=-1.0)), FULL_J) == 0.0
    assert reserve(dataclasses.replace(advice, margin_j=margin._replace(mean=9e9)), FULL_J) == 1.0
