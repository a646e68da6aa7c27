"""The script that tunes the baselines runs on a few missions and prints what belongs into `agents/rules/tuned.py`."""

import numba
import pytest

from benchmarks import tune_baselines
from homeward.agents.rules.pace import Pace
from homeward.agents.rules.tuned import PACES


def test_tuning_prints_a_pace_and_reserves_for_each_mission(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    threads = numba.get_num_threads()
    monkeypatch.setattr(tune_baselines, "EPISODES", 16)
    monkeypatch.setattr(tune_baselines, "CANDIDATES", [PACES["Survey"], Pace(0.5, 5.0, 0.9)])  # the other senses little
    rules = {name: (rule, grid[:: len(grid) // 2 or 1]) for name, (rule, grid) in tune_baselines.RULES.items()}
    monkeypatch.setattr(tune_baselines, "RULES", rules)
    monkeypatch.setattr(tune_baselines, "DEVIATIONS", tune_baselines.DEVIATIONS[::6])  # of the planner
    try:
        tune_baselines.main()
    finally:
        numba.set_num_threads(threads)
    printed = dict(line.split(": ", 1) for line in capsys.readouterr().out.splitlines() if "Pace(" in line)
    assert list(printed) == list(PACES)
    for mission, line in printed.items():
        assert line.startswith(f"{PACES[mission]}, ")
        assert "'soc50': 0.5" in line
    assert "'dmax': 0.14" in printed["OutAndBack"]  # nothing kept back strands, twice as much turns back too soon
