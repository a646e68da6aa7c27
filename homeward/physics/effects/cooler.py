"""A cooler that works in the heat."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def cooler(p: Any, s: Any, x: Any, load: Any) -> Any:
    return p.cooler_w_per_k * np.maximum(x.temperature_c - p.cooler_on_above_c, 0.0)


EFFECT = Effect(
    id="cooler",
    kind="ancillary",
    function=cooler,
    parameters=(
        Parameter("w_per_k", "W/K", 0.0, 1000.0, "power per kelvin above the set point"),
        # from which cooling degree days count (Eurostat)
        Parameter("on_above_c", "C", -40.0, 60.0, "set point", 24.0),
    ),
    sentence="A cooler or fan keeps the cabin, the battery or the electronics cool in the heat.",
    equation="P = w_per_k max(T - on_above_c, 0)",
    source="proportional thermostat",
    needs=("temperature_c",),
    confused_with=("intermittent_load",),
)
