"""Right and wrong answers, of outcomes that are made up."""

from benchmarks.concealed.fixed_way.cases import CASES
from benchmarks.concealed.fixed_way.score import is_right, wrong_names
from benchmarks.concealed.scoring.outcome import Outcome


def outcome(verdict: str, *classes: list[str]) -> Outcome:
    made = Outcome("outside", 0, "husky", "", [], {}, [], "none")
    made.verdict = verdict
    made.classes = list(classes)
    return made


def test_every_true_effect_must_be_in_a_class() -> None:
    case = CASES["01"]
    both = outcome("missing_physics", ["viscous", "surface"], ["payload"])
    one = outcome("missing_physics", ["surface"])
    assert is_right(case, both)
    assert not is_right(case, one)
    assert wrong_names(case, both) == wrong_names(case, one) == 0


def test_a_class_without_a_true_or_tolerated_member_is_wrong() -> None:
    case = CASES["03"]
    named = outcome("missing_physics", ["surface", "slip"], ["sensor_offset"], ["payload", "slip"])
    assert wrong_names(case, named) == 1
    assert not is_right(case, named)  # tolerated is not enough for the constant load


def test_a_capacity_that_is_said_to_be_wrong_is_a_name() -> None:
    worn = outcome("parameters_off")
    worn.capacity = ["ageing", "rate_capacity"]
    assert wrong_names(CASES["11"], worn) == 1
    worn.capacity = ["ageing", "internal_resistance"]
    assert wrong_names(CASES["11"], worn) == 0


def test_outside_the_catalogue_it_is_right_to_name_nothing() -> None:
    case = CASES["04"]
    assert is_right(case, outcome("unknown_physics"))
    assert is_right(case, outcome("no_mismatch"))
    assert not is_right(case, outcome("missing_physics", ["surface"]))
    assert wrong_names(case, outcome("missing_physics", ["turning"])) == 0


def test_where_nothing_is_hidden_no_physics_may_be_missing() -> None:
    case = CASES["14"]
    assert is_right(case, outcome("no_mismatch"))
    assert is_right(case, outcome("parameters_off"))
    assert not is_right(case, outcome("unknown_physics"))
    assert not is_right(case, outcome("not_testable"))


def test_recordings_that_could_not_be_diagnosed_are_no_right_answer() -> None:
    for verdict in ("refused", "crash"):
        assert not is_right(CASES["05"], outcome(verdict))
