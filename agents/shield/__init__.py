"""The shield: around any agent, it brings home what would strand."""
