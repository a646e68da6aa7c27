"""The learner's network: a linear rule of the inputs with a residual, and a value that learns
first."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch

from homeward.agents.learning.network import ResidualPolicy, layers_of
from homeward.agents.learning.ppo import inputs_of, make_model
from homeward.agents.learning.settings import PPOSettings
from homeward.agents.trained.inputs import first_policy
from homeward.envs.features import INDEX
from homeward.envs.options import Options, known_of
from tests.agents.learning.small import OPTIONS, SETTINGS, learner, seen

CONTINUOUS = Options("Survey", decision_s=120.0, action_type="continuous")


def test_layers_are_two_hidden_ones_and_one_that_sees_the_inputs_too() -> None:
    model = learner()
    inputs, hidden, outputs = seen(model).shape[1], SETTINGS.hidden, 13
    shapes = [(weight.shape, bias.shape) for weight, bias in layers_of(model)]
    assert shapes == [
        ((hidden, inputs), (hidden,)), ((hidden, hidden), (hidden,)), ((outputs, hidden + inputs), (outputs,))
    ]  # fmt: skip


@pytest.mark.parametrize("options", [OPTIONS, CONTINUOUS], ids=["discrete", "continuous"])
def test_outputs_are_those_of_the_layers(options: Options) -> None:
    model = learner(options)
    inputs = seen(model)
    first, second, last = layers_of(model)
    hidden = np.tanh(np.tanh(inputs @ first[0].T + first[1]) @ second[0].T + second[1])
    outputs = np.concatenate((hidden, inputs), axis=1) @ last[0].T + last[1]
    distribution: Any = model.policy.get_distribution(torch.from_numpy(inputs)).distribution
    if options is CONTINUOUS:
        np.testing.assert_allclose(distribution.mean.detach(), outputs, atol=1e-5)
    else:
        for part, ends in zip(distribution, ((0, 5), (5, 10), (10, 13)), strict=True):
            scores = outputs[:, slice(*ends)]
            log_likely = scores - np.log(np.exp(scores).sum(axis=1, keepdims=True))
            np.testing.assert_allclose(part.logits.detach(), log_likely, atol=1e-5)


@pytest.mark.parametrize("start", ["scratch", "dmax"])
def test_the_policy_begins_as_the_linear_rule(start: str) -> None:
    settings = PPOSettings(start=start, n_envs=8, n_steps=4, batch_size=32, hidden=8)
    model, known = make_model(OPTIONS, settings, 0), known_of(OPTIONS)
    weight, bias = first_policy(known, inputs_of(settings, known))
    last_weight, last_bias = layers_of(model)[-1]
    np.testing.assert_array_equal(last_weight[:, settings.hidden :], weight)
    np.testing.assert_array_equal(last_bias, bias)
    assert np.abs(last_weight[:, : settings.hidden]).max() < 0.05  # the residual is small


def test_a_stop_and_a_return_are_tried_by_a_policy_that_goes() -> None:
    """Go is the middle third; each of the others has the tail of a normal distribution."""
    model = learner(CONTINUOUS)
    assert isinstance(model.policy, ResidualPolicy)
    speed, sensing, mode = model.policy.log_std.detach().exp().tolist()
    assert speed == sensing == pytest.approx(0.5, abs=0.01)
    assert 0.5 * math.erfc(1.0 / 3.0 / mode / math.sqrt(2.0)) == pytest.approx(0.02, abs=0.003)


@pytest.mark.parametrize("learns", [False, True])
def test_updates_change_the_policy_or_the_value_only(learns: bool) -> None:
    model = learner()
    policy = model.policy
    assert isinstance(policy, ResidualPolicy)
    policy.learn_actions(not learns)
    policy.learn_actions(learns)
    values, log_likely, entropy = policy.evaluate_actions(
        torch.from_numpy(seen(model)), torch.zeros((SETTINGS.n_envs, 3), dtype=torch.int64)
    )
    assert entropy is not None
    torch.autograd.backward(values.sum() + log_likely.sum() + entropy.sum())
    with_gradient = (name for name, one in policy.named_parameters() if one.grad is not None)
    changed = {name.removeprefix("mlp_extractor.").split(".")[0] for name in with_gradient}
    assert changed == {"value_net"} | ({"policy_net", "action_net"} if learns else set())


def test_from_scratch_the_value_is_not_scaled_and_sees_all() -> None:
    model = learner()
    inputs, extractor = torch.from_numpy(seen(model)), model.policy.mlp_extractor
    assert torch.equal(extractor.forward_critic(inputs), extractor.value_net(inputs))


def test_from_the_rule_the_value_is_a_tenth() -> None:
    model = learner(start="dmax")
    hidden = model.policy.mlp_extractor.forward_critic(torch.from_numpy(seen(model)))
    assert 0.0 < hidden.abs().max() <= 0.1  # of what tanh gives


def test_the_value_sees_nothing_fleeting() -> None:
    model = make_model(
        Options("Survey"), PPOSettings(n_envs=4, n_steps=4, batch_size=16, hidden=8), seed=0
    )
    env = model.get_env()
    assert env is not None
    seen = torch.from_numpy(np.asarray(env.reset()).copy())
    other = seen.clone()
    other[:, [INDEX["power"], INDEX["interest"], INDEX["interest_1"], INDEX["grade"]]] += 1.0
    assert (model.policy.predict_values(other) == model.policy.predict_values(seen)).all()
    other[:, INDEX["consumption"]] += 1.0
    assert (model.policy.predict_values(other) != model.policy.predict_values(seen)).all()
