"""Inertia, which acceleration shows."""

from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.physics.effects.inertia import EFFECT

HYPOTHESIS = Hypothesis(
    EFFECT,
    shown_by=("accel_mps2",),
    otherwise="when speeding up",
    check="let the robot coast to a stop on level ground and log its speed",
)
