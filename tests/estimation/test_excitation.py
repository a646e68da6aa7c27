"""When the robot makes an excitation step towards home."""

import numpy as np
import pytest

from homeward.estimation.excitation import looks_back


@pytest.mark.parametrize(
    ("weather_changes", "at"), [(True, [10, 30, 50, 70, 90]), (False, [10, 50, 90])]
)
def test_it_is_due_at_the_tenth_decision_and_every_twenty_or_forty(
    weather_changes: bool, at: list[int]
) -> None:
    due = looks_back(np.arange(100), 1e4, 1.0, 30.0, weather_changes)
    assert np.flatnonzero(due).tolist() == at


def test_about_home_it_never_is() -> None:
    """Up to 1.5 decisions at cruise, here 45 m."""
    near_m = np.array([0.0, 44.9, 45.0, 45.1])
    assert looks_back(10, near_m, 1.0, 30.0).tolist() == [False, False, False, True]
    assert looks_back(10, near_m, 0.5, 30.0).tolist() == [False, True, True, True]


def test_one_robot_gets_a_plain_answer_and_several_an_array() -> None:
    assert looks_back(10, 500.0, 1.0, 30.0) is True and looks_back(9, 500.0, 1.0, 30.0) is False
    both = looks_back(np.array([[9], [10]]), np.array([500.0, 1.0]), 1.0, 30.0)
    assert both.tolist() == [[False, False], [True, False]]
