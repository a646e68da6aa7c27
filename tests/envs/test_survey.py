"""Survey: information counts, sent or on board, and what is ahead is limited by memory and
radio."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from homeward.envs.sensing import DRIVING_LINK
from homeward.envs.survey import attainable, score


def test_information_counts_sent_or_on_board() -> None:
    assert score(SimpleNamespace(delivered=3.0, backlog_information=4.0), None) == 7.0


@pytest.mark.parametrize(
    ("backlog", "samples"), [(0.0, 20.0), (95.0, 5.0 + DRIVING_LINK * 2.0 * 10.0)]
)
def test_what_is_attainable_is_limited_by_the_fastest_rate_or_by_the_memory(
    backlog: float, samples: float
) -> None:
    """Ten seconds of way on even ground, beside the base: 2 samples a second, room for 100, and a
    radio of 2 Hz."""
    place = SimpleNamespace(interest=1.5, interest_to_here=0.0)
    shared = SimpleNamespace(
        per_out_and_home_j_per_m=1.0, length_m=100.0, radio_hz=2.0, per_link_m=0.0, backlog_limit=100.0,
        cruise_mps=1.0, max_sensing_hz=2.0, per_place_m=0.01, places=1, saturation_per_m=2.0,
    )  # fmt: skip
    start = SimpleNamespace(position_m=0.0, backlog=backlog, here=place)
    by_hand = 1.5 * 10.0 * samples / (samples + 2.0 * 10.0)
    assert attainable(start, SimpleNamespace(places=[place]), shared, 10.0) == pytest.approx(
        by_hand
    )
