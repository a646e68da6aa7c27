"""The benchmark of plain PPO: only the discount differs from the defaults, and no seed is trained
twice."""

import json
from pathlib import Path

import pytest
from stable_baselines3 import PPO

from benchmarks.agents import plain_ppo
from benchmarks.agents.plain_ppo import SIDE_BY_SIDE, Args, main, make_model
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.agents.learning.settings import TrainingError
from homeward.envs.options import Options


def test_only_the_discount_differs_from_the_defaults() -> None:
    options = Options("OutAndBack")
    model = make_model(options, 2)
    assert model.gamma == options.discount == 0.9995
    assert model.env is not None and model.env.num_envs == SIDE_BY_SIDE
    default = PPO("MlpPolicy", model.env, device="cpu")
    for name in (
        "n_steps",
        "batch_size",
        "n_epochs",
        "gae_lambda",
        "ent_coef",
        "vf_coef",
        "max_grad_norm",
        "policy_kwargs",
    ):
        assert getattr(model, name) == getattr(default, name)
    assert model.lr_schedule(1.0) == default.lr_schedule(1.0)
    assert str(model.policy) == str(default.policy)


def test_no_two_seeds_share_a_mission() -> None:
    keys = []
    for seed in (0, 1):
        adapter = make_model(Options("OutAndBack"), seed).env
        assert isinstance(adapter, SB3Adapter)
        adapter.reset()
        keys += [
            json.dumps(one.bit_generator.state, default=str)
            for one in adapter.missions.batch.generators
        ]
    assert len(set(keys)) == 2 * SIDE_BY_SIDE


def test_rows_are_printed_and_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PPO, "learn", lambda model, steps: model)
    args = Args(seeds=2, steps=1, episodes=8, out=tmp_path)
    main(args)
    first = capsys.readouterr().out
    runs = json.loads((tmp_path / "plain_ppo.json").read_text())["results"]
    assert list(runs) == ["seed 0", "seed 1"]
    for expected in ("seed 1, greedy", "seed 1, sampled", "8 unseen missions"):
        assert expected in first
    assert runs["seed 0"]["greedy"] != runs["seed 0"]["sampled"]
    monkeypatch.setattr(plain_ppo, "run_seed", None)
    monkeypatch.setattr(plain_ppo, "run_episodes", None)
    main(args)
    assert capsys.readouterr().out == first


def test_nothing_to_train_is_refused() -> None:
    with pytest.raises(TrainingError, match="give at least 1 of --seeds and --steps"):
        main(Args(seeds=0))
