"""Records: their size in the caches, what the kernel finds in them, and inverses that are
inverse."""

from __future__ import annotations

import itertools

import pytest

from homeward.envs.missions import MISSIONS
from homeward.envs.options import Options, known_of
from homeward.envs.state import (
    AHEAD,
    HIDDEN_DTYPE,
    INVERSES,
    MAX_PLACES,
    MISSION_DTYPE,
    PLACE_DTYPE,
    ROUTE_DTYPE,
    SHARED_DTYPE,
)
from homeward.physics.kernel import ROBOT_STATE_DTYPE

LINE_BYTES = 64  # of the processor's caches
PAGE_BYTES = 4096


def test_a_place_fills_two_lines_and_the_way_ahead_ends_the_second() -> None:
    fields = PLACE_DTYPE.fields
    assert fields is not None
    assert PLACE_DTYPE.itemsize == 2 * LINE_BYTES
    last_dtype, last_offset = fields["interest_ahead"][:2]
    assert last_offset + last_dtype.itemsize == PLACE_DTYPE.itemsize


def test_routes_of_neighbours_do_not_lie_pages_apart() -> None:
    assert LINE_BYTES <= ROUTE_DTYPE.itemsize % PAGE_BYTES <= PAGE_BYTES - LINE_BYTES


def test_a_mission_has_every_field_of_the_kernels_state_as_it_is() -> None:
    fields = MISSION_DTYPE.fields
    assert fields is not None
    for name in ROBOT_STATE_DTYPE.names or ():
        assert fields[name][0] == ROBOT_STATE_DTYPE[name], name


def test_what_every_step_touches_comes_before_the_arrays() -> None:
    fields = MISSION_DTYPE.fields
    assert fields is not None
    arrays = {name for name in ROBOT_STATE_DTYPE.names or () if ROBOT_STATE_DTYPE[name].shape}
    assert max(fields[name][1] for name in fields.keys() - arrays) < min(
        fields[name][1] for name in arrays
    )


def test_stretches_ahead_touch_and_each_is_as_long_as_all_before_it() -> None:
    lengths = [last - first for first, last in AHEAD]
    assert AHEAD[0][0] == 1
    assert all(before[1] == after[0] for before, after in itertools.pairwise(AHEAD))
    assert lengths[1:] == list(itertools.accumulate(lengths))[:-1]


def test_the_longest_route_lies_within_the_stretches() -> None:
    assert AHEAD[-1][1] > MAX_PLACES - 1  # the farthest place from the first one


@pytest.mark.parametrize("mission", MISSIONS)
def test_inverses_are_those_of_what_they_name(mission: str) -> None:
    s = known_of(Options(mission, difficulty="harsh")).shared[0]
    for inverse, name in INVERSES.items():
        assert name.startswith(inverse.removeprefix("per_"))
        assert (
            s[inverse] * s[name] == pytest.approx(1.0, rel=1e-15) or s[name] == s[inverse] == 0.0
        ), name


def test_nothing_is_shared_and_hidden_at_once() -> None:
    assert set(SHARED_DTYPE.names or ()).isdisjoint(HIDDEN_DTYPE.names or ())
