"""Regeneration. What brakes a robot on the level is its inertia: without it there is nothing to regenerate."""

from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.physics.effects import inertia
from homeward.physics.effects.regeneration import EFFECT

HYPOTHESIS = Hypothesis(
    EFFECT,
    beside={inertia.EFFECT.id: {inertia.EFFECT.switch.name: 1.0}},
    shown_by=("accel_mps2", "grade_rad"),
    check="put a clamp meter on the battery lead while braking",
)
