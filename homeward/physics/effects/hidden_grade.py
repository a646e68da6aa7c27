"""Slope that the map lacks."""

from typing import Any

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.effects.payload import moved_mass
from homeward.physics.jit import inline
from homeward.physics.model import GRAVITY_MPS2


@inline
def hidden_grade(p: Any, s: Any, x: Any, load: Any) -> Any:
    return (
        moved_mass(p)
        * GRAVITY_MPS2
        * p.hidden_grade_slope
        * x.direction
        * x.cos_grade
        * (x.speed_mps > 0.0)
    )


EFFECT = Effect(
    id="hidden_grade",
    kind="force",
    function=hidden_grade,
    parameters=(
        Parameter(
            "slope", "1", -0.5, 0.5, "tangent of the slope missing from the map, along the way out"
        ),
    ),
    sentence="The ground has a slope that the map lacks.",
    equation="F = (m + dm) g slope cos(theta), dm the payload",
    source="Eq. 3 of the paper, to first order in the missing slope",
    needs=("speed_mps",),
    confused_with=("wind", "surface"),
)
