"""On-board computing that grows with the data."""

from typing import Any

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def compute(p: Any, s: Any, x: Any, load: Any) -> Any:
    return (x.sensing_hz > 0.0) * (p.compute_power_w + p.compute_j_per_sample * x.sensing_hz)


EFFECT = Effect(
    id="compute",
    kind="ancillary",
    function=compute,
    parameters=(
        Parameter("power_w", "W", 0.0, 10000.0, "power while anything is sensed"),
        Parameter("j_per_sample", "J", 0.0, 1000.0, "energy per sample"),
    ),
    sentence="Processing the samples on board takes power.",
    equation="P = power_w + j_per_sample f_s while sensing",
    source="the paper's next step: an embedded computer of 8 to 15 W",
    needs=("sensing_hz",),
    confused_with=("standby", "intermittent_load"),
)
