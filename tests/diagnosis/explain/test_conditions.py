"""The conditions are one table: values are reported, the first that fails ends the checks, and one
can be left out."""

from dataclasses import dataclass
from typing import Any

import pytest

from homeward import Robot
from homeward.diagnosis import Analysis, Diagnosis, analyse
from homeward.diagnosis.explain.conditions import CONDITIONS, Condition, check_names, judge, passes
from tests.diagnosis.conftest import Drive


@dataclass
class Asked:
    """A candidate that says which of its values were asked for."""

    values: dict[str, float | None]
    asked: list[str]

    def give(self, name: str) -> float | None:
        self.asked.append(name)
        return self.values[name]


def table(*names: str) -> list[Condition[Any]]:
    """Conditions that a value of 1 or more meets."""
    return [
        Condition(
            name, "a value", "all", "at least", lambda candidate: 1.0, "1", "this test",
            lambda candidate, name=name: candidate.give(name),  # type: ignore[misc]
        )
        for name in names
    ]  # fmt: skip


def test_the_first_condition_that_fails_ends_the_checks() -> None:
    asked: Any = Asked({"first": 2.0, "absent": None, "second": 0.5, "third": 2.0}, [])
    checks = judge(asked, (), table("first", "absent", "second", "third"))
    assert [(check.condition, check.value, check.holds) for check in checks] == [
        ("first", 2.0, True),
        ("second", 0.5, False),
    ]
    assert asked.asked == ["first", "absent", "second"]
    assert not passes(checks)


def test_a_condition_that_is_left_out_is_shown_and_refuses_nothing() -> None:
    asked: Any = Asked({"first": 0.5, "second": 2.0}, [])
    checks = judge(asked, ("first",), table("first", "second"))
    assert [check.holds for check in checks] == [False, True]
    assert passes(checks, ("first",)) and not passes(checks)


def test_an_unknown_name_is_refused_with_those_that_there_are(husky: Robot) -> None:
    with pytest.raises(ValueError, match=r"'gian' is no condition; these are: energy, .*placebo"):
        check_names(["gian"])
    with pytest.raises(ValueError, match="no condition"):
        analyse([], husky, without=["gian"])


def test_the_result_carries_every_value_of_what_is_named(scrubbing: Analysis) -> None:
    (turning,) = scrubbing.diagnosis.missing_physics
    checked = {check.condition: check for check in turning.conditions}
    assert set(checked) == {
        condition.name for condition in CONDITIONS if condition.applies_to == "every effect"
    }
    assert all(check.holds for check in turning.conditions)
    assert checked["gain"].limit == 0.1 <= checked["gain"].value
    assert Diagnosis.from_json(scrubbing.diagnosis.to_json()) == scrubbing.diagnosis


def test_what_was_tried_and_not_named_fails_in_its_last_value(scrubbing: Analysis) -> None:
    tried = scrubbing.diagnosis.not_named
    assert tried and "turning" not in [effect.effect for effect in tried]
    for effect in tried:
        *before, last = effect.conditions
        assert all(check.holds for check in before) and not last.holds


def test_a_diagnosis_without_a_condition_goes_on_where_that_refused(
    scrubbing: Analysis, short_drive: Drive, husky: Robot
) -> None:
    last = {effect.conditions[-1].condition for effect in scrubbing.diagnosis.not_named}
    left_out = sorted(last)[0]
    runs = short_drive(husky, effects={"turning": {"scrub": 0.3}})
    careless = analyse(runs, husky, without=(left_out,)).diagnosis
    assert "turning" in [effect.effect for effect in careless.missing_physics]
    assert left_out not in {effect.conditions[-1].condition for effect in careless.not_named}
