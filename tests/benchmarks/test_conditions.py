"""Every candidate is checked to the end, the diagnosis stays what it is, and what becomes of it
without a condition is counted."""

from collections.abc import Callable, Sequence

import pytest

from benchmarks import conditions
from benchmarks.conditions import (
    NAMES,
    VEHICLES,
    Answer,
    Judged,
    Recordings,
    alone,
    changes,
    diagnosed_again,
    tried,
)
from homeward import Robot
from homeward.diagnosis import analyse
from homeward.diagnosis.result import Checked
from tests.diagnosis.conftest import Drive


def test_candidates_have_the_values_of_all_conditions(drive: Drive, husky: Robot) -> None:
    runs = drive(husky, runs=2, minutes=1.0, effects={"turning": {"scrub": 0.5}})
    judged = dict(tried(lambda: analyse(runs, husky), "husky"))
    for whose in ("husky, turning", "husky, turning together"):
        assert [check.condition for check in judged[whose] if not check.holds] == []
    assert {check.condition for checks in judged.values() for check in checks} <= {*NAMES}


def _checked(condition: str, *, holds: bool) -> Checked:
    return Checked(condition=condition, value=0.0, side="at least", limit=1.0, holds=holds)


def test_a_condition_refuses_alone_where_all_others_hold() -> None:
    by_gain_alone = (_checked("gain", holds=False), _checked("motion", holds=True))
    by_two = (_checked("evidence", holds=False), _checked("motion", holds=False))
    assert alone([("wind", by_gain_alone), ("payload", by_two), ("slip", by_gain_alone)]) == (
        "gain",
    )


def test_recordings_are_diagnosed_again_without_those_that_refuse_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    judged: list[Judged] = [
        ("wind", (_checked("gain", holds=False), _checked("motion", holds=True)))
    ]

    def tried_once(diagnosed: Callable[[], object], whose: str) -> list[Judged]:
        diagnosed()
        return judged

    monkeypatch.setattr(conditions, "tried", tried_once)

    def diagnose(without: Sequence[str]) -> Answer:
        return Answer(("wind",), 1.0) if "gain" in without else Answer((), 0.0)

    diagnosed = diagnosed_again("singles", "husky", diagnose, again=True)
    assert diagnosed == Recordings(
        "singles", judged, Answer((), 0.0), {"gain": Answer(("wind",), 1.0)}
    )
    assert diagnosed_again("singles", "husky", diagnose, again=False).without == {}


def test_answers_without_a_condition_are_compared_by_part() -> None:
    right = Answer(("missing_physics", "wind"), 1.0)
    wrong = Answer(("missing_physics", "payload"), 0.0)
    singles = [
        Recordings("singles", [], right, {"motion": wrong}),
        Recordings("singles", [], right),
        Recordings("singles", [], right, {"gain": right}),
    ]
    vehicle = Recordings(
        VEHICLES, [], Answer(("unknown_physics",), 4.0), {"motion": Answer(("no_mismatch",), 4.5)}
    )
    table = changes([*singles, vehicle])
    columns = [list(column.cells) for column in table.columns]
    rows = {(cells[0], cells[1]): cells[2:] for cells in zip(*columns, strict=True)}
    assert rows["motion", "singles"][:3] == ("1 of 3", "3", "2")
    assert rows["gain", "singles"] == ("0 of 3", "3", "3", "0 %, no case differs")
    assert rows["motion", VEHICLES] == ("1 of 1", "4.00 %", "4.50 %", "0.50 points, of one case")
