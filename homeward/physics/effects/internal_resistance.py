"""Heat in the battery, quadratic in the current, which the open-circuit voltage at the present
charge determines."""

from typing import Any

import numpy as np

from homeward.physics import battery
from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def internal_resistance(p: Any, s: Any, x: Any, load: Any) -> Any:
    open_circuit_v2 = p.nominal_voltage_v * p.nominal_voltage_v
    if p.squares_v2[0] > 0.0:
        energy_share = s.energy_j / s.capacity_j
        open_circuit_v2 = battery.square_v2(
            p.squares_v2, np.minimum(np.maximum(energy_share, 0.0), 1.0)
        )
    # No current delivers more than V^2 / 4R, where half of the energy is lost. Above that the load
    # is still supplied, with half of the energy lost, unless the robot has a cut-off, which ends it.
    relative = load * (4.0 * p.internal_resistance_ohm / open_circuit_v2)
    root = np.sqrt(np.maximum(1.0 - relative, 0.0))  # twice the efficiency, minus 1
    return load * (1.0 - root) / (1.0 + root)


EFFECT = Effect(
    id="internal_resistance",
    kind="battery",
    function=internal_resistance,
    parameters=(Parameter("ohm", "ohm", 0.0, 100.0, "internal resistance"),),
    sentence="The battery loses energy inside, and more at high power.",
    equation="P = R I^2, V I - R I^2 = load; above V^2 / 4R P = load; V at rest, at the present charge",
    source="Thevenin model of a battery",
    needs=("voltage_v", "current_a"),
    confused_with=("copper_loss", "rate_capacity"),
)
