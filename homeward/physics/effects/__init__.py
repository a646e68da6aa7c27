"""What the paper leaves out: one effect a file, each off at zero. The paper's model is the point where all are off."""

from homeward.physics.effects import (
    ageing,
    breakaway,
    cold_battery,
    compute,
    copper_loss,
    heater,
    hidden_grade,
    inertia,
    intermittent_load,
    internal_resistance,
    motor_heating,
    no_load,
    payload,
    radio,
    rate_capacity,
    regeneration,
    slip,
    standby,
    surface,
    turning,
    viscous,
    wind,
)
from homeward.physics.effects.base import Effect, Kind, Parameter

# In the order in which loads add up: slip sees the force of all before it, regeneration that of all forces. Forces come
# first, as the kernel counts on. The losses of a start and of capacity follow the battery's effects of momentary power.
EFFECTS: tuple[Effect, ...] = (
    inertia.EFFECT,
    viscous.EFFECT,
    wind.EFFECT,
    surface.EFFECT,
    payload.EFFECT,
    hidden_grade.EFFECT,
    slip.EFFECT,
    turning.EFFECT,
    regeneration.EFFECT,
    copper_loss.EFFECT,
    no_load.EFFECT,
    motor_heating.EFFECT,
    standby.EFFECT,
    compute.EFFECT,
    radio.EFFECT,
    heater.EFFECT,
    intermittent_load.EFFECT,
    internal_resistance.EFFECT,
    rate_capacity.EFFECT,
    breakaway.EFFECT,
    ageing.EFFECT,
    cold_battery.EFFECT,
)
"""Every effect; its place in the tuple is its bit in the robot record's `effects` mask."""

PARAMETER_FIELDS = tuple(effect.field(parameter) for effect in EFFECTS for parameter in effect.parameters)
"""Names of all effect parameters in the robot record."""

__all__ = ["EFFECTS", "PARAMETER_FIELDS", "Effect", "Kind", "Parameter"]
