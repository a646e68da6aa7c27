"""Effects: physics that the paper's model omits, one file each. With all of them off it is the
paper's model."""

from importlib import import_module

from homeward.physics.effects.base import Effect, Kind, Parameter
from homeward.physics.effects.own import with_own

# In the order in which loads add up: slip depends on all forces before it, regeneration on all
# forces. The kernel needs forces first. The losses of a start and of capacity follow the battery's
# effects of momentary power.
_IDS = (
    "inertia",
    "viscous",
    "wind",
    "surface",
    "air_temperature",
    "payload",
    "hidden_grade",
    "slip",
    "turning",
    "regeneration",
    "copper_loss",
    "no_load",
    "motor_heating",
    "standby",
    "compute",
    "radio",
    "heater",
    "cooler",
    "intermittent_load",
    "internal_resistance",
    "rate_capacity",
    "breakaway",
    "ageing",
    "cold_battery",
)

EFFECTS: tuple[Effect, ...] = with_own(
    tuple(import_module(f"{__name__}.{name}").EFFECT for name in _IDS)
)
"""Every effect; its place in the tuple is its bit in the robot record's `effects` mask."""

PARAMETER_FIELDS = tuple(
    effect.field(parameter) for effect in EFFECTS for parameter in effect.parameters
)
"""Names of all effect parameters in the robot record."""

__all__ = ["EFFECTS", "PARAMETER_FIELDS", "Effect", "Kind", "Parameter"]
