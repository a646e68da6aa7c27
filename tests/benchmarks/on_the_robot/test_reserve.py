"""What is left at home is the sum of its parts, and no doubt taken away adds to the reserve."""

from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks.on_the_robot.reserve import ALL, BATTERY, left_over, reserves
from homeward.companion import Companion


def test_what_is_left_is_the_sum_of_its_parts() -> None:
    point = SimpleNamespace(
        left=SimpleNamespace(mean_j=50.0),
        home=SimpleNamespace(mean_j=30.0),
        true_left_j=55.0,
        true_home_j=33.0,
    )
    drive: Any = SimpleNamespace(points=[point], label=SimpleNamespace(energy_j=100.0))
    assert left_over(drive) == pytest.approx((0.22, 0.20, 0.05, -0.03))


def test_a_doubt_that_is_taken_away_needs_no_more_reserve() -> None:
    companion = Companion("husky", home=(0.0, 0.0), soc=1.0)
    for step in range(40):
        companion.update(
            20.0 * step,
            speed_mps=1.0,
            power_w=150.0,
            heading_rad=0.0,
            grade_rad=0.0,
            position=(20.0 * step, 0.0),
        )
    before = companion.state()
    needs = reserves(companion)
    assert companion.state() == before
    assert all(0.0 < need < 1.01 * needs[ALL] for need in needs.values())
    assert needs[BATTERY] < 0.8 * needs[ALL]
