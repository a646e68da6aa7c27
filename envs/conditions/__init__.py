"""What a mission meets: ranges of each difficulty, weather, instruments, and the random numbers behind both."""
