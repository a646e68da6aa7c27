"""The benchmark of the asymmetric critic: the truth reaches the value and nothing else."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.agents import learn
from benchmarks.agents.asymmetric import HIDDEN, Args, asymmetric, hidden, main
from homeward.agents.evaluation import learning_curve as curve
from homeward.agents.learning.network import layers_of
from homeward.agents.learning.ppo import make_model
from homeward.agents.learning.sb3_adapter import SB3Adapter
from homeward.agents.learning.settings import PPOSettings, TrainingError
from homeward.envs.options import Options

TINY = PPOSettings(n_envs=8, n_steps=4, batch_size=16)


def test_the_truth_reaches_the_value_and_not_the_policy() -> None:
    plain = make_model(Options("Survey"), TINY, 0)
    with asymmetric():
        model = make_model(Options("Survey"), TINY, 0)
    env = model.get_env()
    assert env is not None and model.policy.observation_space.shape is not None
    inputs = torch.as_tensor(np.asarray(env.reset()))
    assert inputs.shape[1] == model.policy.observation_space.shape[0]
    other = inputs.clone()
    other[:, -len(HIDDEN) :] += 1.0
    with torch.no_grad():
        assert not torch.equal(model.policy.predict_values(inputs), model.policy.predict_values(other))
        actions = torch.zeros((len(inputs), 3))
        first, second = (model.policy.get_distribution(one).log_prob(actions) for one in (inputs, other))
        assert torch.equal(first, second)
    assert [weight.shape for weight, _ in layers_of(model)] == [weight.shape for weight, _ in layers_of(plain)]


def test_what_the_value_sees_is_true() -> None:
    with asymmetric():
        env = make_model(Options("OutAndBack"), TINY, 0).get_env()
    assert isinstance(env, SB3Adapter)
    seen = np.asarray(env.reset())
    batch = env.env.batch
    truth = hidden(batch)
    np.testing.assert_array_equal(seen[:, -len(HIDDEN) :], truth)
    usable_j = float(batch.known.shared["usable_j"][0])
    np.testing.assert_allclose(truth[:, 0], batch.records["energy_j"] / usable_j, rtol=1e-6)
    np.testing.assert_allclose(truth[:, 1], truth[:, 0])  # at home, nothing is needed to get there
    assert len(np.unique(truth[:, 3])) == len(truth)  # each mission has a robot of its own


def test_both_are_trained_and_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(curve, "EPISODES", 5)
    monkeypatch.setattr(learn, "PPOSettings", partial(PPOSettings, n_envs=8, n_steps=4, batch_size=16))
    args = Args(tmp_path / "seeing", tmp_path / "learn", ("OutAndBack",), seeds=1, steps=1, episodes=6)
    main(args)
    told = capsys.readouterr().out
    assert "with minus without" in told and "last" in told
    folders = [tmp_path / name / "OutAndBack-uncertain-dmax-0" / "last" for name in ("seeing", "learn")]
    assert len({(folder / "policy.safetensors").read_bytes() for folder in folders}) == 2


def test_too_little_to_compare_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="give at least 1 seed and 2 episodes"):
        main(Args(out=tmp_path, seeds=0))
