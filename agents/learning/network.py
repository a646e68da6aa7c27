"""The learner's network: Stable-Baselines3's, with a guide's proposal handed on to the last layer."""

from __future__ import annotations

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn

from homeward.agents.learning.policy_file import Layer
from homeward.envs.actions import LEVELS

_MODE_LOGITS = (-1.5, 2.0, -2.2)  # stop 3 %, go 96 %, return 1.4 %: back after about 70 decisions
_LOG_DEVIATIONS = (-0.7, -0.7, -1.8)  # continuous: go is the middle third, so as rarely beside it
# Exploring costs energy, and one sensing too many on the way home may be the last: a policy that tries much learns to
# leave room for its own trials, and turns back early.
_TRUST = (8.0, 8.0)  # the proposed speed and sensing rate: 99.9 % each
_TRUST_STOP, _TRUST_RETURN = 5.0, 10.0  # per unit of the proposal: return 0.005 % while the rule is sure to go on
_STOP = -3.0  # stop 0.03 % where the rule goes on, 88 % where it stops


class GuidedPolicy(ActorCriticPolicy):
    """Policy and value, two hidden layers each, of which the first policy does as the rule proposes, mostly.

    Args:
        *arguments: See Stable-Baselines3's class.
        hidden: Width of the hidden layers.
        insight: Number of the first inputs, which only the value sees.
        proposals: Number of the last inputs, which the policy's last layer sees as they are (a residual on the rule,
            Johannink et al. 2019, arXiv 1812.03201); 0 where there is no rule.
        **keywords: See Stable-Baselines3's class.
    """

    def __init__(self, *arguments: Any, hidden: int, insight: int, proposals: int, **keywords: Any) -> None:
        self._hidden, self._insight, self._proposals = hidden, insight, proposals
        super().__init__(*arguments, **keywords)
        with torch.no_grad():
            self._begin()

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = _Layers(self.features_dim, self._hidden, self._insight, self._proposals)  # type: ignore[assignment]

    def _begin(self) -> None:
        """Let the first policy follow the rule; or let it mostly go on: one that may turn back at every decision hardly
        ever gets anywhere by chance."""
        head = self.action_net
        assert isinstance(head, nn.Linear)
        if not isinstance(self.action_space, spaces.MultiDiscrete):
            self.log_std[:] = torch.tensor(_LOG_DEVIATIONS)
            if self._proposals:
                head.weight[:, -self._proposals :] = torch.eye(self._proposals)
        elif self._proposals:
            trust = [_TRUST[0]] * LEVELS + [_TRUST[1]] * LEVELS + [_TRUST_STOP, 0.0, _TRUST_RETURN]
            head.weight[:, -self._proposals :] = torch.diag(torch.tensor(trust))
            head.bias[-3] = _STOP
        else:
            head.bias[-3:] = torch.tensor(_MODE_LOGITS)


class _Layers(nn.Module):
    """Hidden layers of policy and value; behind those of the policy stand the proposals."""

    def __init__(self, inputs: int, hidden: int, insight: int, proposals: int) -> None:
        super().__init__()
        self._insight, self._proposals = insight, proposals
        self.policy_net, self.value_net = (
            nn.Sequential(nn.Linear(seen, hidden), nn.Tanh(), nn.Linear(hidden, hidden), nn.Tanh())
            for seen in (inputs - insight, inputs)
        )
        self.latent_dim_pi, self.latent_dim_vf = hidden + proposals, hidden

    def forward(self, inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.forward_actor(inputs), self.forward_critic(inputs)

    def forward_actor(self, inputs: torch.Tensor) -> torch.Tensor:
        hidden: torch.Tensor = self.policy_net(inputs[:, self._insight :])
        return torch.cat((hidden, inputs[:, -self._proposals :]), dim=1) if self._proposals else hidden

    def forward_critic(self, inputs: torch.Tensor) -> torch.Tensor:
        values: torch.Tensor = self.value_net(inputs)
        return values


def layers_of(model: PPO) -> list[Layer]:
    """Weight and bias of each layer of the policy's network."""
    hidden = [module for module in model.policy.mlp_extractor.policy_net if isinstance(module, nn.Linear)]
    layers = [*hidden, _head(model)]
    return [(layer.weight.detach().cpu().numpy(), layer.bias.detach().cpu().numpy()) for layer in layers]


def _head(model: PPO) -> nn.Linear:
    head = model.policy.action_net
    assert isinstance(head, nn.Linear)
    return head
