"""The search tries what an estimator expects, the same wherever it stopped, and leaves a study that
Optuna reads."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import pytest

from homeward.search import SearchError, SearchRange, Trial, search

SPACE: dict[str, SearchRange | tuple[Any, ...]] = {
    "rate": SearchRange(1e-4, 1e-1),
    "width": SearchRange(1, 9),
    "start": ("cold", "warm"),
}


def bowl(number: int, settings: dict[str, Any]) -> float:
    """Best at a rate of 0.01 and a width of 5, started warm; trial 3 fails."""
    if number == 3:
        return math.nan
    warm = float(settings["start"] == "warm")
    return warm - math.log10(settings["rate"] / 0.01) ** 2 - float(settings["width"] - 5) ** 2


def same(one: list[Trial], other: list[Trial]) -> bool:
    return repr(one) == repr(other)  # NaN does not equal itself


def test_it_finds_the_best_and_leaves_the_study(tmp_path: Path) -> None:
    optuna = pytest.importorskip("optuna")
    kept: list[int] = []
    done = search(SPACE, 40, bowl, tmp_path / "study.journal", lambda done: kept.append(len(done)))
    assert kept == list(range(1, 41))
    for one in done:
        rate, width, start = one.settings.values()
        assert 1e-4 <= rate <= 1e-1 and width in range(1, 10) and start in ("cold", "warm")
    assert math.isnan(done[3].score)
    best = max((one for one in done if one.number != 3), key=lambda one: one.score)
    assert (best.settings["width"], best.settings["start"]) == (5, "warm")
    assert 0.003 < best.settings["rate"] < 0.03
    # On a logarithmic scale as many are drawn below 0.003 as above.
    assert 2 <= sum(one.settings["rate"] < 10**-2.5 for one in done[:10]) <= 8
    storage = optuna.storages.journal.JournalStorage(
        optuna.storages.journal.JournalFileBackend(str(tmp_path / "study.journal"))
    )
    study = optuna.load_study(study_name="homeward", storage=storage)
    assert [trial.params for trial in study.trials] == [one.settings for one in done]
    assert study.best_value == best.score
    assert study.trials[3].state is optuna.trial.TrialState.FAIL
    assert [file.name for file in tmp_path.iterdir()] == ["study.journal"]


def test_a_search_that_was_stopped_tries_the_same(tmp_path: Path) -> None:
    pytest.importorskip("optuna")

    def stopped(number: int, settings: dict[str, Any]) -> float:
        if number == 13:
            raise KeyboardInterrupt
        return bowl(number, settings)

    whole = search(SPACE, 16, bowl, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        search(SPACE, 16, stopped, tmp_path / "stopped")
    assert same(search(SPACE, 16, bowl, tmp_path / "stopped"), whole)
    other = search(SPACE, 16, lambda number, settings: -bowl(number, settings), tmp_path / "other")
    assert other[0].settings == whole[0].settings
    assert other[15].settings != whole[15].settings


@pytest.mark.parametrize("ends", [(2.0, 1.0), (1, 1), (0.0, math.inf), (math.nan, 1.0)])
def test_ends_that_make_no_range_are_refused(ends: tuple[float, float]) -> None:
    with pytest.raises(SearchError, match=r"is no range; give LOW\.\.HIGH with LOW below HIGH"):
        SearchRange(*ends)


def test_without_optuna_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(SearchError, match=r"^a search needs optuna: pip install "):
        search(SPACE, 1, bowl, tmp_path / "study")
    assert not list(tmp_path.iterdir())
