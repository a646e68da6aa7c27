"""Simulation of recordings: vehicles, drives, the chain from wheel to battery, hidden mechanisms,
instruments."""
