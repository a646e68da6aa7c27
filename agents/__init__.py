"""Agents: baselines, planner and learners.

`make_policy("dmax_adaptive", env)` makes one for an environment; its `act` chooses actions for a
batch of missions. Baselines need NumPy only.
"""

if __name__ == "agents":
    raise ImportError(
        "import it as homeward.agents: the folder agents/ is the source of that package"
    )

from homeward.agents.base import Policy
from homeward.agents.registry import AGENTS, AgentError, make_policy

__all__ = [
    "AGENTS", "AgentError", "Policy", "evaluation", "learning", "make_policy", "onboard", "oracle", "planner", "shield",
    "trained",
]  # fmt: skip
