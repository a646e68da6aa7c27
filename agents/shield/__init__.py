"""The shield: around any agent, it brings home what would strand."""

from homeward.agents.shield.shield import RISKS, Shield

__all__ = ["RISKS", "Shield"]
