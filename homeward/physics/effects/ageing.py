"""Capacity lost beyond that of the robot file."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline


@inline
def ageing(p: Any, s: Any, x: Any, load: Any) -> Any:
    return np.maximum(load, 0.0) * (p.ageing_lost_share / (1.0 - p.ageing_lost_share))


EFFECT = Effect(
    id="ageing",
    kind="battery",
    function=ageing,
    parameters=(Parameter("lost_share", "1", 0.0, 0.9, "share of the usable energy that is lost"),),
    sentence="The battery holds less energy than its file says, so its state of charge falls faster.",
    equation="P = load lost / (1 - lost)",
    source="Eq. 6 of the paper with unknown C and t",
    needs=("soc",),
    confused_with=("cold_battery", "rate_capacity"),
)
