"""Comparison of groups of runs, driving or at standstill. Uses the diagnosis, which does not depend
on it."""
