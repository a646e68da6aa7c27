"""The shield: around any agent, it brings home what would strand."""

from homeward.agents.shield.shield import DEVIATIONS, Shield

__all__ = ["DEVIATIONS", "Shield"]
