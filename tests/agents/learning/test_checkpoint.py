"""Checkpoints: a restored learner goes on as the one that was saved, and numbers that are no
checkpoint are refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.numpy import load, save
from stable_baselines3 import PPO

from homeward.agents.learning.checkpoint import Best, restore_checkpoint, save_checkpoint
from homeward.agents.learning.network import layers_of
from homeward.agents.learning.ppo import draw_anew, one_thread, stagger
from homeward.agents.learning.settings import TrainingError
from homeward.agents.trained.run_folder import CHECKPOINT, PREVIOUS
from tests.agents.learning.small import SETTINGS, learner, parameters

MOST = 3 * SETTINGS.rollout


@pytest.fixture(scope="module")
def trained() -> PPO:
    """A learner after one update."""
    model = learner()
    with one_thread():
        model.learn(SETTINGS.rollout)
    return model


@pytest.fixture(scope="module")
def saved(trained: PPO, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with its checkpoint, whose best policy is that of another learner."""
    folder = tmp_path_factory.mktemp("saved")
    layers = [(weight.copy(), bias.copy()) for weight, bias in layers_of(learner(seed=5))]
    save_checkpoint(trained, Best(SETTINGS.rollout, 12.5, layers), folder)
    return folder


def averages(model: PPO) -> dict[int, dict[str, torch.Tensor]]:
    return dict(model.policy.optimizer.state_dict()["state"])


def test_what_is_restored_is_what_was_saved(trained: PPO, saved: Path) -> None:
    model = learner(seed=1)
    best = restore_checkpoint(model, saved, MOST)
    ours, theirs = parameters(model), parameters(trained)
    assert (
        all(torch.equal(ours[name], theirs[name]) for name in theirs)
        and ours.keys() == theirs.keys()
    )
    assert averages(trained).keys() == averages(model).keys() != set()
    for index, state in averages(trained).items():
        assert all(
            torch.equal(averages(model)[index][name], value) for name, value in state.items()
        )
    assert (model.num_timesteps, model._n_updates) == (SETTINGS.rollout, SETTINGS.epochs)
    assert best is not None and (best.steps, best.score) == (SETTINGS.rollout, 12.5)
    for (weight, bias), (expected_weight, expected_bias) in zip(
        best.layers, layers_of(learner(seed=5)), strict=True
    ):
        np.testing.assert_array_equal(weight, expected_weight)
        np.testing.assert_array_equal(bias, expected_bias)


def test_a_restored_learner_goes_on_as_the_one_that_was_saved(tmp_path: Path) -> None:
    original, restored = learner(), learner(seed=1)
    with one_thread():
        original.learn(SETTINGS.rollout)
        save_checkpoint(original, None, tmp_path)
        assert restore_checkpoint(restored, tmp_path, MOST) is None
        for model in (original, restored):
            draw_anew(model, 0)
            stagger(model)
            model.learn(SETTINGS.rollout, reset_num_timesteps=False)
    ours, theirs = parameters(restored), parameters(original)
    assert all(torch.equal(ours[name], theirs[name]) for name in theirs)


def test_an_untrained_learner_can_be_saved(tmp_path: Path) -> None:
    save_checkpoint(learner(), None, tmp_path)
    model = learner(seed=1)
    assert restore_checkpoint(model, tmp_path, MOST) is None
    assert (model.num_timesteps, averages(model)) == (0, {})


Spoiled = Callable[[dict[str, Any], dict[str, Any]], object]


def spoilt(saved: Path, folder: Path, spoil: Spoiled) -> Path:
    """A folder with the checkpoint, changed."""
    tensors = {
        name: value.copy() for name, value in load((saved / CHECKPOINT).read_bytes()).items()
    }
    with safe_open(saved / CHECKPOINT, "np") as file:
        header = json.loads(file.metadata()["homeward"])
    spoil(tensors, header)
    (folder / CHECKPOINT).write_bytes(save(tensors, {"homeward": json.dumps(header)}))
    return folder


def test_a_checkpoint_is_read_if_nothing_is_spoilt(saved: Path, tmp_path: Path) -> None:
    assert (
        restore_checkpoint(learner(), spoilt(saved, tmp_path, lambda tensors, header: None), MOST)
        is not None
    )


@pytest.mark.parametrize(
    "spoil",
    [
        lambda tensors, header: tensors["policy.action_net.bias"].fill(np.nan),
        lambda tensors, header: tensors.update({"policy.action_net.bias": np.zeros(3, np.float32)}),
        lambda tensors, header: tensors.update({"policy.action_net.bias": np.zeros(13)}),
        lambda tensors, header: tensors["policy.value_net.weight"].fill(1e20),
        lambda tensors, header: tensors.pop("policy.action_net.bias"),
        lambda tensors, header: tensors.update({"policy.more": np.zeros(1, np.float32)}),
        lambda tensors, header: tensors["optimizer.0.exp_avg_sq"].fill(-1.0),
        lambda tensors, header: tensors["optimizer.0.exp_avg"].fill(np.nan),
        lambda tensors, header: tensors.pop("optimizer.0.exp_avg"),
        lambda tensors, header: tensors.update({"optimizer.99.step": np.zeros((), np.float32)}),
        lambda tensors, header: header.update(schema=99),
        lambda tensors, header: header.update(steps=-SETTINGS.rollout),
        lambda tensors, header: header.update(steps=MOST + SETTINGS.rollout),
        lambda tensors, header: header.update(steps=SETTINGS.rollout + 1),
        lambda tensors, header: header.update(steps=float(SETTINGS.rollout)),
        lambda tensors, header: header.update(pad="x" * 2_000_000),
        lambda tensors, header: header["best"].update(steps="many"),
        lambda tensors, header: header["best"].update(steps=0),
        lambda tensors, header: header["best"].update(steps=2 * SETTINGS.rollout),
        lambda tensors, header: header["best"].update(score=float("nan")),
        lambda tensors, header: tensors.update({"best.0.weight": np.zeros((1, 1), np.float32)}),
    ],
)
def test_numbers_that_are_no_checkpoint_are_refused(
    saved: Path, tmp_path: Path, spoil: Spoiled
) -> None:
    model = learner(seed=1)
    before = parameters(model)
    with pytest.raises(
        TrainingError, match="no checkpoint that can be read: delete it, or choose another --out"
    ):
        restore_checkpoint(model, spoilt(saved, tmp_path, spoil), MOST)
    after = parameters(model)
    # checked before any is used
    assert all(torch.equal(after[name], before[name]) for name in before)
    assert model.num_timesteps == 0 and averages(model) == {}


def test_a_checkpoint_of_another_network_is_refused(saved: Path) -> None:
    with pytest.raises(TrainingError, match="no checkpoint that can be read"):
        restore_checkpoint(learner(hidden=9), saved, MOST)


def test_the_one_before_serves_where_the_latest_is_damaged(
    trained: PPO, saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / PREVIOUS).write_bytes((saved / CHECKPOINT).read_bytes())
    (tmp_path / CHECKPOINT).write_bytes((saved / CHECKPOINT).read_bytes()[:1000])
    model = learner(seed=1)
    restore_checkpoint(model, tmp_path, MOST)
    assert model.num_timesteps == trained.num_timesteps
    said = capsys.readouterr().err
    assert said.startswith(f"{tmp_path / CHECKPOINT} cannot be read (") and said.count("\n") == 1


def test_a_folder_without_checkpoints_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="no checkpoint that can be read"):
        restore_checkpoint(learner(), tmp_path, MOST)
