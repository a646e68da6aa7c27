"""The benchmark of the shield: its rows, what they are compared with, and that none is run twice."""

import json
from pathlib import Path

import pytest

from benchmarks.agents import shield
from benchmarks.agents.shield import Args, main, reference_of, row_of
from homeward.agents import AgentError
from homeward.agents.evaluation import episode_seeds
from homeward.agents.rules.reserves import RESERVES
from homeward.envs.options import Options


def test_rows_are_printed_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = Args(("onward",), ("OutAndBack",), ("uncertain",), ("generated",), episodes=8, out=tmp_path)
    main(args)
    file, first = tmp_path / "shield.json", capsys.readouterr().out
    content = json.loads(file.read_text())
    setting = "OutAndBack, uncertain, generated"
    assert list(content["results"]) == [f"{setting}, reference", f"{setting}, onward"]
    row = content["results"][f"{setting}, onward"]
    assert row["bare"]["stranded"] > 0 and row["shielded"]["stranded"] == 0
    assert row["difference"] == row["shielded"]["score"] - row["bare"]["score"] > 0.0
    row["shielded"]["stranded"] = 5
    file.write_text(json.dumps(content))
    main(args)
    assert " 5 (" in capsys.readouterr().out and " 5 (" not in first


def test_other_episodes_are_run_anew(tmp_path: Path) -> None:
    setting = {"policies": ("onward",), "missions": ("Patrol",), "difficulties": ("known",), "routes": ("generated",)}
    for episodes in (4, 8):
        main(Args(**setting, episodes=episodes, out=tmp_path))  # type: ignore[arg-type]
    rows = json.loads((tmp_path / "shield.json").read_text())["results"]
    again = row_of(("onward", Options("Patrol", difficulty="known"), 8, 0))
    assert rows["Patrol, known, generated, onward"]["difference_ci95"] == again["difference_ci95"]


def test_what_scores_are_compared_with_strands_few(monkeypatch: pytest.MonkeyPatch) -> None:
    options, seeds = Options("OutAndBack", route="hidden_wind"), episode_seeds(0, 64)
    monkeypatch.setitem(RESERVES["planner"], "OutAndBack", 1.0)  # strands some
    monkeypatch.setattr(shield, "MOST_STRANDED", 1.0)
    least = reference_of(options, seeds)
    monkeypatch.setattr(shield, "MOST_STRANDED", (least["stranded"] - 0.5) / 64)
    fewer = reference_of(options, seeds)
    assert fewer["stranded"] < least["stranded"] and fewer["deviations"] > least["deviations"]
    monkeypatch.setattr(shield, "MOST_STRANDED", -1.0)
    monkeypatch.setattr(shield, "_DEVIATIONS_MORE", 0)
    assert reference_of(options, seeds)["score"] == 0.0


def test_an_unknown_policy_is_refused_before_anything_is_run(tmp_path: Path) -> None:
    with pytest.raises(AgentError, match="unknown policy 'sleepy'; choose from onward, wanderer, random"):
        main(Args(policies=("onward", "sleepy"), out=tmp_path))
    assert not list(tmp_path.iterdir())
