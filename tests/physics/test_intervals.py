"""Intervals of allowed values, and arguments checked against them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward.physics.intervals import FINITE, NOT_NEGATIVE, Bounds, checked


def test_bounds_hold_arrays() -> None:
    bounds = Bounds(0.0, 1.0, open_low=True)
    assert str(bounds) == "(0, 1]"
    assert bounds.hold(np.array([-1.0, 0.0, 0.5, 1.0, 2.0, np.nan])).tolist() == [
        False,
        False,
        True,
        True,
        False,
        False,
    ]


@given(st.floats(-2.0, 2.0), st.booleans(), st.booleans())
def test_what_holds_is_between_the_ends(value: float, open_low: bool, open_high: bool) -> None:
    bounds = Bounds(-1.0, 1.0, open_low, open_high)
    inside = (
        -1.0 < value < 1.0 or (value == -1.0 and not open_low) or (value == 1.0 and not open_high)
    )
    assert bool(bounds.hold(value)) == inside


@pytest.mark.parametrize(
    ("bounds", "text"),
    [(FINITE, "(-inf, inf)"), (NOT_NEGATIVE, "[0, inf)"), (Bounds(0.0, 0.5), "[0, 0.5]")],
)
def test_an_interval_is_written_as_in_mathematics(bounds: Bounds, text: str) -> None:
    assert str(bounds) == text


def test_finite_numbers_and_those_not_negative() -> None:
    values = np.array([-np.inf, -1.0, -0.0, 0.0, 1e300, np.inf, np.nan])
    assert FINITE.hold(values).tolist() == [False, True, True, True, True, False, False]
    assert NOT_NEGATIVE.hold(values).tolist() == [False, False, True, True, True, False, False]


@pytest.mark.parametrize(
    ("value", "shape"), [(2, ()), ("0.5", ()), ([1, 2], (2,)), (np.zeros((2, 3), np.int8), (2, 3))]
)
def test_arguments_become_float64_of_their_shape(value: object, shape: tuple[int, ...]) -> None:
    given = checked("speed_mps", value, NOT_NEGATIVE)
    assert given.dtype == np.float64 and given.shape == shape
    np.testing.assert_array_equal(given, np.asarray(value, dtype=np.float64))


@pytest.mark.parametrize(
    ("value", "said"),
    [
        # the first of them
        ([1.0, -2.0, -3.0], "speed_mps = -2.0 is not allowed; allowed: a number in [0, inf)"),
        (np.nan, "speed_mps = nan is not allowed; allowed: a number in [0, inf)"),
        (np.inf, "speed_mps = inf is not allowed; allowed: a number in [0, inf)"),
        ("fast", "speed_mps = 'fast' is not a number or an array of numbers; allowed: [0, inf)"),
        (1j, "speed_mps = 1j is not a number or an array of numbers; allowed: [0, inf)"),
    ],
)
def test_what_is_not_allowed_is_said_with_what_is(value: object, said: str) -> None:
    with pytest.raises(ValueError) as caught:
        checked("speed_mps", value, NOT_NEGATIVE)
    assert str(caught.value) == said
