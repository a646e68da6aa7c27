"""Energy lost in the cold: capacity, or heat in a resistance that grows."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def cold_battery(p: Any, s: Any, x: Any, load: Any) -> Any:
    drawn = np.maximum(load, 0.0)
    reference_w = p.cold_battery_reference_w
    referred = reference_w > 0.0
    relative = referred * drawn / np.maximum(reference_w, 1e-6) + (1.0 - referred)
    cold_k = np.maximum(p.cold_battery_warm_c - x.temperature_c, 0.0)
    # At most 0.8: chosen, as 1 would consume an infinite power.
    lost = np.minimum(p.cold_battery_per_k * cold_k * relative, 0.8)
    return drawn * (lost / (1.0 - lost))


EFFECT = Effect(
    id="cold_battery",
    kind="battery",
    function=cold_battery,
    parameters=(
        Parameter("per_k", "1/K", 0.0, 0.05, "share of the energy lost per kelvin below warm_c"),
        Parameter("warm_c", "C", -20.0, 40.0, "temperature with full capacity", 20.0),
        Parameter(
            "reference_w",
            "W",
            0.0,
            1000000.0,
            "power at which per_k holds, as it grows with power; 0: at all powers",
        ),
    ),
    sentence="The battery delivers less energy in the cold.",
    equation="P = load l / (1 - l), l = per_k max(warm_c - T, 0) (load / reference if any), at most 0.8",
    source="capacity and resistance of lithium-ion cells in the cold, linearised (Waag, Kaebitz & Sauer 2013)",
    needs=("temperature_c",),
    confused_with=("ageing", "heater"),
)
