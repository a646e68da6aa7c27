"""Friction in the drive that grows with speed."""

from typing import Any

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def viscous(p: Any, s: Any, x: Any, load: Any) -> Any:
    return p.viscous_drag_ns_per_m * x.speed_mps


EFFECT = Effect(
    id="viscous",
    kind="force",
    function=viscous,
    parameters=(Parameter("drag_ns_per_m", "N s/m", 0.0, 10000.0, "force per speed"),),
    sentence="Friction in gears and bearings grows with speed.",
    equation="F = drag v",
    source="viscous friction of gear trains (Armstrong-Helouvry et al., Automatica 1994)",
    needs=("speed_mps",),
    confused_with=("no_load", "wind"),
)
