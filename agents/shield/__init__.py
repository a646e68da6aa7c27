"""The shield: around any agent, it brings home what would strand."""

from homeward.agents.shield.shield import DEVIATIONS, Commands, Shield, decode_actions

__all__ = ["DEVIATIONS", "Commands", "Shield", "decode_actions"]
