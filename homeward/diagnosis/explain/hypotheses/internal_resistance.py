"""Resistance of the battery, which seldom changes, but for a connector that works loose."""

from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.physics.effects.internal_resistance import EFFECT

HYPOTHESIS = Hypothesis(
    EFFECT,
    changes="once",
    seldom=True,
    shown_by=(),
    otherwise="at high power",
    check="read the battery voltage at rest and under a known load",
)
