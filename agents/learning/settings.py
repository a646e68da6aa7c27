"""Settings of a training run, without torch, so that they can be read and checked before it is
loaded."""

from __future__ import annotations

from dataclasses import dataclass

from homeward.agents.trained.run_folder import TrainingError as TrainingError

SCRATCH, DMAX = "scratch", "dmax"
STARTS = (SCRATCH, DMAX)
VALUE_FIRST = 6
"""First updates that train the value only: an untrained value would destroy the first policy.
Chosen: 384 decisions of each mission, three times as many as a mission has."""
_MOST_HIDDEN = 4096  # chosen: bounds memory, with 17 million weights in the second layer
_MOST_ROLLOUT = 2**24  # decisions between updates; chosen: bounds memory to some 4 GB of inputs

_BY_START = {
    SCRATCH: {"learning_rate": 3e-3, "entropy": 0.0},
    DMAX: {"learning_rate": 2e-3, "entropy": 0.003},
}
"""Defaults by start. The bonus keeps exploration from d_max and harms from nothing
(docs/results.md, What failed in training). On surveys from a rule, with a step size of 1e-3 instead
of 3e-3 an update changed hardly any choice (0.2 to 2 % were clipped; one training seed,
docs/learning.md at commit 2fa234d). 2e-3 and 3e-3 are chosen. Patrols from d_max score 17.80 with
2e-3, 0.4 % more with half of it and 0.3 % less with twice (a million decisions, one training seed,
the same 1,000 missions; paired standard errors 0.1 and 0.3 %); the first policy scores 17.86.
Surveys were not compared."""


class DivergedError(TrainingError):
    """A training run whose weights are not finite any more."""


def check_seed(seed: int) -> None:
    """Refuse a seed that the libraries do not accept.

    Raises:
        TrainingError: It is below 0 or does not fit into 32 bits.
    """
    if not 0 <= seed < 2**32:
        raise TrainingError(
            f"seed = {seed} is not allowed; give a whole number from 0 to {2**32 - 1}"
        )


@dataclass(frozen=True)
class PPOSettings:
    """Settings of proximal policy optimisation (Schulman et al. 2017, arXiv 1707.06347)."""

    start: str = DMAX
    """dmax: the first policy is the d_max rule, and the belief is an input; scratch: only the
    observation, no rule."""
    n_envs: int = 512
    """Missions side by side. Chosen: with n_steps 32,768 decisions an update, 91 updates in 3
    million. Patrols score 0.3 % more with 256 or 1024 (one training seed)."""
    n_steps: int = 64
    """Decisions of each mission between two updates; with 16 or 32 surveys score less
    (docs/results.md)."""
    batch_size: int = 4096
    """Decisions in a gradient step; divides n_envs times n_steps. Chosen: eight steps a pass."""
    epochs: int = 4
    """Passes over the decisions in an update. Chosen: the paper takes 3 to 15 (its appendix A).
    Patrols score 0.2 to 0.3 % more with 2 or 8 (one training seed, standard error 0.2 %)."""
    learning_rate: float | None = None
    """Step size of Adam at the start; it falls linearly to a hundredth. By default 2e-3 from dmax,
    otherwise 3e-3."""
    discount: float = 0.9997
    """Discount factor, also of the shaping; the way home takes about a hundred decisions and must
    still count."""
    gae_lambda: float = 0.98
    """Lambda of generalised advantage estimation; with 0.9 patrols are unlearned from dmax
    (docs/results.md)."""
    clip: float = 0.2
    """Clip range: largest change of an action's probability ratio in an update, as in the paper."""
    entropy: float | None = None
    """Weight of the entropy bonus at the start; it falls to 0. By default 0.003 from dmax, 0 from
    scratch."""
    stranding_cost: float = 0.5
    """Penalty of stranding beyond the lost score, as a share of a good score: without it, risky
    policies score too well."""
    hidden: int = 64
    """Width of the two hidden layers, of the policy and of the value; 64 as in the paper."""

    def __post_init__(self) -> None:
        if self.start not in STARTS:
            raise TrainingError(
                f"start = {self.start!r} is not allowed; choose from {', '.join(STARTS)}"
            )
        for name in ("n_envs", "n_steps", "batch_size", "epochs", "hidden"):
            if getattr(self, name) < 1:
                raise TrainingError(
                    f"{name} = {getattr(self, name)} is not allowed; give a whole number of at least 1"
                )
        if self.hidden > _MOST_HIDDEN:
            raise TrainingError(
                f"hidden = {self.hidden} is not allowed; give at most {_MOST_HIDDEN}"
            )
        shares = {"discount": self.discount, "gae_lambda": self.gae_lambda, "clip": self.clip}
        for name, value in (shares | self.by_start).items():
            if not (0.0 < value <= 1.0 or (name == "entropy" and value == 0.0)):
                allowed = "[0, 1]" if name == "entropy" else "(0, 1]"
                raise TrainingError(f"{name} = {value} is not allowed; give a number in {allowed}")
        if not 0.0 <= self.stranding_cost <= 100.0:
            raise TrainingError(
                f"stranding_cost = {self.stranding_cost} is not allowed; give a number in [0, 100]"
            )
        if self.rollout > _MOST_ROLLOUT:
            raise TrainingError(
                f"n_envs * n_steps = {self.rollout} is not allowed; give at most {_MOST_ROLLOUT:,}"
            )
        if self.batch_size < 2 or self.rollout % self.batch_size:
            raise TrainingError(
                f"batch_size = {self.batch_size} does not divide n_envs * n_steps = {self.rollout} into whole batches"
            )

    @property
    def by_start(self) -> dict[str, float]:
        """Settings whose defaults depend on the start, as given or by default."""
        settings = {name: getattr(self, name) for name in _BY_START[self.start]}
        return _BY_START[self.start] | {
            name: value for name, value in settings.items() if value is not None
        }

    def too_few(self, steps: int) -> str | None:
        """A line that says so if a run of so many steps leaves the policy as it is at first; None
        otherwise."""
        fewest = VALUE_FIRST * self.rollout
        if steps > fewest:
            return None
        return (
            f"{steps:,} steps are too few to learn anything: the first {VALUE_FIRST} updates train the value only, so "
            f"the policy stays as it begins; give more than {fewest:,} steps"
        )

    @property
    def rollout(self) -> int:
        """Decisions between two updates."""
        return self.n_envs * self.n_steps
