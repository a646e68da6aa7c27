"""A load that is there from some moment on; one that always is belongs to the idle power."""

from homeward.diagnosis.explain.hypothesis import Hypothesis, everywhere
from homeward.physics.effects.standby import EFFECT

HYPOTHESIS = Hypothesis(
    EFFECT,
    steady=None,
    changes="once",
    load=everywhere,
    check="unplug one device after the other with a clamp meter on the battery lead",
)
