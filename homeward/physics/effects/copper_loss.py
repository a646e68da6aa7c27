"""Heat in the motor windings, quadratic in the load."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def copper_loss(p: Any, s: Any, x: Any, load: Any) -> Any:
    pull = np.maximum(load, 0.0)  # braking heats with the energy of the descent
    return p.copper_loss_w_per_n2 * pull * pull


EFFECT = Effect(
    id="copper_loss",
    kind="drive",
    function=copper_loss,
    parameters=(Parameter("w_per_n2", "W/N^2", 0.0, 1000.0, "loss per force squared"),),
    sentence="The heat of the motors grows with the square of the load.",
    equation="P = k max(F, 0)^2",
    source="I^2 R with current proportional to force; the paper omits load-dependent motor losses",
    needs=("speed_mps", "grade_rad"),
    confused_with=("slip", "internal_resistance"),
)
