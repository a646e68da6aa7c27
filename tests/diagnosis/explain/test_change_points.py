"""Levels of a schedule: sizes of about the same amount become one, exactly."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from homeward.diagnosis.explain.change_points import Schedule, _groups, _refined, clearly_apart

VALUES = st.lists(st.floats(-100.0, 100.0), min_size=2, max_size=7, unique=True)


@given(values=VALUES, data=st.data())
def test_no_other_groups_leave_less(values: list[float], data: st.DataObject) -> None:
    value = np.sort(values)
    times = np.array(data.draw(st.lists(st.integers(1, 5), min_size=len(value), max_size=len(value))))

    def left(group: np.ndarray) -> float:
        centre = np.bincount(group, times * value) / np.bincount(group, times)
        return float((times * (value - centre[group]) ** 2).sum())

    for count, group in enumerate(_groups(value, times, len(value)), start=2):
        assert np.diff(group).min() >= 0 and set(group.tolist()) == set(range(count))
        others = [
            left(np.searchsorted(starts, np.arange(len(value)), side="right"))
            for starts in itertools.combinations(range(1, len(value)), count - 1)
        ]
        assert left(group) <= min(others) + 1e-9


def test_a_change_amid_windows_that_tell_nothing_is_taken_to_be_in_their_middle() -> None:
    """As for windows that are held out: half of them are then right, whatever the true moment."""
    load = np.ones(40)
    load[18:24] = 0.0
    truth = np.repeat([0, 1], 20)
    level = np.repeat([0, 1], [16, 24])  # as the blocks of a search have it
    exact = _refined(level, load, load * truth, [np.arange(40)])
    assert int(np.flatnonzero(np.diff(exact))[0]) + 1 == 21


def test_what_begins_once_was_not_there_before() -> None:
    usual_later = Schedule("time", np.repeat([1, 0, 2], [3, 9, 4]), 3, 2, 5.0, (0.1,))
    assert usual_later.from_the_first().level.tolist() == [0] * 3 + [1] * 9 + [2] * 4
    assert clearly_apart(usual_later) and not clearly_apart(None)
