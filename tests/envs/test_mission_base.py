"""What missions share: the metres that the energy beyond the way home allows."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from homeward.envs.mission_base import room_m


@pytest.mark.parametrize(("margin_j", "way_m"), [(-5.0, 0.0), (50.0, 25.0), (500.0, 60.0)])
def test_the_way_ahead_ends_with_the_energy_or_with_the_route(
    margin_j: float, way_m: float
) -> None:
    shared = SimpleNamespace(per_out_and_home_j_per_m=0.5, length_m=100.0)
    assert room_m(SimpleNamespace(position_m=40.0), shared, margin_j) == way_m
