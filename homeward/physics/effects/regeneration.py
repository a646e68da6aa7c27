"""Energy that braking gives back."""

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
    sentence="Braking downhill gives energy back to the battery.",
    equation="P = -share |F| v for F < 0",
    source="trap 5 of the model notes: at most the power that gravity gives",
    needs=("speed_mps", "grade_rad"),
    confused_with=(),
)
