"""Two versions diagnose the same recordings; what only one of them finds is counted in pairs."""

import dataclasses
import json
from pathlib import Path

import pytest

from benchmarks.concealed import paired
from benchmarks.concealed.paired import Args, Pair, ask_version, check_version, table
from benchmarks.concealed.plants.cases import Case
from benchmarks.concealed.plants.draw import make_case
from benchmarks.concealed.scoring.outcome import Outcome
from tests.benchmarks.concealed.plants.steady import ROBOT

THIS_VERSION = Path(__file__).parents[3]


def outcome(part: str, hidden: tuple[str, ...] = (), **changes: object) -> Outcome:
    made = Outcome(part, 0, "a robot", "low", list(hidden), dict.fromkeys(hidden, True), [], "none")
    return dataclasses.replace(made, **changes)  # type: ignore[arg-type]


def test_a_version_beside_itself_gives_the_same_answers(tmp_path: Path) -> None:
    (pair,) = paired.main(
        Args(THIS_VERSION, seed=1, cases=1, parts=("singles",), workers=1, out=tmp_path)
    )
    assert pair.before.verdict == pair.now.verdict == "missing_physics"
    assert pair.before.classes == pair.now.classes and pair.before.off == pair.now.off
    for before, now in zip(pair.before.later, pair.now.later, strict=True):
        assert before["corrected"] == pytest.approx(now["corrected"], rel=1e-9)
        assert before["nominal"] == pytest.approx(now["nominal"], rel=1e-9)
    (written,) = json.loads((tmp_path / "paired.json").read_text())["pairs"]
    assert written["before"]["verdict"] == "missing_physics"
    assert "| singles | found first | 1 of 1 | 1 of 1 |" in (tmp_path / "paired.md").read_text()


def test_a_folder_without_the_other_version_is_refused(tmp_path: Path) -> None:
    """Python would import this version instead, and compare it with itself."""
    with pytest.raises(
        SystemExit, match=r"is no checkout of homeward .* it imports .*__init__\.py"
    ):
        check_version(tmp_path)
    (tmp_path / "homeward").mkdir()
    (tmp_path / "homeward" / "__init__.py").write_text("import nothing_of_that_name")
    with pytest.raises(SystemExit, match="No module named 'nothing_of_that_name'"):
        check_version(tmp_path)


def other_version(folder: Path, ends: str) -> Path:
    package = folder / "version" / "homeward"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "__main__.py").write_text(ends)
    return package.parent


@pytest.mark.parametrize(
    ("ends", "verdict", "says"),
    [
        ("raise SystemExit('two runs are one')", "refused", "two runs are one"),
        ("raise KeyError('up_to_w')", "crash", "KeyError: 'up_to_w'"),
    ],
)
def test_an_end_without_an_answer_is_a_refusal_or_a_crash(
    tmp_path: Path, ends: str, verdict: str, says: str
) -> None:
    case = Case("singles", 0, "a robot", "low", ("payload",), ROBOT, ROBOT, [], {})
    answer = ask_version(case, tmp_path / "case", other_version(tmp_path, ends))
    assert answer.verdict == verdict and says in answer.summary


def test_a_field_that_the_other_version_lacks_is_left_out_only_where_the_case_does_not_set_it(
    tmp_path: Path,
) -> None:
    case = make_case("singles", 1, 0)
    case = dataclasses.replace(case, recordings=[])
    version = other_version(tmp_path, "")
    ask_version(case, tmp_path / "case", version, unknown=["rest_current_a"])
    text = (tmp_path / "case" / "nominal.toml").read_text()
    assert "rest_current_a" not in text and "mass_kg" in text
    with pytest.raises(ValueError, match=r"sets mass_kg = .* the other version does not know"):
        ask_version(case, tmp_path / "case", version, unknown=["mass_kg"])


def test_what_only_one_version_finds_is_in_the_interval_of_the_difference() -> None:
    found = outcome("singles", ("payload",), verdict="missing_physics", classes=[["payload"]])
    missed = outcome("singles", ("payload",), verdict="no_mismatch")
    worn = outcome("singles", ("ageing",), verdict="no_mismatch")
    pairs = [Pair(found, missed)] * 2 + [Pair(found, found)] * 6 + [Pair(worn, worn)] * 2
    rows = {row[1]: row[2:] for row in table(pairs).rows}
    assert rows["found first"] == ("8 of 10", "6 of 10", "-20 % (-50 to 10)")
    assert rows["found first, but ageing"][:2] == ("8 of 8", "6 of 8")
    assert rows["visible, and the verdict names no missing physics"][:2] == ("2 of 10", "4 of 10")


def test_later_drives_count_where_both_versions_wrote_a_file() -> None:
    later = [{"nominal": 5.0, "corrected": 1.0}] * 2
    worse = [{"nominal": 1.0, "refit": 9.0, "refit without noise": 9.0, "corrected": 3.0}] * 2
    both = Pair(
        outcome("singles", ("payload",), later=later), outcome("singles", ("payload",), later=worse)
    )
    refused = Pair(outcome("singles", ("payload",), later=later), outcome("singles", ("payload",)))
    rows = {row[1]: row[2:] for row in table([both, both, refused]).rows}
    counted = rows["mean error of corrected.toml on later drives, 2 cases"]
    assert counted[:2] == ("1.00 %", "3.00 %") and counted[2].startswith("2.00 points")
    assert rows["corrected.toml worse than the given file"][:2] == ("0 of 3", "2 of 3")
