"""All agents by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from homeward.agents.base import Policy
from homeward.agents.learning.settings import DMAX, SCRATCH
from homeward.agents.planner import Planner
from homeward.agents.rules.dmax import DmaxRule
from homeward.agents.rules.dmax_adaptive import AdaptiveDmaxRule
from homeward.agents.rules.dmax_belief import BeliefDmaxRule
from homeward.agents.rules.dmax_mapped import MappedDmaxRule
from homeward.agents.rules.random_policy import RandomPolicy
from homeward.agents.rules.reserves import pace_of, reserve_of
from homeward.agents.rules.soc50 import StateOfChargeRule
from homeward.envs.actions import action_space
from homeward.envs.batch import observation_space
from homeward.envs.options import Known


class AgentError(ValueError):
    """An agent that cannot be made; the message says what is allowed."""


@dataclass(frozen=True)
class Request:
    """Arguments of a loader.

    Attributes:
        known: Constants of the environment.
        file: File to load, or None.
        seed: Seed of random agents.
        reserve: Reserve in the agent's own measure, instead of the tuned one.
    """

    known: Known
    file: Path | None = None
    seed: int = 0
    reserve: float | None = None


def _random(request: Request) -> Policy:
    return RandomPolicy(
        action_space(bool(request.known.shared["discrete"][0])), np.random.default_rng(request.seed)
    )


def _soc50(request: Request) -> Policy:
    pace = pace_of(request.known.mission)
    if request.reserve is None:
        return StateOfChargeRule(request.known, pace)
    return StateOfChargeRule(request.known, pace, request.reserve)


def _tuned(name: str, rule: Callable[..., Policy]) -> Callable[[Request], Policy]:
    def load(request: Request) -> Policy:
        return rule(request.known, pace_of(request.known.mission), _reserve(name, request))

    return load


def _planner(request: Request) -> Policy:
    return Planner(request.known, _reserve("planner", request))


def _reserve(name: str, request: Request) -> float:
    if request.reserve is None:
        return reserve_of(name, request.known.mission)
    return request.reserve


def _trained(start: str) -> Callable[[Request], Policy]:
    def load(request: Request) -> Policy:
        from homeward.agents.trained.policy_file import PolicyFileError, load_policy

        try:
            policy = load_policy(
                request.file or shipped(request.known.mission, start), request.known
            )
            has_docks = bool(request.known.shared["dock_count"][0])
            policy.check_spaces(
                observation_space(has_docks),
                action_space(bool(request.known.shared["discrete"][0])),
            )
        except PolicyFileError as error:
            raise AgentError(str(error)) from None
        return policy

    return load


def shipped(mission: str, start: str) -> Path:
    """Folder of the shipped policy of a mission, by its start: `dmax` or `scratch`."""
    if start == DMAX:
        return SHIPPED / mission
    return SHIPPED / f"{mission}_{start}"


AGENTS: dict[str, Callable[[Request], Policy]] = {
    "random": _random,
    "soc50": _soc50,
    "dmax": _tuned("dmax", DmaxRule),
    "dmax_mapped": _tuned("dmax_mapped", MappedDmaxRule),
    "dmax_adaptive": _tuned("dmax_adaptive", AdaptiveDmaxRule),
    "dmax_belief": _tuned("dmax_belief", BeliefDmaxRule),
    "planner": _planner,
    "ppo": _trained(DMAX),
    "ppo_scratch": _trained(SCRATCH),
}
"""Loader of each agent."""

_SHARES = tuple(np.linspace(0.0, 0.44, 12).round(2))
_DEVIATIONS = tuple(np.linspace(0.0, 5.5, 12))
SWEPT: dict[str, tuple[float, ...]] = {
    "soc50": tuple(np.linspace(0.35, 0.9, 12).round(2)),
    "dmax": _SHARES,
    "dmax_mapped": _SHARES,
    "dmax_adaptive": _DEVIATIONS,
    "dmax_belief": _DEVIATIONS,
    "planner": _DEVIATIONS,
}
"""Reserves that are tried for agents with one, equally many for each. Chosen: even steps, from none
to beyond those of highest score (`homeward.agents.rules.reserves`)."""

FROM_FILES = frozenset({"ppo", "ppo_scratch"})
"""Agents that accept a file."""

SHIPPED = Path(__file__).parent / "policies"
"""Trained policies that ship, see `shipped`; each has a card that describes its training."""


def _of_factory(path: str, known: Known) -> Policy:
    module, _, name = path.partition(":")
    try:
        policy = getattr(importlib.import_module(module), name)(known)
    except (ImportError, AttributeError) as error:
        raise AgentError(
            f"{path}: {error}; give package.module:factory, from a folder that Python looks in"
        ) from None
    if not isinstance(policy, Policy):
        raise AgentError(f"{path} returns a {type(policy).__name__}, not a homeward.agents.Policy")
    return policy


def make_policy(
    name: str, env: Any, file: str | Path | None = None, seed: int = 0, reserve: float | None = None
) -> Policy:
    """Make an agent for an environment.

    Args:
        name: One of `AGENTS`.
        env: A `homeward` environment, scalar or vector, wrapped or not; only what its robot can
            know is used.
        file: Folder of a trained policy, instead of the shipped one; for another name
            `package.module:factory`, which is called with the environment's `Known` and returns a
            `Policy`.
        seed: Seed of random agents.
        reserve: Reserve of an agent of `SWEPT`, in its own measure, instead of the tuned one.

    Raises:
        AgentError: The name is unknown, or the file is missing, unexpected or invalid, or the
            environment's actions are flat.

    >>> import gymnasium as gym, homeward
    >>> env = gym.make_vec("homeward/OutAndBack-v0", num_envs=2, vectorization_mode="vector_entry_point")
    >>> observations, _ = env.reset(seed=0)
    >>> make_policy("dmax", env).act(observations, begun=np.ones(2, np.bool_)).tolist()  # top speed, no sensing, go
    [[4, 0, 1], [4, 0, 1]]
    """
    batch = getattr(env, "unwrapped", env).batch
    if batch.options.action_type == "flat":
        raise AgentError(
            "agents give three parts of an action, not its flat number; choose action_type 'discrete'"
        )
    if name not in AGENTS and file is not None and ":" in str(file):
        return _of_factory(str(file), batch.known)
    if name not in AGENTS:
        raise AgentError(
            f"unknown agent {name!r}; choose from {', '.join(AGENTS)}, or give NAME=package.module:factory"
        )
    if file is not None and name not in FROM_FILES:
        raise AgentError(f"{name} takes no file, but {str(file)!r} was given")
    path = Path(file) if file is not None else None
    return AGENTS[name](Request(known=batch.known, file=path, seed=seed, reserve=reserve))
