"""The command: which cases it runs, and what it writes."""

import json
from pathlib import Path

import pytest

import benchmarks.concealed.__main__ as command
from benchmarks.concealed.__main__ import Args, main
from benchmarks.concealed.plants.cases import NEEDS, PARTS, Part
from benchmarks.concealed.scoring.outcome import Outcome


def as_made(part: Part, seed: int, number: int, out: Path, without: tuple[str, ...]) -> Outcome:
    return Outcome(
        part,
        number,
        f"of seed {seed}",
        "low",
        ["payload"],
        {"payload": True},
        [],
        "none",
        "no_mismatch",
    )


def test_later_is_half_singles_and_half_pairs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "run_case", as_made)
    found = main(Args(seed=7, part="later", cases=3, workers=1, out=tmp_path))
    assert [(one.part, one.number) for one in found] == [
        ("singles", 0),
        ("singles", 1),
        ("pairs", 0),
    ]
    written = json.loads((tmp_path / "concealed.json").read_text())
    assert [one["vehicle"] for one in written["outcomes"]] == ["of seed 7"] * 3 and written[
        "cases"
    ] == 3
    assert "### One hidden effect" in (tmp_path / "concealed.md").read_text()


def test_all_is_every_part_that_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "run_case", as_made)
    monkeypatch.setattr(command, "find_spec", lambda name: None)
    found = main(Args(cases=1, workers=1, out=tmp_path))
    assert [one.part for one in found] == [part for part in PARTS if part not in NEEDS]
    assert "Left out: rover, cell." in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(Args(part="rover", cases=1, out=tmp_path))
