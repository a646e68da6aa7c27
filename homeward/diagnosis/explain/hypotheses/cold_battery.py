"""A battery that holds less in the cold, below one of several temperatures."""

from homeward.diagnosis.explain.hypotheses.temperatures import temperatures
from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.physics.effects.cold_battery import EFFECT

_WARM_C = EFFECT.parameters[1]

HYPOTHESIS = Hypothesis(
    EFFECT,
    shapes=temperatures(_WARM_C),
    searched=(_WARM_C,),
    check="discharge the battery once cold and once warm through a known load",
)
