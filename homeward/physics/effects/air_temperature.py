"""Tyres that roll harder in the cold, and air that is denser.

The figure of the regulation is quoted from memory, as is that of ISO 28580 in the fit made to
predict: nobody has compared them with the texts.
"""

from typing import Any

from homeward.physics import model
from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline

REFERENCE_C = 20.0
"""Temperature at which road loads are stated (UN GTR 15, Annex 4)."""


@inline
def air_temperature(p: Any, s: Any, x: Any, load: Any) -> Any:
    cold_k = REFERENCE_C - x.temperature_c
    harder = p.air_temperature_rolling_per_k * cold_k
    denser = cold_k / (model.ZERO_CELSIUS_K + x.temperature_c)
    tyres_n = harder * model.rolling_force(p, x.cos_grade)
    air_n = denser * model.drag_force(p, x.speed_mps)
    return (tyres_n + air_n) * (x.speed_mps > 0.0)


EFFECT = Effect(
    id="air_temperature",
    kind="force",
    function=air_temperature,
    parameters=(
        Parameter(
            "rolling_per_k", "1/K", 0.0, 0.02, "rise of C_rr over its value, per kelvin below 20 C"
        ),
    ),
    sentence="In the cold tyres roll harder and air is denser.",
    equation="F = rolling_per_k (20 C - T) C_rr m g cos(theta) + ((293.15 K) / T - 1) c v^2",
    source="correction of road loads to 20 C (UN GTR 15, Annex 4: 0.0086 per kelvin); ideal gas",
    needs=("speed_mps", "temperature_c"),
    confused_with=("cold_battery", "heater"),
)
