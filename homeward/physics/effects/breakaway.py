"""Energy lost at every start from standstill."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def breakaway(p: Any, s: Any, x: Any, load: Any) -> Any:
    return p.breakaway_start_j * _spent(p, s, x) / np.maximum(s.step_s, 1e-9)


@inline
def _left(s: Any, x: Any) -> Any:
    starts = (s.speed_mps == 0.0) * (x.speed_mps > 0.0)
    return np.maximum(s.start_left, 1.0 * starts)


@inline
def _spent(p: Any, s: Any, x: Any) -> Any:
    return np.minimum(_left(s, x), s.step_s * x.speed_mps / p.breakaway_over_m)


@inline
def remember(p: Any, s: Any, x: Any) -> None:
    """Take what the step has spent from what is left of the start's energy."""
    if p.breakaway_start_j != 0.0:
        s.start_left = _left(s, x) - _spent(p, s, x)


EFFECT = Effect(
    id="breakaway",
    # an energy, which no effect of the momentary power should change with the length of the step
    kind="battery",
    function=breakaway,
    parameters=(
        Parameter("start_j", "J", 0.0, 100000.0, "battery energy of one start from standstill"),
        Parameter("over_m", "m", 1e-6, 1000.0, "way after the start over which it is spent", 1e-6),
    ),
    sentence="Every start from standstill consumes additional energy.",
    equation="E = start_j per start, spent evenly over the first over_m metres",
    source="static friction and in-rush, which the paper omits as not easily quantifiable; wheels that have sunk in "
    "climb out over some way (Wong, Theory of Ground Vehicles, ch. 2)",
    needs=("speed_mps",),
    confused_with=("inertia",),
)
