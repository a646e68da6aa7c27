"""A constant load."""

from typing import Any

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def standby(p: Any, s: Any, x: Any, load: Any) -> Any:
    return p.standby_power_w


EFFECT = Effect(
    id="standby",
    kind="ancillary",
    function=standby,
    parameters=(Parameter("power_w", "W", 0.0, 10000.0, "constant power"),),
    sentence="A load that the file lacks consumes power all the time.",
    equation="P = power_w",
    source="s0 of the paper's Eq. 5, too small",
    needs=("power_w",),
    confused_with=("compute",),
)
