"""The benchmark of other learners: what they may choose from, that they remember, and that nothing is trained twice."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from benchmarks import learners
from benchmarks.learners import Args, PaidAsItGoes, choices, main, missions, train_recurrent
from homeward.agents.learning.settings import TrainingError
from homeward.envs.actions import decode_actions
from homeward.envs.options import Options, known_of
from homeward.envs.vector import HomewardVectorEnv


def test_there_is_every_way_to_go_on_one_stop_and_one_way_home() -> None:
    known = known_of(Options("Survey"))
    table = choices(known)
    assert len(np.unique(table, axis=0)) == len(table) == 27
    assert (np.bincount(table[:, 2]) == [1, 25, 1]).all()
    assert decode_actions(known, table[-1:]).returns.all()


def test_paid_as_it_goes_a_mission_adds_up_to_its_score_and_stranding_costs() -> None:
    options = Options("OutAndBack")
    adapter = missions(options, 64, 0)
    env = PaidAsItGoes(adapter)
    env.reset()
    earned, ended = np.zeros(64), 0
    for decision in range(400):
        returns = (np.arange(64) % 2 == 0) & (decision >= 40)  # the others drive on until they are empty
        _, rewards, dones, infos = env.step(np.stack((np.full(64, 4), np.zeros(64, int), 1 + returns), axis=1))
        earned += rewards
        for i in np.flatnonzero(dones):
            score = infos[i]["score"] * adapter.env.batch.known.shared["per_score"][0]
            if infos[i]["home"]:
                assert earned[i] == pytest.approx(score, abs=1e-4)
            else:
                assert earned[i] > -0.5 * infos[i]["stranded"]  # it keeps what it was paid
            earned[i], ended = 0.0, ended + 1
    assert ended > 100


def test_a_finished_run_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = Args(out=tmp_path, missions=("OutAndBack",), learners=("dqn",), seeds=1, steps=1, episodes=4)
    main(args)
    first = capsys.readouterr()
    main(args)
    again = capsys.readouterr()
    assert "training" in first.err and not again.err
    assert first.out == again.out and "dmax_adaptive" in first.out


def test_a_recurrent_policy_remembers_until_missions_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learners, "SETTINGS", dataclasses.replace(learners.SETTINGS, epochs=1))
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
    with pytest.raises(TrainingError, match="give --learners of ppo, ppo unshaped"):
        main(Args(out=tmp_path, learners=("sarsa",)))
