"""The shield: wraps any agent, and brings home missions that would strand."""

from homeward.agents.shield.shield import RISK, Shield

__all__ = ["RISK", "Shield"]
