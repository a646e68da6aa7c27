"""Power that the drive consumes just to turn."""

from typing import Any

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def no_load(p: Any, s: Any, x: Any, load: Any) -> Any:
    return p.no_load_power_w * (x.speed_mps > 0.0)


EFFECT = Effect(
    id="no_load",
    kind="drive",
    function=no_load,
    parameters=(Parameter("power_w", "W", 0.0, 10000.0, "power while driving, at any load"),),
    sentence="The drive consumes a constant power whenever it turns, whatever the load.",
    equation="P = power_w while moving",
    source="iron and brush losses of DC motors",
    needs=("speed_mps",),
    confused_with=("viscous", "standby"),
)
