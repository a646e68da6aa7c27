"""Charge that is unavailable at high power."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def rate_capacity(p: Any, s: Any, x: Any, load: Any) -> Any:
    drawn = np.maximum(load, 0.0)
    relative = np.maximum(drawn * (1.0 / p.rate_capacity_reference_w), 1.0)
    # exp and log are twice as fast as a power
    return drawn * (np.exp(p.rate_capacity_excess * np.log(relative)) - 1.0)


EFFECT = Effect(
    id="rate_capacity",
    kind="battery",
    function=rate_capacity,
    parameters=(
        Parameter("excess", "1", 0.0, 1.0, "Peukert exponent minus 1"),
        Parameter(
            "reference_w",
            "W",
            1e-06,
            1000000.0,
            "power up to which the rated energy is available",
            1.0,
        ),
    ),
    sentence="At high power a part of the battery's charge is unavailable.",
    equation="P = load ((load / reference)^excess - 1) above the reference",
    source="Peukert's law",
    needs=("voltage_v", "current_a", "soc"),
    confused_with=("internal_resistance", "ageing"),
)
