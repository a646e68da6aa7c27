"""Slip, which goes with the push of the wheels."""

from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.physics.effects.slip import EFFECT

HYPOTHESIS = Hypothesis(
    EFFECT,
    shown_by=("grade_rad", "accel_mps2"),
    otherwise="at high load",
    check="compare wheel revolutions with the distance along a tape measure on a slope",
)
