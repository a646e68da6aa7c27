"""Benchmark of the diagnosis: recordings of simulated plants with concealed physics, and how often
it is identified."""
