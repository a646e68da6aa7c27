"""Friction that grows with the speed: of the bearings, or of ground that changes on the way."""

from homeward.diagnosis.explain.hypothesis import CHECKS, Hypothesis
from homeward.physics.effects.viscous import EFFECT

HYPOTHESIS = Hypothesis(EFFECT, changes="moving", by_place=True, check=CHECKS["drive"])
