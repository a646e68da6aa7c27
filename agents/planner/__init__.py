"""The planner: turns back by the estimated way home, and chooses speed, sensing and stops by
Lagrange multipliers."""

from homeward.agents.planner.planner import Planner

__all__ = ["Planner"]
