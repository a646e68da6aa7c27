"""Energy recovered by braking, downhill and, with the effect `inertia`, when the robot slows down."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def regeneration(p: Any, s: Any, x: Any, load: Any) -> Any:
    return np.minimum(load, 0.0) * x.speed_mps * p.regeneration_share


EFFECT = Effect(
    id="regeneration",
    kind="drive",
    function=regeneration,
    parameters=(Parameter("share", "1", 0.0, 0.95, "share of the braking power that returns to the battery"),),
    sentence="Braking returns energy to the battery.",
    equation="P = -share |F| v where the sum of all forces F < 0",
    source="conservation of energy: at most the power that gravity or the loss of speed supplies",
    needs=("speed_mps",),
    confused_with=(),
)
