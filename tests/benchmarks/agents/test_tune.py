"""The script that tunes: as many trials for each, what it chooses, and that it prints what belongs
into the files."""

import json
from pathlib import Path

import pytest

from benchmarks.agents import tune
from benchmarks.agents.tune import (
    NUMBERS,
    PLANNER_STRANDS,
    SHIELD_STRANDS,
    Args,
    Attempt,
    Scored,
    best_number,
    main,
)
from homeward.agents.rules.pace import Pace
from homeward.agents.rules.reserves import PACES
from homeward.envs.options import OptionError, Options


def test_each_has_as_many_trials() -> None:
    assert {len(numbers) for numbers in NUMBERS.values()} == {8}
    assert set(NUMBERS) == {*tune.RULES, "planner", "shield"}


def test_the_planners_reserve_scores_most_of_those_that_strand_few() -> None:
    grids = {
        "planner, OutAndBack, uncertain": {
            0.0: Scored(100.0, 9),
            1.0: Scored(90.0, 3),
            2.0: Scored(85.0, 0),
        },
        "planner, OutAndBack, harsh": {
            0.0: Scored(10.0, 90),
            1.0: Scored(8.0, 80),
            2.0: Scored(8.1, 70),
        },
    }
    assert best_number(grids, 1000, PLANNER_STRANDS, "uncertain") == 1.0
    assert best_number(grids, 10_000, PLANNER_STRANDS, "uncertain") == 0.0  # 0.09 % strand
    assert best_number(grids, 100, PLANNER_STRANDS, "uncertain") == 2.0


def test_a_shield_keeps_back_the_least_that_is_safe_everywhere() -> None:
    few, many = 1e-3, 1e-5
    grids = {
        "easy": {few: Scored(10.0, 0), many: Scored(9.0, 0)},
        "hard": {few: Scored(10.0, 3), many: Scored(9.0, 2)},
        "unscored": {few: Scored(0.0, 0), many: Scored(0.0, 0)},
    }
    assert best_number(grids, 6000, SHIELD_STRANDS) == few
    assert best_number(grids, 4096, SHIELD_STRANDS) == many


def test_what_a_shield_keeps_back_is_tried() -> None:
    seeds, options = range(16), Options("OutAndBack")
    careful, bold = (
        tune.run_trial((Attempt("shield", options, one), seeds)) for one in (1e-6, 0.4)
    )
    assert careful.stranded == 0 < bold.stranded


def test_tuning_prints_reserves_for_each_mission_and_runs_no_trial_twice(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    args = Args("dmax", episodes=16, out=tmp_path)
    main(args)
    first = capsys.readouterr().out
    row = next(line for line in first.splitlines() if line.startswith('"dmax": '))
    reserves = json.loads(row.partition(": ")[2].rstrip(","))
    assert list(reserves) == list(PACES)
    assert reserves["OutAndBack"] > 0.0  # nothing kept back strands
    monkeypatch.setattr(tune, "run_trial", None)
    main(args)
    assert capsys.readouterr().out == first


def test_the_pace_that_senses_wins(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    # the other senses little
    monkeypatch.setattr(tune, "CANDIDATES", [PACES["Survey"], Pace(0.5, 5.0, 0.9)])
    monkeypatch.setattr(tune, "NUMBERS", {"dmax": (0.1, 0.2)})
    monkeypatch.setattr(tune, "PACED_BY", ("dmax",))
    main(Args(episodes=16, out=tmp_path))
    assert f"PACES = {PACES}\n" in capsys.readouterr().out


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(OptionError, match=r"--only soc50 .* choose from dmax, dmax_mapped"):
        main(Args("soc50"))
