"""The planner: when to turn back by what the robot finds out, speed, sensing and stops by prices."""

from homeward.agents.planner.planner import Planner

__all__ = ["Planner"]
