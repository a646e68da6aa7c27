"""The benchmark of the oracle: its tables, and that nothing is solved twice."""

import json
from pathlib import Path

import pytest

from benchmarks.agents import optimum


def test_the_benchmark_prints_its_tables_and_keeps_what_it_solved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    args = optimum.Args(tmp_path, missions=("OutAndBack",), episodes=12, jobs=1, agents=("soc50",))
    optimum.main(args)
    first = capsys.readouterr().out
    assert "OutAndBack" in first
    assert "soc50" in first
    assert list(json.loads((tmp_path / "OutAndBack-uncertain.json").read_text())["results"]) == ["0 to 9", "10 to 11"]
    monkeypatch.setattr(optimum, "_solve", None)  # nothing is left to be solved
    optimum.main(args)
    assert capsys.readouterr().out.split("Agents on")[0] == first.split("Agents on")[0]
