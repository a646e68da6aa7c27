"""A heater that works in the cold."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def heater(p: Any, s: Any, x: Any, load: Any) -> Any:
    return p.heater_w_per_k * np.maximum(p.heater_on_below_c - x.temperature_c, 0.0)


EFFECT = Effect(
    id="heater",
    kind="ancillary",
    function=heater,
    parameters=(
        Parameter("w_per_k", "W/K", 0.0, 1000.0, "power per kelvin below the set point"),
        Parameter("on_below_c", "C", -40.0, 40.0, "set point", 10.0),
    ),
    sentence="A heater keeps the battery or the electronics warm in the cold.",
    equation="P = w_per_k max(on_below_c - T, 0)",
    source="proportional thermostat",
    needs=("temperature_c",),
    confused_with=("cold_battery",),
)
