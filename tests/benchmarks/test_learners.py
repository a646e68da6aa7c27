"""The benchmark of other learners: what they may choose from, that they remember, and that nothing is trained twice."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.learners import Args, choices, main, train_recurrent
from homeward.agents.ppo_settings import TrainingError
from homeward.agents.shield import decode_actions
from homeward.envs.options import Options, settle
from homeward.envs.vector import HomewardVectorEnv


def test_there_is_every_way_to_go_on_one_stop_and_one_way_home() -> None:
    setting = settle(Options("Survey"))
    table = choices(setting)
    assert len(np.unique(table, axis=0)) == len(table) == 27
    assert (np.bincount(table[:, 2]) == [1, 25, 1]).all()
    assert decode_actions(setting, table[-1:]).homeward.all()


def test_a_finished_run_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = Args(out=tmp_path, missions=("OutAndBack",), learners=("dqn",), seeds=1, steps=1, episodes=4)
    main(args)
    first = capsys.readouterr()
    main(args)
    again = capsys.readouterr()
    assert "training" in first.err and not again.err
    assert first.out == again.out and "dmax_adaptive" in first.out


def test_a_recurrent_policy_remembers_until_missions_begin() -> None:
    options = Options("OutAndBack")
    policy = train_recurrent(options, 1, 0)
    env = HomewardVectorEnv(3, autoreset_mode="Disabled", **vars(options))
    observations, _ = env.reset(seed=0)
    begun, nobody = np.ones(3, np.bool_), np.zeros(3, np.bool_)
    policy.act(observations, begun)
    before = policy._memory[0].copy()  # type: ignore[attr-defined]
    policy.act(observations, nobody)
    assert not np.allclose(policy._memory[0], before)  # type: ignore[attr-defined]
    policy.act(observations, begun)
    np.testing.assert_allclose(policy._memory[0], before, atol=1e-6)  # type: ignore[attr-defined]


def test_an_unknown_learner_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="give --learners of ppo, recurrent ppo, dqn"):
        main(Args(out=tmp_path, learners=("sarsa",)))
