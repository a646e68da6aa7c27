"""The README's training example runs as it is printed, and the benchmark measures it."""

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import pytest
from stable_baselines3 import PPO

from benchmarks.agents import first_training
from benchmarks.agents.first_training import Args, example, main, program, run_seed
from homeward.agents.learning.settings import TrainingError


@pytest.fixture
def few_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(first_training, "EPISODES", 4)


def test_the_example_has_ten_lines_and_runs(
    few_episodes: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(example().splitlines()) <= 10
    trained: list[int] = []
    monkeypatch.setattr(PPO, "learn", lambda model, steps: trained.append(steps))
    text = program(2000).replace(
        "unseen_episodes(model, env, 500)", "unseen_episodes(model, env, 2)"
    )
    assert "seed=2000" in text and "seed=0" not in text
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(text, {})  # the example of this project's own README
    result = json.loads(printed.getvalue().splitlines()[-1])
    assert trained == [2_000_000]
    assert result["start"] == result["end"] < 10.0  # nothing was learned
    assert result["wall_s"] > 0.0


def test_rows_are_printed_and_kept(
    few_episodes: None,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def made_up(seed: int) -> dict[str, Any]:
        return {"start": 0.0, "end": 1e4 if seed else 1.0, "wall_s": 40.0, "cpu_s": 20.0}

    monkeypatch.setattr(first_training, "run_seed", made_up)
    main(Args(seeds=2, out=tmp_path))
    printed = capsys.readouterr().out
    assert "seed 1000" in printed and "1 of 2 seeds end above dmax and above their start" in printed
    monkeypatch.setattr(first_training, "run_seed", None)
    main(Args(seeds=2, out=tmp_path))
    assert capsys.readouterr().out == printed


def test_what_cannot_run_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(TrainingError, match="--seeds 0 is not allowed"):
        main(Args(seeds=0))
    monkeypatch.setattr(first_training, "program", lambda seed: "raise ValueError('no example')")
    with pytest.raises(
        TrainingError, match="the example fails with seed 7: ValueError: no example"
    ):
        run_seed(7)
