"""Results that benchmarks keep: a run that was killed goes on, and what is of other settings or
code is dropped."""

from pathlib import Path

import pytest

from benchmarks import kept
from benchmarks.kept import Kept


def test_what_was_kept_is_not_missing(tmp_path: Path) -> None:
    file, tasks = tmp_path / "new" / "results.json", {"one": 1, "two": 2}
    assert Kept(file, seeds=(7, 29)).missing(tasks) == tasks
    Kept(file, seeds=(7, 29)).keep("one", {"score": 0.5})
    again = Kept(file, seeds=(7, 29))
    assert again.results == {"one": {"score": 0.5}} and again.missing(tasks) == {"two": 2}


def test_other_settings_or_code_begin_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "results.json"
    Kept(file, seed=0).keep("one", 1)
    assert Kept(file, seed=1).results == {}
    monkeypatch.setattr(kept, "code_hash", lambda: "other")
    assert Kept(file, seed=0).results == {}
