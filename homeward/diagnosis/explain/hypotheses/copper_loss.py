"""Losses of the windings, which go with the push of the wheels."""

from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.physics.effects.copper_loss import EFFECT

HYPOTHESIS = Hypothesis(
    EFFECT,
    shown_by=("grade_rad", "accel_mps2"),
    otherwise="at high load",
    check="measure the resistance of the motor windings",
)
