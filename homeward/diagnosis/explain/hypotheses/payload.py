"""A load that is put on where the robot stands: mostly, so that this is a preference between equals."""

from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.physics.effects.payload import EFFECT

HYPOTHESIS = Hypothesis(
    EFFECT, steady=None, changes="standing", shown_by=(), check="weigh the robot as it drove", lies_in="load"
)
