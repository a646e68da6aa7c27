"""The learner's network: that of Stable-Baselines3, with the inputs passed to the last layer of the
policy."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn

from homeward.agents.trained.policy_file import Layer

_LOG_DEVIATIONS = (-0.7, -0.7, -1.8)
"""Of continuous actions, at first. Chosen: deviations of half of the range from its middle for
speed and sensing rate; go is the middle third, at two deviations, so that a stop and a return have
a probability of 2 % each."""

_VALUE_SCALE = 0.1
"""Scale of the value's hidden units, from d_max: beyond the potential a tenth of a good score is
left to learn, and steps as large as for numbers around 1 make the value noisy (docs/results.md,
What failed in training)."""


class ResidualPolicy(ActorCriticPolicy):
    """Policy and value with two hidden layers each; the policy's last layer also sees the inputs
    directly.

    So the first policy can be a linear rule of the inputs, and learning adds a residual to it
    (Johannink et al. 2019, arXiv 1812.03201).

    Args:
        *arguments: See Stable-Baselines3's class.
        hidden: Width of the hidden layers.
        first: Weight (outputs, inputs) and bias (outputs,) of the first policy.
        valued: Which inputs the value sees, bool, shape (inputs,); None: all, and it is not scaled.
        **keywords: See Stable-Baselines3's class.
    """

    def __init__(
        self,
        *arguments: Any,
        hidden: int,
        first: tuple[NDArray[np.float32], NDArray[np.float32]],
        valued: NDArray[np.bool_] | None,
        **keywords: Any,
    ) -> None:
        self._hidden = hidden
        self._valued: torch.Tensor | None = None
        if valued is not None:
            self._valued = torch.from_numpy(valued.astype(np.float32))
        super().__init__(*arguments, **keywords)
        first_weight, first_bias = first
        head = self.action_net
        assert isinstance(head, nn.Linear)
        with torch.no_grad():
            head.weight[:, hidden:] = torch.from_numpy(first_weight)
            head.bias[:] = torch.from_numpy(first_bias)
            if hasattr(self, "log_std"):
                self.log_std[:] = torch.tensor(_LOG_DEVIATIONS)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = _Layers(self.features_dim, self._hidden, self._valued)  # type: ignore[assignment]

    def learn_actions(self, learns: bool) -> None:
        """Choose whether updates change the policy, or the value only, which has to be known
        first."""
        for part in (self.mlp_extractor.policy_net, self.action_net):
            part.requires_grad_(learns)


def _two_layers(inputs: int, hidden: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, hidden), nn.Tanh(), nn.Linear(hidden, hidden), nn.Tanh())


class _Layers(nn.Module):
    """Hidden layers of policy and value; those of the policy are followed by the inputs."""

    def __init__(self, inputs: int, hidden: int, valued: torch.Tensor | None) -> None:
        super().__init__()
        self._valued = valued
        self.policy_net = _two_layers(inputs, hidden)
        self.value_net = _two_layers(inputs, hidden)
        self.latent_dim_pi = hidden + inputs
        self.latent_dim_vf = hidden

    def forward(self, inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.forward_actor(inputs), self.forward_critic(inputs)

    def forward_actor(self, inputs: torch.Tensor) -> torch.Tensor:
        return torch.cat((self.policy_net(inputs), inputs), dim=1)

    def forward_critic(self, inputs: torch.Tensor) -> torch.Tensor:
        if self._valued is None:
            return torch.as_tensor(self.value_net(inputs))
        return _VALUE_SCALE * torch.as_tensor(self.value_net(self._valued * inputs))


def layers_of(model: PPO) -> list[Layer]:
    """Weight and bias of each layer of the policy's network."""
    modules = [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
    layers = [module for module in modules if isinstance(module, nn.Linear)]
    return [
        (layer.weight.detach().cpu().numpy(), layer.bias.detach().cpu().numpy()) for layer in layers
    ]
