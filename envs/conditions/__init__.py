"""Episode conditions: ranges of each difficulty, weather, instruments, and their random numbers."""
