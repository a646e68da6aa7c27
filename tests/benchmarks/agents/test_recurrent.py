"""The benchmark of recurrent memory: what it keeps can be proved again, and missions do not share a memory."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.agents import recurrent
from homeward.agents.evaluation import episode_seeds
from homeward.agents.learning.settings import TrainingError
from homeward.envs.features import FEATURES
from homeward.envs.options import Options


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"SIDE_BY_SIDE": 4, "ROLLOUT": 16, "PIECE": 64, "VALIDATION_EPISODES": 2}.items():
        monkeypatch.setattr(recurrent, name, value)


@pytest.mark.usefixtures("small")
def test_the_best_policy_is_kept_and_can_be_proved_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = recurrent.Args(beliefs=True, steps=128, episodes=3, out=tmp_path)
    recurrent.main(args)
    first = capsys.readouterr().out
    curve = json.loads((tmp_path / "OutAndBack-uncertain-beliefs-0.json").read_text())
    assert [point["decisions"] for point in curve] == [64, 128]
    recurrent.main(recurrent.Args(beliefs=True, steps=0, episodes=3, out=tmp_path))
    assert capsys.readouterr().out == first[first.index(" " * 10) :]
    with pytest.raises(TrainingError, match="there is no"):
        recurrent.main(recurrent.Args("Survey", steps=0, out=tmp_path))


@pytest.mark.usefixtures("small")
def test_missions_do_not_share_a_memory() -> None:
    options = Options("OutAndBack")
    model = recurrent.make_model(options, recurrent.Args())
    seeds = episode_seeds(5, 3)
    together = recurrent._run(model, recurrent.Args(), options, seeds)
    alone = recurrent._run(model, recurrent.Args(), options, seeds[1:2])
    assert together.score[1] == alone.score[0] and together.decisions[1] == alone.decisions[0]


@pytest.mark.usefixtures("small")
def test_a_mission_that_begins_remembers_nothing() -> None:
    options = Options("OutAndBack")
    model = recurrent.make_model(options, recurrent.Args())
    policy = recurrent.Remembering(model, None)
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, (6, 2, len(FEATURES))).astype(np.float32)
    begins, goes_on = np.ones(2, np.bool_), np.zeros(2, np.bool_)
    for observations in seen:
        policy.act(observations, begins if observations is seen[0] else goes_on)
    assert policy._memory is not None
    kept = policy._memory[0].copy()
    policy.act(seen[0], np.array([True, False]))
    again = recurrent.Remembering(model, None)
    again.act(seen[0], begins)
    assert again._memory is not None
    np.testing.assert_array_equal(policy._memory[0][:, 0], again._memory[0][:, 0])
    assert not np.array_equal(policy._memory[0][:, 1], again._memory[0][:, 1]) and not np.array_equal(
        policy._memory[0], kept
    )
