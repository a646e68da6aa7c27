"""Mass carried beyond the robot's own."""

from typing import Any

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline
from homeward.physics.model import GRAVITY_MPS2


@inline
def moved_mass(p: Any) -> Any:
    """Mass that the robot moves, kg: its own and its payload. Every effect of mass acts on it."""
    return p.mass_kg + p.payload_mass_kg


@inline
def payload(p: Any, s: Any, x: Any, load: Any) -> Any:
    return (
        p.payload_mass_kg
        * GRAVITY_MPS2
        * (p.rolling_resistance * x.cos_grade + x.sin_grade)
        * (x.speed_mps > 0.0)
    )


EFFECT = Effect(
    id="payload",
    kind="force",
    function=payload,
    parameters=(Parameter("mass_kg", "kg", 0.0, 10000.0, "carried mass"),),
    sentence="The robot carries more mass than its file says.",
    equation="F = dm g (C_rr cos(theta) + sin(theta))",
    source="Eq. 3 of the paper with a larger mass",
    needs=("speed_mps", "grade_rad"),
    confused_with=("surface", "hidden_grade"),
)
