"""A radio that transmits with more power far from base."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def radio(p: Any, s: Any, x: Any, load: Any) -> Any:
    return p.radio_w_per_km2 * (1e-3 * np.minimum(x.base_distance_m, p.radio_reach_m)) ** 2


EFFECT = Effect(
    id="radio",
    kind="ancillary",
    function=radio,
    parameters=(
        Parameter("w_per_km2", "W/km^2", 0.0, 1e7, "power per squared distance from base"),
        Parameter("reach_m", "m", 0.0, 1e6, "distance from which on the power is constant", 1e6),
    ),
    sentence="The radio needs more power far from base.",
    equation="P = k min(r, reach)^2",
    source="free-space path loss at constant received power (Friis)",
    needs=("base_distance_m",),
    confused_with=("ageing",),
)
