"""On-board computing whose power grows with the data."""

from typing import Any

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def compute(p: Any, s: Any, x: Any, load: Any) -> Any:
    share = p.compute_base_share + (1.0 - p.compute_base_share) * x.sensing_hz / p.max_sensing_hz
    return (x.sensing_hz > 0.0) * p.compute_power_w * share


EFFECT = Effect(
    id="compute",
    kind="ancillary",
    function=compute,
    parameters=(
        Parameter("power_w", "W", 0.0, 10000.0, "power at the fastest sensing rate"),
        Parameter(
            "base_share", "1", 0.0, 1.0, "share of that power as soon as anything is sensed", 0.5
        ),
    ),
    sentence="Processing the samples on board consumes power.",
    equation="P = power_w (b + (1 - b) f_s / f_max) while sensing, b = base_share",
    source="the paper's next step: an embedded computer of 8 to 15 W",
    needs=("sensing_hz",),
    confused_with=("standby", "intermittent_load"),
)
