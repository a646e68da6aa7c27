"""Benchmark of the diagnosis on one fixed way.

Is a change of consumption due to the ground, to the robot's own motion, or to a load in time?
"""
