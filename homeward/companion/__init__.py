"""On the robot: estimates of the energy left and of the way home with their uncertainty, and when
to turn."""

from homeward.companion.advice import Action, Advice, HomeOption, UncertainValue
from homeward.companion.companion import Companion
from homeward.companion.policy import OnboardPolicy
from homeward.companion.readings import CompanionError
from homeward.companion.way import RouteLike

__all__ = [
    "Action",
    "Advice",
    "Companion",
    "CompanionError",
    "HomeOption",
    "OnboardPolicy",
    "RouteLike",
    "UncertainValue",
]
