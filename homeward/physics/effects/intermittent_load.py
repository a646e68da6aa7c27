"""A load that switches on and off periodically."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline

ROUNDING_S = 1e-6
"""A switch so shortly ahead is taken as done, and one so shortly before the end of a step is left
to the next. Chosen: above the rounding of times in double precision (1e-10 s after ten days), and
no time of a load."""


@inline
def intermittent_load(p: Any, s: Any, x: Any, load: Any) -> Any:
    return p.intermittent_load_power_w * (_phase(p, s) < p.intermittent_load_duty)


@inline
def until_switch(p: Any, s: Any) -> Any:
    """Time until the load switches, s: the kernel ends a step there, as the battery's losses are
    not linear."""
    phase = _phase(p, s)
    edge = p.intermittent_load_duty + (phase >= p.intermittent_load_duty) * (
        1.0 - p.intermittent_load_duty
    )
    return (edge - phase) * p.intermittent_load_period_s + ROUNDING_S


@inline
def _phase(p: Any, s: Any) -> Any:
    periods = (s.time_s + ROUNDING_S) / p.intermittent_load_period_s
    return periods - np.floor(periods)


EFFECT = Effect(
    id="intermittent_load",
    kind="ancillary",
    function=intermittent_load,
    parameters=(
        Parameter("power_w", "W", 0.0, 10000.0, "power while on"),
        Parameter("period_s", "s", 1.0, 100000.0, "period", 60.0),
        Parameter("duty", "1", 0.0, 1.0, "share of the period in which it is on", 0.5),
    ),
    sentence="A load switches on and off periodically.",
    equation="P = power_w for the first duty share of every period",
    source="square wave",
    needs=("time_s",),
    confused_with=("motor_heating", "compute"),
)
