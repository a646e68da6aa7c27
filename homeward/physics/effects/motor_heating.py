"""Motor windings that warm up, which raises their resistance."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.jit import inline
from homeward.physics.model import traction_efficiency

HOTTEST_K = 150.0
"""Rise above ambient that no winding survives for long (IEC 60034-1 allows 105 to 125 K)."""


@inline
def motor_heating(p: Any, s: Any, x: Any, load: Any) -> Any:
    work_w = _work(p, x, load)
    steady_k = _steady(p, work_w)
    # Mean temperature over the step, so that the step length does not matter.
    constants = np.maximum(s.step_s / p.motor_heating_time_constant_s, 1e-6)
    s.winding_fade = np.exp(-constants)
    mean_k = steady_k + (s.winding_k - steady_k) * ((1.0 - s.winding_fade) / constants)
    return p.motor_heating_per_k * mean_k * work_w


@inline
def _work(p: Any, x: Any, force_n: Any) -> Any:
    return np.maximum(force_n, 0.0) * (x.speed_mps / traction_efficiency(p))


@inline
def _steady(p: Any, work_w: Any) -> Any:
    return np.minimum(p.motor_heating_rise_k_per_w * work_w, HOTTEST_K)


@inline
def remember(p: Any, s: Any, x: Any) -> None:
    """Warm the winding towards its steady temperature: the exact solution for a step of constant
    load."""
    if p.motor_heating_per_k != 0.0:
        steady_k = _steady(p, _work(p, x, s.traction_n))
        s.winding_k = steady_k + (s.winding_k - steady_k) * s.winding_fade


EFFECT = Effect(
    id="motor_heating",
    kind="drive",
    function=motor_heating,
    parameters=(
        Parameter(
            "per_k", "1/K", 0.0, 0.02, "rise of the drive power per kelvin of winding temperature"
        ),
        Parameter(
            "rise_k_per_w",
            "K/W",
            0.0,
            1000.0,
            "steady temperature rise per watt into the drive",
            1.0,
        ),
        Parameter("time_constant_s", "s", 1.0, 100000.0, "time constant of warming", 600.0),
    ),
    sentence="The motors lose more as they warm up during the run.",
    equation="P = per_k T F v / Gamma, time_constant dT/dt = min(rise F v / Gamma, 150 K) - T",
    source="first-order thermal model of a motor; copper gains 0.39 % of resistance per kelvin (IEC 60028)",
    needs=("speed_mps", "time_s"),
    confused_with=("intermittent_load", "ageing"),
)
