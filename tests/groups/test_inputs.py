"""Groups of runs as they are named on the command line."""

from pathlib import Path

import pytest

from homeward.datasets import LOCAL_FOLDER, DatasetError
from homeward.groups.inputs import grouped_runs
from homeward.logs import RecordingError


@pytest.fixture
def files(tmp_path: Path) -> Path:
    for name in ("a1.csv", "a2.csv", "b1.csv", "b 2.csv"):
        (tmp_path / name).write_text("time_s,power_w\n0,1\n")
    return tmp_path


def test_groups_are_paths_and_patterns_in_the_order_given(files: Path) -> None:
    given = [f"hot={files}/b1.csv,{files}/b 2.csv", f"cold={files}/a*.csv", f"hot={files}/a1.csv,"]
    hot, cold = grouped_runs(given, "mine.toml")
    assert (hot.name, cold.name) == ("hot", "cold")
    # A group that is given twice is one; a pattern is in the order of names.
    assert [path.name for path, _ in hot.runs] == ["b1.csv", "b 2.csv", "a1.csv"]
    assert [path.name for path, _ in cold.runs] == ["a1.csv", "a2.csv"]
    assert {columns for one in (hot, cold) for _, columns in one.runs} == {"mine.toml"}
    assert hot.dataset is None


def test_a_file_whose_name_looks_like_a_pattern_is_that_file(files: Path) -> None:
    (files / "a[1].csv").write_text("x")
    first, _ = grouped_runs([f"x={files}/a[1].csv", f"y={files}/a2.csv"], None)
    assert [path.name for path, _ in first.runs] == ["a[1].csv"]


def test_a_group_of_a_data_set_has_its_runs_and_its_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fetched = {"EE1": [tmp_path / "1.csv"], "EE2": [tmp_path / "2.csv", tmp_path / "3.csv"]}
    monkeypatch.setattr("homeward.groups.inputs.fetch", lambda dataset, group: fetched[group])
    given = ["one=turtlebot3_tactics/EE1", "two=turtlebot3_tactics/EE2"]
    one, two = grouped_runs(given, None)
    assert one.runs == ((tmp_path / "1.csv", "turtlebot3_tactics"),) and len(two.runs) == 2
    assert one.dataset == two.dataset == "turtlebot3_tactics"
    assert grouped_runs(given, "mine.toml")[0].runs[0][1] == "mine.toml"
    with pytest.raises(RecordingError, match="of different data sets, and so of different robots"):
        grouped_runs([given[0], "two=ase_rover/EE2"], None)


@pytest.mark.parametrize(
    "wrong", ["b", "=x.csv", "b=", "b= , ", "[b]=x.csv", f"{'b' * 41}=x.csv", "a\nb=x.csv"]
)
def test_what_is_no_named_group_is_refused_with_an_example(files: Path, wrong: str) -> None:
    with pytest.raises(
        RecordingError, match=r"^--group .* is not NAME=RUNS, such as before=a1\.csv"
    ) as caught:
        grouped_runs([f"a={files}/a1.csv", wrong], None)
    assert "\n" not in str(caught.value)


def test_one_group_is_no_comparison(files: Path) -> None:
    with pytest.raises(
        RecordingError, match="one group only, a; a comparison needs --group at least twice"
    ):
        grouped_runs([f"a={files}/a1.csv", f"a={files}/a2.csv"], None)


def test_what_is_not_there_is_said(files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(
        RecordingError, match=r"none\*\.csv: no such file, and no file matches it as a pattern"
    ):
        grouped_runs([f"a={files}/a1.csv", f"b={files}/none*.csv"], None)
    monkeypatch.setenv(LOCAL_FOLDER, str(files))
    with pytest.raises(DatasetError, match="has no group 'EE9'; groups: EE1"):
        grouped_runs([f"a={files}/a1.csv", "b=turtlebot3_tactics/EE9"], None)
