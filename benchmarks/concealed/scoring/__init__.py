"""Runs the diagnosis on cases, and counts correct answers."""
