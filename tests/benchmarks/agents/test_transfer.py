"""The benchmark of transfer: its rows, and that none is run twice."""

import json
from pathlib import Path

import pytest

from benchmarks.agents.transfer import AGENTS, ELSEWHERE, Args, main, row_of
from homeward.envs.options import Options


def test_rows_are_printed_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = Args(missions=("Patrol",), episodes=8, out=tmp_path)
    main(args)
    first, kept = capsys.readouterr().out, json.loads((tmp_path / "transfer.json").read_text())
    rows = kept["results"]
    assert list(rows) == [f"Patrol, {met}" for met in ELSEWHERE]
    for row in rows.values():
        assert list(row["agents"]) == list(AGENTS)
        assert row["gain"] == pytest.approx(row["agents"]["ppo"]["score"] - row["agents"]["dmax_adaptive"]["score"])
    rows["Patrol, known"]["gain"] = 77.0
    (tmp_path / "transfer.json").write_text(json.dumps(kept))
    main(args)
    assert "+77" in capsys.readouterr().out and "+77" not in first


def test_another_number_of_episodes_is_run_anew(tmp_path: Path) -> None:
    for episodes in (4, 8):
        main(Args(missions=("Patrol",), episodes=episodes, out=tmp_path))
    row = json.loads((tmp_path / "transfer.json").read_text())["results"]["Patrol, husky"]
    assert {name: row[name] for name in ("agents", "gain")} == {
        name: row_of(Options("Patrol", robot="husky"), 8, 7)[name] for name in ("agents", "gain")
    }
