"""The command: which cases it runs, and what it prints and writes."""

import json
from pathlib import Path

import pytest
from rich.console import Console

import benchmarks.concealed.fixed_way.__main__ as command
from benchmarks.concealed.fixed_way.__main__ import (
    Answer,
    Args,
    answer_table,
    hidden_text,
    main,
    run_case,
)
from benchmarks.concealed.fixed_way.cases import CASES
from benchmarks.concealed.fixed_way.score import is_right, wrong_names
from benchmarks.concealed.scoring.outcome import Outcome


def answer(number: str, verdict: str, *classes: list[str]) -> Answer:
    outcome = Outcome("outside", int(number), "husky", "", [], {}, [], "none")
    outcome.verdict = verdict
    outcome.classes = list(classes)
    return Answer(number, {"surface_share": 0.1, "all": 0.1}, outcome)


def as_made(number: str, out: Path) -> Answer:
    return answer(number, "no_mismatch")


def test_it_runs_the_cases_that_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "run_case", as_made)
    answers = main(Args(cases=("14", "07"), workers=1, out=tmp_path))
    assert [made.number for made in answers] == ["14", "07"]
    written = json.loads((tmp_path / "fixed_way.json").read_text())
    assert [made["outcome"]["verdict"] for made in written] == ["no_mismatch"] * 2
    assert "07 gearbox warms up" in capsys.readouterr().out


def test_an_unknown_case_is_refused() -> None:
    with pytest.raises(ValueError, match="no case 15; there are 01, 02"):
        Args(cases=("01", "15"))


def test_the_last_line_has_the_totals() -> None:
    made = answer_table(
        [
            answer("11", "missing_physics", ["surface", "viscous"], ["payload"]),
            answer("12", "missing_physics", ["radio"]),
            answer("14", "missing_physics", ["wind"]),
        ]
    )
    console = Console(width=200)
    with console.capture() as captured:
        console.print(made)
    lines = [line.split() for line in captured.get().splitlines() if line.strip()]
    assert lines[-1] == ["3", "cases", "2", "2"]
    assert "surface/viscous, payload" in captured.get()


def test_what_is_hidden_is_said_with_its_share() -> None:
    both = {"surface_share": 0.11, "payload_kg": 0.09, "all": 0.18}
    assert hidden_text(CASES["01"], both) == "surface, payload: 11 %, 9 %"
    chatter = {"drive_share": 0.08, "all": 0.08}
    assert hidden_text(CASES["05"], chatter) == "not in the catalogue: 8 %"
    assert hidden_text(CASES["14"], {"all": 0.0}) == "nothing"


def test_ground_beside_a_payload_is_found_and_no_radio(tmp_path: Path) -> None:
    """Slopes tell the place, so motion explains most of what the rougher half of the way
    consumes."""
    answered = run_case("01", tmp_path)
    assert is_right(answered.case, answered.outcome)
    assert wrong_names(answered.case, answered.outcome) == 0
