"""Levels of a schedule: sizes of about the same amount become one, exactly."""

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward.diagnosis.explain.change_points import (
    Schedule,
    _groups,
    _refined,
    clearly_apart,
    may_change,
    search,
)

VALUES = st.lists(st.floats(-100.0, 100.0), min_size=2, max_size=7, unique=True)


@given(values=VALUES, data=st.data())
def test_no_other_groups_leave_less(values: list[float], data: st.DataObject) -> None:
    value = np.sort(values)
    times = np.array(
        data.draw(st.lists(st.integers(1, 5), min_size=len(value), max_size=len(value)))
    )

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


def runs_of(*lengths: int, temperature_c: Any = None) -> Any:
    """Runs of so many windows, with what a search in time uses of them."""
    run = np.repeat(np.arange(len(lengths)), lengths)
    return SimpleNamespace(run=run, context={"temperature_c": temperature_c})


def noise(windows: int) -> np.ndarray:
    return 0.1 * np.random.default_rng(0).standard_normal(windows)


@pytest.mark.parametrize(("first_w", "second_w"), [(5.0, 9.0), (5.0, 5.0)])
def test_the_schedules_of_two_loads_are_among_the_parts_of_that_of_both(
    first_w: float, second_w: float
) -> None:
    """Both are on for a while; where they are as large, the middle level is of either."""
    at = np.arange(600)
    first, second = (at // 50) % 2 == 1, (at > 225) & (at < 540)
    residual = noise(600) + first_w * first + second_w * second
    alone = search("time", np.ones(600), residual, runs_of(600), signed=False)
    parts = search("time", np.ones(600), residual, runs_of(600), signed=False, several=True)
    assert max(one.levels for one in alone) == (3 if first_w == second_w else 4)
    on = [one.level > 0 for one in parts if one.levels == 2]
    truths = (first, second) if first_w != second_w else (first | second, first & second)
    for truth in truths:
        assert max(np.mean(one == truth) for one in on) > 0.99


def test_what_begins_once_and_stays_changes_once_however_many_runs_follow() -> None:
    residual = noise(500) + 5.0 * (np.arange(500) >= 60)
    (found,) = search(
        "time", np.ones(500), residual, runs_of(100, 100, 100, 100, 100), signed=False
    )
    assert found.changes == 1


def test_a_run_of_a_few_windows_has_a_level_of_the_long_ones() -> None:
    """It is too short to be cut, and its size counts as theirs do."""
    on = np.append(np.arange(200) >= 90, np.ones(6, np.bool_))
    (found,) = search("time", np.ones(206), noise(206) + 5.0 * on, runs_of(200, 6), signed=False)
    assert found.levels == 2 and np.array_equal(found.level > 0, on)


def test_a_few_windows_less_of_a_load_that_is_rarely_on_are_another_schedule() -> None:
    """They are few of all windows, but not of those in which it is on."""
    on = np.zeros(2000, np.bool_)
    on[100:160] = on[1000:1056] = True
    on[1040:1048] = False
    found = search("time", np.ones(2000), noise(2000) + 5.0 * on, runs_of(2000), signed=False)
    assert any(np.array_equal(one.level > 0, on) for one in found)


@pytest.mark.parametrize("warms_up", [1.0, -1.0])
def test_a_thermostat_may_switch_a_few_times_if_the_air_is_then_colder_or_hotter(
    warms_up: float,
) -> None:
    runs = runs_of(200, 200, temperature_c=np.linspace(-5.0, 5.0, 400) * warms_up)
    level = np.zeros(400, np.intp)
    level[:60] = level[90:120] = 1
    schedule = Schedule("time", level, 2, 4, 9.0, (0.1,))
    assert not may_change("repeatedly", schedule, runs)
    assert may_change("in the cold", schedule, runs) == (warms_up > 0.0)
    assert may_change("in the heat", schedule, runs) == (warms_up < 0.0)
