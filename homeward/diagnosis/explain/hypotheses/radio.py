"""A radio whose power rises with the distance from base, in any way: its rate falls in steps, its airtime rises."""

from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.physics.effects.radio import EFFECT

HYPOTHESIS = Hypothesis(EFFECT, rises_with="base_distance_m")
