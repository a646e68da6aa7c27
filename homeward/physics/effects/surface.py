"""Ground with another rolling resistance than the ground C_rr was measured on."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline
from homeward.physics.model import rolling_force


@inline
def surface(p: Any, s: Any, x: Any, load: Any) -> Any:
    rise = np.maximum(p.surface_gain * x.roughness, -1.0)
    return rise * rolling_force(p, x.cos_grade) * (x.speed_mps > 0.0)


EFFECT = Effect(
    id="surface",
    kind="force",
    function=surface,
    parameters=(
        Parameter("gain", "1", -0.9, 10.0, "rise of C_rr over its value, at roughness 1"),
        Parameter("usual", "1", 0.0, 10.0, "typical roughness, for ground that is unknown"),
    ),
    sentence="The ground changes on the way and its rolling resistance differs from the assumed one.",
    equation="F = max(gain roughness, -1) C_rr m g cos(theta)",
    source="rolling resistance by surface (Wong, Theory of Ground Vehicles)",
    needs=("speed_mps", "distance_m"),
    confused_with=("payload", "hidden_grade"),
)
