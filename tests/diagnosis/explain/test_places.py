"""Where and when: the split that separates an excess best, stretches of time, and both in words."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.change_points import Schedule
from homeward.diagnosis.explain.hypothesis import Term
from homeward.diagnosis.explain.places import (
    WHOLE_RUN,
    condition,
    locate,
    places,
    places_of,
    stretches,
    total_share,
    where_at_work,
)
from homeward.diagnosis.explain.residual_test import TESTED, Dependence, ResidualChannel
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.result import Place
from homeward.logs.channels import Array, Index
from tests.diagnosis.made_up import windows

CHANNELS = {one.name: one for one in TESTED}
TIME = ResidualChannel("time_s", "time in the run", "s", "after", "before")
SPEEDS = np.tile(np.arange(10) / 10.0, 8)  # 80 windows, each tenth of a m/s eight times


def dependence(channel: ResidualChannel, number: Array, effect: Array) -> Dependence:
    """Of an excess, W, in bins whose centres are tenths."""
    centre = np.arange(len(effect)) / 10.0
    return Dependence(
        channel, False, 0.001, 0.5, number.astype(np.intp), centre, effect, np.ones(len(number))
    )


def term(effect: str, level: Index | None = None) -> Term:
    """An effect of one size, at work in time if it has levels."""
    schedule = (
        None if level is None else Schedule("time", level, int(level.max()) + 1, 1, 5.0, (0.1,))
    )
    column = np.zeros((1 if level is None else len(level), 1))
    axis: Any = "steady" if level is None else "time"
    return Term(CATALOGUE[effect], column, np.zeros(1), np.ones(1), axis=axis, schedule=schedule)


@pytest.mark.parametrize(
    ("effect", "said", "inside"),
    [
        (np.where(np.arange(10) >= 6, 30.0, 0.0), "driving faster than 0.55 m/s", SPEEDS > 0.55),
        (np.where(np.arange(10) < 5, 30.0, 0.0), "driving slower than 0.45 m/s", SPEEDS < 0.45),
        # Less is drawn in a clear minority: this, and not the rest, is the condition.
        (np.where(np.arange(10) >= 7, -30.0, 0.0), "driving faster than 0.65 m/s", SPEEDS > 0.65),
    ],
)
def test_a_channel_is_split_where_the_excess_changes(
    effect: Array, said: str, inside: Array
) -> None:
    runs = windows(80, speed_mps=SPEEDS)
    found = locate(dependence(CHANNELS["speed_mps"], np.rint(10.0 * SPEEDS), effect), runs)
    assert found.condition == said
    np.testing.assert_array_equal(found.inside, inside)
    np.testing.assert_allclose(found.excess, np.where(inside, effect[effect != 0.0][0], 0.0))
    assert len(found.places) == 1 and found.share == pytest.approx(1.0)


def test_only_the_size_of_a_turn_counts_and_windows_without_the_channel_are_outside() -> None:
    turning = np.where(np.arange(80) % 2 == 0, SPEEDS, -SPEEDS)
    number = np.rint(10.0 * SPEEDS)
    turning[:20], number[:20] = np.nan, -1
    found = locate(
        dependence(CHANNELS["yaw_rate_radps"], number, np.where(np.arange(10) >= 6, 30.0, 0.0)),
        windows(80, yaw_rate_radps=turning),
    )
    assert found.condition == "turning faster than 0.55 rad/s"
    np.testing.assert_array_equal(found.inside, (SPEEDS > 0.55) & (number >= 0))
    assert (found.excess[:20] == 0.0).all()


def test_a_fast_turn_to_the_right_is_not_slower_than_a_limit() -> None:
    turning = np.where(np.arange(80) % 2 == 0, SPEEDS, -SPEEDS)
    excess_w = np.where(np.arange(10) < 5, 30.0, 0.0)
    located = locate(
        dependence(CHANNELS["yaw_rate_radps"], np.rint(10.0 * SPEEDS), excess_w),
        windows(80, yaw_rate_radps=turning),
    )
    assert located.condition == "turning slower than 0.45 rad/s"
    np.testing.assert_array_equal(located.inside, SPEEDS < 0.45)


@pytest.mark.parametrize("excess_w", [20.0, -20.0])
@pytest.mark.parametrize(
    ("high", "said"),
    [
        (slice(0, 2), "before 100 s"),
        (slice(8, 10), "after 400 s"),
        (slice(4, 6), "from 200 to 300 s"),
    ],
)
def test_the_stretch_of_a_run_with_the_excess_is_located(
    high: slice, said: str, excess_w: float
) -> None:
    """Two runs of 500 s in ten pieces each; in the second, one stretch draws 20 W more or less."""
    effect = np.zeros(20)
    effect[10:][high] = excess_w
    found = locate(dependence(TIME, np.repeat(np.arange(20), 100), effect), windows(1000, runs=2))
    assert found.condition == "in some stretches of time"
    (place,) = found.places
    assert (place.recording, place.condition) == ("1.csv", said)
    assert place.share_of_excess == pytest.approx(1.0)


def test_an_excess_all_through_one_run_is_that_run() -> None:
    found = locate(
        dependence(TIME, np.repeat([0, 1, 2], 50), np.array([0.0, 20.0, 0.0])), windows(50, runs=3)
    )
    (place,) = found.places
    assert (place.recording, place.condition) == ("1.csv", WHOLE_RUN)


def test_stretches_end_with_their_run_and_go_on_over_short_pauses() -> None:
    inside = np.zeros(40, np.bool_)
    inside[[3, 4, 5, 8, 9, 18, 19, 20, 21]] = True
    runs = windows(20, runs=2)

    def found(pause_s: float) -> list[tuple[int, int, int]]:
        return [(run, part.start, part.stop) for run, part in stretches(inside, runs, pause_s)]

    assert found(0.0) == [(0, 3, 6), (0, 8, 10), (0, 18, 20), (1, 20, 22)]
    assert found(1.5) == found(0.0)  # from 5 to 8
    assert found(2.0) == [(0, 3, 10), (0, 18, 20), (1, 20, 22)]
    assert list(stretches(np.zeros(40, np.bool_), runs)) == []


def test_places_share_the_energy_of_an_effect_and_have_its_ends() -> None:
    contribution = np.zeros(80)
    contribution[10:20], contribution[50:80] = 30.0, 10.0
    runs = windows(40, runs=2)
    first, second = places_of(contribution, runs, None)
    assert (first.recording, first.start_s, first.end_s) == ("0.csv", 5.0, 10.0)
    assert (second.recording, second.start_s, second.end_s) == ("1.csv", 5.0, 20.0)
    assert (first.share_of_excess, second.share_of_excess) == pytest.approx((0.5, 0.5))
    # windows of the second run
    longer = dataclasses.replace(runs, duration_s=np.repeat([0.5, 1.5], 40))
    assert [one.share_of_excess for one in places_of(contribution, longer, None)] == pytest.approx(
        [0.25, 0.75]
    )


@pytest.mark.parametrize(
    ("at_work", "said"),
    [(SPEEDS > 0.55, "driving faster than 0.5"), (np.arange(80) % 7 < 3, "while driving")],
)
def test_an_effect_is_at_the_values_of_its_channel_or_else_where_it_always_is(
    at_work: Array, said: str
) -> None:
    """Viscous drag is shown by speed: at work above a limit, or in windows that speed does not tell
    apart."""
    found = places(term("viscous"), 20.0 * at_work, windows(80, speed_mps=SPEEDS))
    assert found and all(one.condition.startswith(said) for one in found)


def test_an_effect_that_is_at_work_everywhere_has_no_condition_on_its_channel() -> None:
    found = places(term("viscous"), np.full(80, 20.0), windows(80, speed_mps=SPEEDS))
    assert [(one.condition, one.start_s, one.end_s) for one in found] == [
        ("while driving", 0.0, 40.0)
    ]


def test_a_schedule_is_where_its_level_is_not_the_reference() -> None:
    level = np.repeat([0, 1], [30, 50])
    (found,) = places(term("standby", level), 20.0 * level, windows(80))
    assert (found.condition, found.start_s, found.end_s) == ("after 15 s", 15.0, 40.0)


def test_a_rejected_effect_is_a_location() -> None:
    contribution = np.where(np.arange(400) < 200, 20.0, 0.0)
    found = where_at_work(
        term("standby", (contribution > 0.0).astype(np.intp)), contribution, windows(400)
    )
    np.testing.assert_array_equal(found.inside, contribution > 0.0)
    assert [one.condition for one in found.places] == [
        "before 100 s"
    ] and found.share == pytest.approx(1.0)


def place(said: str, share: float, recording: str = "a/0.csv") -> Place:
    return Place(recording, 0.0, 1.0, said, share)


@pytest.mark.parametrize(
    ("found", "said"),
    [
        ([], "nowhere"),
        ([place("grade above 0.1 rad", 0.2)] * 3, "grade above 0.1 rad"),
        (
            [place("after 10 s", 0.3), place("before 5 s", 0.7)],
            "before 5 s in 0.csv and in 1 more stretch of time",
        ),
        (
            [place("after 10 s", 0.3), place(WHOLE_RUN, 0.4, "b/1.csv"), place("before 5 s", 0.3)],
            "all through 1.csv and in 2 more stretches of time",
        ),
    ],
)
def test_places_are_one_phrase(found: list[Place], said: str) -> None:
    assert condition(found) == said


def test_the_share_of_an_effect_is_of_the_energy_that_was_recorded() -> None:
    runs: Runs = windows(80, observed=50.0)
    # 20 of 50 W, a quarter
    assert total_share(np.where(np.arange(80) < 20, -20.0, 0.0), runs) == pytest.approx(0.1)
    nothing: Any = SimpleNamespace(observed=np.zeros(80), duration_s=runs.duration_s)
    assert total_share(np.ones(80), nothing) == 0.0
