"""Heat in the battery, quadratic in the current."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def internal_resistance(p: Any, s: Any, x: Any, load: Any) -> Any:
    # Current of a source V behind R that delivers the load: beyond V^2 / 4R none does, and the most it can is drawn.
    root = np.sqrt(np.maximum(p.nominal_voltage_v * p.nominal_voltage_v - 4.0 * p.internal_resistance_ohm * load, 0.0))
    current_a = 2.0 * load / (p.nominal_voltage_v + root)
    return p.internal_resistance_ohm * current_a * current_a


EFFECT = Effect(
    id="internal_resistance",
    kind="battery",
    function=internal_resistance,
    parameters=(Parameter("ohm", "ohm", 0.0, 100.0, "internal resistance"),),
    sentence="The battery loses energy inside, more at high power.",
    equation="P = R I^2, V I - R I^2 = load",
    source="Thevenin model of a battery",
    needs=("voltage_v", "current_a"),
    confused_with=("copper_loss", "rate_capacity"),
)
