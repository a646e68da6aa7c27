"""Agents on the same episodes: figures with intervals, and plots."""
