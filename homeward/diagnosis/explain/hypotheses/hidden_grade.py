"""A slope that the map lacks: on the route where it was met, and not on level ground that one chooses."""

from homeward.diagnosis.explain.hypothesis import Hypothesis
from homeward.physics.effects.hidden_grade import EFFECT

HYPOTHESIS = Hypothesis(
    EFFECT,
    changes="moving",
    signed=True,
    by_place=True,
    weather=0,
    map_channel="grade_rad",
    shown_by=("base_distance_m",),
    check="survey the slope of the route with a level",
    lies_in="route",
)
