"""Levels of a schedule: sizes of about the same amount become one, exactly."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from homeward.diagnosis.explain.change_points import _groups

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
