"""The shield: around any agent, it brings home what would strand."""

from homeward.agents.shield.shield import RISK, Shield

__all__ = ["RISK", "Shield"]
