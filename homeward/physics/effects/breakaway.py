"""Energy lost at every start from standstill."""

from typing import Any

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def breakaway(p: Any, s: Any, x: Any, load: Any) -> Any:
    return (s.speed_mps == 0.0) * (x.speed_mps > 0.0) * p.breakaway_start_j / s.step_s


EFFECT = Effect(
    id="breakaway",
    kind="drive",
    function=breakaway,
    parameters=(Parameter("start_j", "J", 0.0, 100000.0, "battery energy of one start from standstill"),),
    sentence="Every start from standstill costs an extra burst of energy.",
    equation="E = start_j per start",
    source="static friction and in-rush, which the paper leaves out as not easily quantifiable",
    needs=("speed_mps",),
    confused_with=("inertia",),
)
