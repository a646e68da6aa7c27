"""Capacity lost in the cold."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def cold_battery(p: Any, s: Any, x: Any, load: Any) -> Any:
    # At most 0.8: chosen, as 1 would consume an infinite power.
    lost = np.minimum(p.cold_battery_per_k * np.maximum(p.cold_battery_warm_c - x.temperature_c, 0.0), 0.8)
    return np.maximum(load, 0.0) * (lost / (1.0 - lost))


EFFECT = Effect(
    id="cold_battery",
    kind="battery",
    function=cold_battery,
    parameters=(
        Parameter("per_k", "1/K", 0.0, 0.05, "share of the capacity lost per kelvin below warm_c"),
        Parameter("warm_c", "C", -20.0, 40.0, "temperature with full capacity", 20.0),
    ),
    sentence="The battery delivers less energy in the cold.",
    equation="P = load l / (1 - l), l = per_k max(warm_c - T, 0), at most 0.8",
    source="capacity of lithium-ion cells below room temperature, linearised",
    needs=("temperature_c",),
    confused_with=("ageing", "heater"),
)
