"""Heat in the motor windings, quadratic in the load."""

from typing import Any

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def copper_loss(p: Any, s: Any, x: Any, load: Any) -> Any:
    return p.copper_loss_w_per_n2 * load * load


EFFECT = Effect(
    id="copper_loss",
    kind="drive",
    function=copper_loss,
    parameters=(Parameter("w_per_n2", "W/N^2", 0.0, 1000.0, "loss per force squared"),),
    sentence="The motors heat up with the square of the load.",
    equation="P = k F^2",
    source="I^2 R with current proportional to force; the paper leaves load-dependent motor loss out",
    needs=("speed_mps", "grade_rad"),
    confused_with=("slip", "internal_resistance"),
)
