"""The shield: wraps any agent, and returns home before the risk of stranding exceeds a limit."""

from homeward.agents.shield.shield import Shield
from homeward.agents.thresholds import RISK

__all__ = ["RISK", "Shield"]
