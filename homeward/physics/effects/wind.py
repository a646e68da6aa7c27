"""Air drag against the moving air instead of still air."""

from typing import Any

from homeward.physics import model
from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def wind(p: Any, s: Any, x: Any, load: Any) -> Any:
    return model.wind_force(p, x.speed_mps, p.wind_exposure * x.headwind_mps) * (x.speed_mps > 0.0)


EFFECT = Effect(
    id="wind",
    kind="force",
    function=wind,
    parameters=(Parameter("exposure", "1", 0.0, 3.0, "share of the wind that the robot meets"),),
    sentence="Wind acts on the robot: a headwind consumes energy and a tailwind saves some.",
    equation="F = c (u |u| - v^2), u = v + exposure w",
    source="air drag on relative wind",
    needs=("speed_mps", "heading_rad"),
    confused_with=("hidden_grade", "viscous"),
)
