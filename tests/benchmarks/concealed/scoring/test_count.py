"""Counts over outcomes are those that one makes by hand."""

import json
from pathlib import Path

from benchmarks.concealed.plants.draw import make_case
from benchmarks.concealed.scoring.count import (
    false_alarm,
    found_first,
    share,
    tables,
    wrongly_named,
)
from benchmarks.concealed.scoring.outcome import MODELS, Outcome, read_diagnosis


def outcome(**given: object) -> Outcome:
    made = Outcome("singles", 0, "jackal_plant", "low", ["payload"], {"payload": True}, [], "none")
    for name, value in given.items():
        setattr(made, name, value)
    return made


def test_counts_of_a_diagnosis_written_by_hand(tmp_path: Path) -> None:
    case = make_case("singles", 1, 0, short=True)
    entry = {
        "effect": "surface",
        "confused_with": ["payload"],
        "parameters": {"gain": {"value": 1.0, "ci95": [0.9, 1.1]}},
    }
    second = {"effect": "radio", "confused_with": [], "parameters": {}}
    (tmp_path / "diagnosis.json").write_text(json.dumps({
        "verdict": "missing_physics", "summary": "two things", "missing_physics": [entry, second],
        "parameters_off": [{"group": "m / Gamma", "assumed": 1.0, "fitted": 2.0, "ci95": [1.9, 2.1], "unit": "kg"}],
    }))  # fmt: skip
    diagnosis = json.loads((tmp_path / "diagnosis.json").read_text())
    right, late = outcome(), outcome(hidden=["radio"], visible={"radio": True}, number=1)
    for made in (right, late):
        read_diagnosis(made, diagnosis, case)
    assert right.classes == [["surface", "payload"], ["radio"]]
    assert right.off == ["m / Gamma"]
    assert found_first(right)
    assert not found_first(late)
    singles = tables([right, late])[0]
    assert singles.rows[0][1].startswith("1/2 = 50 %")
    assert singles.rows[0][-1] == "2.00"
    pair = outcome(part="pairs", hidden=["payload", "radio"], classes=right.classes, verdict="missing_physics",
                   provable={"payload": True, "radio": False})  # fmt: skip
    assert [cell.split(" ")[0] for cell in tables([pair])[0].rows[0][1:]] == [
        "1/1",
        "0/1",
        "1/1",
        "1/1",
        "0/1",
    ]


def test_cases_of_other_simulators_are_counted_by_kind() -> None:
    hidden: list[list[str]] = [["turning"], ["turning", "payload"], ["chatter"], []]
    made = tables(
        [outcome(part="rover", hidden=one, visible=dict.fromkeys(one, True)) for one in hidden]
    )
    titles = ["One hidden effect", "Two hidden effects", "Controls: no physics is missing",
              "Mechanisms outside the catalogue"]  # fmt: skip
    assert [table.title for table in made] == [f"{title}, rover" for title in titles]


def test_what_counts_as_a_false_alarm() -> None:
    assert false_alarm(outcome(verdict="missing_physics"))
    assert false_alarm(outcome(verdict="unknown_physics", summary="no grade was recorded"))
    assert not false_alarm(
        outcome(verdict="unknown_physics", fault="no_grade", summary="no grade was recorded")
    )
    assert false_alarm(
        outcome(verdict="unknown_physics", fault="no_grade", summary="further from base")
    )
    assert not false_alarm(outcome(verdict="parameters_off"))


def test_what_counts_as_wrongly_named() -> None:
    assert wrongly_named(outcome(part="outside", classes=[["radio", "surface"]]))
    assert not wrongly_named(
        outcome(part="outside", classes=[["radio", "surface"]], fair=["surface"])
    )
    assert not wrongly_named(outcome(part="outside", classes=[["a_formula"]]))


def test_later_drives_and_intervals_are_counted() -> None:
    drive = dict(zip(MODELS, (9.0, 5.0, 6.1, 6.5), strict=True))
    better = drive | {"corrected": 5.9}
    made = {
        table.title: table for table in tables([outcome(later=[drive, better], holds=["radio"])])
    }
    assert made["Energy of later drives, median error in %"].rows == [
        ("9.00", "5.00", "6.10", "6.20")
    ]
    worse = made[
        "Files whose mean error over later drives is larger by over a point than that of"
    ].rows[0]
    assert [cell[:3] for cell in worse] == ["0/1", "1/1", "0/1"]
    held = made["Visible effects that a file can say, for which corrected.toml holds"].rows
    assert [row[1].split(" ")[0] for row in held] == ["1/1", "0/1"]
    intervals = [
        {"name": "slip.per_load", "true": 1.0, "low": 0.8, "high": top, "off": False}
        for top in (0.9, 1.2)
    ]
    covered = tables([outcome(part="coverage", intervals=intervals)])[0]
    assert covered.rows[0][1].startswith("1/2")
    assert covered.rows[0][2] == "0.250"


def test_a_share_has_its_wilson_interval() -> None:
    # Newcombe 1998's formula by hand: 59.58 to 98.21
    assert share([True] * 9 + [False]) == "9/10 = 90 % (60–98)"
    assert share([]) == "–"
