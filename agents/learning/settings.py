"""What a training run is made with; free of torch, so that options can be read and checked before it is loaded."""

from __future__ import annotations

from dataclasses import dataclass

from homeward.agents.learning.guide import GUIDES, PLANNER

_MOST_HIDDEN = 4096  # 17 million weights in the second layer


class TrainingError(ValueError):
    """A training run that cannot be made or continued; the message says what to change."""


@dataclass(frozen=True)
class PPOSettings:
    """Settings of proximal policy optimisation (Schulman et al. 2017, arXiv 1707.06347)."""

    guide: str = PLANNER
    """What the policy starts from and sees the proposals of: planner, dmax_adaptive, or none."""
    insight: bool = True
    """Whether the critic sees what is hidden and the route ahead while the policy learns."""
    n_envs: int = 512
    """Missions side by side."""
    n_steps: int = 32
    """Decisions of each mission between two updates."""
    batch_size: int = 2048
    """Decisions in a gradient step; divides n_envs times n_steps."""
    epochs: int = 4
    """Passes over the decisions in an update."""
    learning_rate: float = 1e-4
    """Step size of Adam at the start; it falls linearly to a hundredth."""
    discount: float = 0.9995
    """Discount factor, also of the shaping; the way home is about a hundred decisions long and must still count."""
    gae_lambda: float = 0.95
    """How far advantages look ahead (generalised advantage estimation)."""
    clip: float = 0.2
    """How far an update may move the probability of an action."""
    entropy: float = 0.0
    """Weight of the entropy bonus."""
    stranding_cost: float = 0.5
    """Reward lost by stranding beyond the score, as a share of a good score: without it, gambling pays too well."""
    hidden: int = 128
    """Width of the two hidden layers, of the policy and of the value."""
    device: str = "cpu"
    """Torch device: cpu, cuda or auto; a network this small is fastest on the cpu."""

    def __post_init__(self) -> None:
        if self.guide not in GUIDES:
            raise TrainingError(f"guide = {self.guide!r} is not allowed; choose from {', '.join(GUIDES)}")
        for name in ("n_envs", "n_steps", "batch_size", "epochs", "hidden"):
            if getattr(self, name) < 1:
                raise TrainingError(f"{name} = {getattr(self, name)} is not allowed; give a whole number of at least 1")
        if self.hidden > _MOST_HIDDEN:
            raise TrainingError(f"hidden = {self.hidden} is not allowed; give at most {_MOST_HIDDEN}")
        for name, low, high in (
            ("learning_rate", 0.0, 1.0),
            ("discount", 0.0, 1.0),
            ("gae_lambda", 0.0, 1.0),
            ("clip", 0.0, 1.0),
        ):
            if not low < getattr(self, name) <= high:
                raise TrainingError(
                    f"{name} = {getattr(self, name)} is not allowed; give a number in ({low:g}, {high:g}]"
                )
        for name in ("entropy", "stranding_cost"):
            if not 0.0 <= getattr(self, name) <= 100.0:
                raise TrainingError(f"{name} = {getattr(self, name)} is not allowed; give a number in [0, 100]")
        if self.batch_size < 2 or self.rollout % self.batch_size:
            raise TrainingError(
                f"batch_size = {self.batch_size} does not divide n_envs * n_steps = {self.rollout} into whole batches"
            )
        if self.device not in ("cpu", "cuda", "auto"):
            raise TrainingError(f"device = {self.device!r} is not allowed; choose from cpu, cuda, auto")

    @property
    def rollout(self) -> int:
        """Decisions between two updates."""
        return self.n_envs * self.n_steps
