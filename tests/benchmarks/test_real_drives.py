"""The figures of later drives: what counts as an error, and regressions that are no straw men."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from benchmarks.real_drives import (
    Errors,
    Split,
    errors_of,
    formula,
    in_better_windows,
    missed_of,
    regress,
    ridge,
    run,
    show,
    show_regressions,
    splits,
)
from homeward.datasets import DatasetError
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import usable_runs
from tests.diagnosis.fit.test_predictive import CAR, SUMMER_C, WINTER_C, drives


@pytest.fixture(scope="module")
def winter_and_summer() -> tuple[Runs, Runs]:
    robot = dataclasses.replace(
        CAR, effects={"inertia": {"mass_factor": 1.0}, "regeneration": {"share": 0.8}}
    )
    before, later = (
        average(usable_runs(drives(robot, seed, c), CAR)[0])
        for seed, c in ((0, WINTER_C), (1, SUMMER_C))
    )
    return before, later


def test_both_regressions_predict_a_car_that_they_were_not_told_of(
    winter_and_summer: tuple[Runs, Runs],
) -> None:
    before, later = winter_and_summer
    for predicted in (ridge(before, later), formula(before, later)):
        errors = errors_of(predicted, later)
        assert errors.r2 > 0.95 and errors.total_pct < 5.0


def test_a_drive_counts_by_its_energy_and_at_most_a_half(
    winter_and_summer: tuple[Runs, Runs],
) -> None:
    _, later = winter_and_summer
    predicted = later.observed * np.where(later.run == 0, 3.0, 1.1)
    missed = missed_of(predicted, later)
    assert missed[0] == 0.5 and missed[1:] == pytest.approx(0.1)
    errors = errors_of(predicted, later)
    assert errors.drive_pct == pytest.approx(100.0 * missed.mean()) and errors.r2 < 1.0


def test_a_regression_has_the_better_windows_of_a_vehicle() -> None:
    def of_split(ridge_pct: float, longer_pct: float) -> dict[str, Errors]:
        by_pct = {"ridge": ridge_pct, "ridge, 1 s": longer_pct}
        by_pct |= {"least squares": 1.0, "least squares, 1 s": 2.0}
        return {name: Errors(0.0, drive_pct, 0.0) for name, drive_pct in by_pct.items()}

    chosen = in_better_windows([of_split(1.0, 2.0), of_split(9.0, 3.0)])
    assert [errors["ridge"].drive_pct for errors in chosen] == [2.0, 3.0]
    assert all(errors["least squares"].drive_pct == 1.0 for errors in chosen)
    assert "ridge, 1 s" not in chosen[0]


def test_what_is_not_at_hand_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOMEWARD_DATA", str(tmp_path))
    with pytest.raises(DatasetError, match="no folder bmw_i3 in HOMEWARD_DATA"):
        splits("bmw")


def test_a_split_is_diagnosed_and_its_file_replayed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file as it is written: what it lacks, the later drives would show."""
    heavier = dataclasses.replace(CAR, rolling_resistance=1.5 * CAR.rolling_resistance)
    (tmp_path / "car.toml").write_text(CAR.to_toml())
    diagnosed, later = (drives(heavier, seed, np.full(3, 20.0)) for seed in (0, 1))
    outcome = run(Split("car", "first to second", str(tmp_path / "car.toml"), diagnosed, later))
    assert outcome.errors["file"].total_pct <= outcome.errors["given"].total_pct
    assert outcome.labelled_j == {"heater": [], "cooler": []}
    split, errors = regress(
        Split("car", "first to second", str(tmp_path / "car.toml"), diagnosed, later)
    )
    assert all(errors[name] == outcome.errors[name] for name in errors)
    show_regressions([(split, errors)])
    assert "least squares, 1 s" in " ".join(capsys.readouterr().out.split())
    show([outcome])
    assert "car, first to second" in capsys.readouterr().out
