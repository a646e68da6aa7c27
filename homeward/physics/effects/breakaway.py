"""Energy lost at every start from standstill."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def breakaway(p: Any, s: Any, x: Any, load: Any) -> Any:
    starts = (s.speed_mps == 0.0) * (x.speed_mps > 0.0)
    return starts * p.breakaway_start_j / np.maximum(s.step_s, 1e-9)


EFFECT = Effect(
    id="breakaway",
    kind="battery",  # an energy, which no effect of the momentary power should change with the length of the step
    function=breakaway,
    parameters=(Parameter("start_j", "J", 0.0, 100000.0, "battery energy of one start from standstill"),),
    sentence="Every start from standstill consumes additional energy.",
    equation="E = start_j per start",
    source="static friction and in-rush, which the paper omits as not easily quantifiable",
    needs=("speed_mps",),
    confused_with=("inertia",),
)
