"""Energy recovered by braking, downhill and, with the effect `inertia`, when the robot slows
down."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline

NO_LIMIT_W = 1e6
"""More than any ground robot brakes with."""


@inline
def regeneration(p: Any, s: Any, x: Any, load: Any) -> Any:
    braking_w = np.minimum(np.maximum(-load, 0.0) * x.speed_mps, p.regeneration_up_to_w)
    return -p.regeneration_share * braking_w


EFFECT = Effect(
    id="regeneration",
    kind="drive",
    function=regeneration,
    parameters=(
        Parameter(
            "share",
            "1",
            0.0,
            0.95,
            "share of the motors' braking power that returns to the battery",
        ),
        Parameter(
            "up_to_w",
            "W",
            1e-3,
            NO_LIMIT_W,
            "braking power above which friction brakes take over",
            NO_LIMIT_W,
        ),
    ),
    sentence="Braking returns energy to the battery.",
    equation="P = -share min(|F| v, up_to) where the sum of all forces F < 0",
    source="conservation of energy: at most the power that gravity or the loss of speed supplies; friction brakes take "
    "what exceeds the power of motors and battery (Gao, Chen & Ehsani, 1999, SAE 1999-01-2910)",
    needs=("speed_mps",),
    confused_with=(),
)
