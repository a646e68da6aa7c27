"""A load that switches on and off by the clock."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def intermittent_load(p: Any, s: Any, x: Any, load: Any) -> Any:
    # Seconds of load in the step: integral of the square wave up to its end minus up to its start.
    on_s = p.intermittent_load_duty * p.intermittent_load_period_s
    start, end = s.time_s / p.intermittent_load_period_s, (s.time_s + s.step_s) / p.intermittent_load_period_s
    loaded_s = (np.floor(end) - np.floor(start)) * on_s
    loaded_s += np.minimum((end - np.floor(end)) * p.intermittent_load_period_s, on_s)
    loaded_s -= np.minimum((start - np.floor(start)) * p.intermittent_load_period_s, on_s)
    return p.intermittent_load_power_w * loaded_s / s.step_s


EFFECT = Effect(
    id="intermittent_load",
    kind="ancillary",
    function=intermittent_load,
    parameters=(
        Parameter("power_w", "W", 0.0, 10000.0, "power while on"),
        Parameter("period_s", "s", 1.0, 100000.0, "period", 60.0),
        Parameter("duty", "1", 0.0, 1.0, "share of the period that it is on", 0.5),
    ),
    sentence="Something switches on and off by the clock.",
    equation="P = power_w for the first duty share of every period",
    source="square wave, averaged exactly over a step",
    needs=("time_s",),
    confused_with=("motor_heating", "compute"),
)
