"""The learner: a run of whole updates, random numbers of its own, and one thread for each
library."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
import torch
from rich.console import Console
from stable_baselines3 import PPO
from threadpoolctl import threadpool_info

from homeward.agents.learning.ppo import (
    Trained,
    deployed,
    draw_anew,
    inputs_of,
    make_model,
    one_thread,
    stagger,
    train,
)
from homeward.agents.learning.settings import DivergedError, PPOSettings
from homeward.agents.trained.policy_file import load_policy
from homeward.agents.trained.run_folder import FIRST, LAST
from homeward.envs.features import INDEX, NAMES
from homeward.envs.options import Options, known_of
from homeward.envs.state import GO
from tests.agents.learning.small import OPTIONS, SETTINGS, learner, parameters, seen

pytestmark = pytest.mark.usefixtures("short_curves")


def trained(folder: Path, settings: PPOSettings = SETTINGS, steps: int = 1) -> Trained:
    console = Console(file=io.StringIO())
    more: dict[str, Any] = {
        "details": {"training": {"env": "homeward/Survey-v0"}},
        "checkpoints": 1,
        "curve": 1,
    }
    return train(OPTIONS, settings, steps, 0, folder, restore=False, console=console, **more)


@pytest.mark.parametrize(
    ("steps", "whole"), [(1, 1), (SETTINGS.rollout, 1), (SETTINGS.rollout + 1, 2)]
)
def test_steps_are_rounded_up_to_whole_updates(tmp_path: Path, steps: int, whole: int) -> None:
    assert trained(tmp_path, steps=steps).steps == whole * SETTINGS.rollout
    for folder, after in ((FIRST, 0), (LAST, whole), ("", whole)):
        description = load_policy(tmp_path / folder).description
        assert (description["steps"], description["after_steps"]) == (
            whole * SETTINGS.rollout, after * SETTINGS.rollout
        )  # fmt: skip


def test_weights_that_are_not_finite_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def diverge(model: PPO, *_: Any, **__: Any) -> None:
        with torch.no_grad():
            dict(model.policy.named_parameters())["action_net.bias"][:] = torch.nan
        raise ValueError("Expected parameter logits to satisfy the constraint")

    monkeypatch.setattr(PPO, "learn", diverge)
    with pytest.raises(
        DivergedError, match="not finite any more: train with a smaller --learning-rate"
    ) as caught:
        trained(tmp_path)
    assert "\n" not in str(caught.value)


def test_another_mistake_is_not_taken_for_divergence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise ValueError("something else")

    monkeypatch.setattr(PPO, "learn", fail)
    with pytest.raises(ValueError, match="something else") as caught:
        trained(tmp_path)
    assert not isinstance(caught.value, DivergedError)


def test_the_step_size_falls_linearly_to_a_hundredth() -> None:
    model = learner(learning_rate=0.4)
    assert [model.lr_schedule(left) for left in (1.0, 0.5, 0.1, 0.01, 0.0)] == pytest.approx(
        [0.4, 0.2, 0.04, 0.004, 0.004]
    )


def test_the_discount_is_that_of_the_shaping_too() -> None:
    model = make_model(dataclasses.replace(OPTIONS, discount=0.5), SETTINGS, 0)
    env: Any = model.get_env()
    assert model.gamma == SETTINGS.discount == env.missions.batch.known.shared["discount"][0]


def test_only_a_start_from_the_rule_has_inputs_beside_the_observation() -> None:
    known = known_of(OPTIONS)
    assert inputs_of(SETTINGS, known) is None
    assert inputs_of(dataclasses.replace(SETTINGS, start="dmax"), known) is not None
    assert seen(learner()).shape[1] == len(NAMES) < seen(learner(start="dmax")).shape[1]


def test_the_seed_decides_the_learner() -> None:
    one, same, other = (parameters(learner(seed=seed)) for seed in (3, 3, 4))
    assert all(torch.equal(one[name], same[name]) for name in one)
    assert any(not torch.equal(one[name], other[name]) for name in one)


def test_random_numbers_are_those_of_the_seed_and_the_place_in_the_run() -> None:
    model, drawn = learner(), {}
    for seed in (0, 1):
        for steps in (0, SETTINGS.rollout):
            numbers = []
            for _ in range(2):
                model.num_timesteps = steps
                draw_anew(model, seed)
                numbers.append(
                    (torch.rand(1).item(), float(seen_start(model)[0, INDEX["interest"]]))
                )
            assert numbers[0] == numbers[1]
            drawn[seed, steps] = numbers[0]
    for part in range(2):
        assert len({numbers[part] for numbers in drawn.values()}) == 4


def seen_start(model: PPO) -> Any:
    env = model.get_env()
    assert env is not None
    return env.reset()


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_the_deployed_policy_takes_the_most_likely_action_and_senses_on_the_go_alone(
    action_type: str,
) -> None:
    options = Options("Survey", decision_s=120.0, action_type=action_type)
    model = make_model(options, SETTINGS, 0)
    inputs = seen(model)
    expected, _ = model.predict(inputs, deterministic=True)
    actions = deployed(model, None).act(inputs, np.ones(len(inputs), np.bool_))
    np.testing.assert_allclose(actions[:, [0, 2]], expected[:, [0, 2]], atol=1e-5)
    if action_type == "discrete":
        assert (actions[actions[:, 2] != GO, 1] == 0).all()


@pytest.mark.parametrize("fails", [False, True])
def test_each_library_has_one_thread_and_then_its_own_again(fails: bool) -> None:
    def threads() -> list[int]:
        blas = [one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"]
        return [torch.get_num_threads(), numba.get_num_threads(), *blas]

    before = threads()
    try:
        with one_thread():
            assert set(threads()) == {1}
            if fails:
                raise ArithmeticError
    except ArithmeticError:
        pass
    assert threads() == before


def test_training_begins_with_missions_at_all_stages() -> None:
    settings = PPOSettings(n_envs=64, n_steps=8, batch_size=64, hidden=8)
    model = make_model(Options("Survey"), settings, seed=0)
    with one_thread():
        stagger(model)
    assert isinstance(model._last_obs, np.ndarray)
    assert len(np.unique(model._last_obs[:, INDEX["time"]])) > 20
