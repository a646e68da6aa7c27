"""What asks the tool, and counts its answers."""
