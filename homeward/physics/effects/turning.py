"""Scrubbing of the wheels of a skid-steer robot in turns."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.effects.payload import moved_mass
from homeward.physics.jit import inline
from homeward.physics.model import GRAVITY_MPS2, traction_efficiency


@inline
def wheel_force(p: Any, x: Any) -> Any:
    """Force of the scrub against which the wheels turn, summed over all wheels, N, standing or
    driving.

    It is the torque, and so the current, of turning, also on the spot, where the speed is zero.
    """
    turn_mps = _turn_mps(p, x)
    # 0 straight on, 1 turning on the spot
    share = turn_mps / np.maximum(turn_mps + 2.0 * x.speed_mps, 1e-9)
    return p.turning_scrub * moved_mass(p) * GRAVITY_MPS2 * np.sqrt(share)


@inline
def turning(p: Any, s: Any, x: Any, load: Any) -> Any:
    return (
        wheel_force(p, x) * np.maximum(x.speed_mps, 0.5 * _turn_mps(p, x)) / traction_efficiency(p)
    )


@inline
def _turn_mps(p: Any, x: Any) -> Any:
    return np.abs(x.yaw_rate_radps) * p.track_m  # speed difference between left and right wheels


EFFECT = Effect(
    id="turning",
    kind="drive",
    function=turning,
    parameters=(
        Parameter("scrub", "1", 0.0, 2.0, "wheel force over weight when turning on the spot"),
    ),
    sentence="Turning drags the wheels sideways over the ground, which consumes more the tighter the turn.",
    equation="P = F u / Gamma, F = scrub (m + dm) g sqrt(s), s = |w| B / (|w| B + 2 v), u = max(v, |w| B / 2)",
    source="Morales et al., power of skid-steer robots, IEEE T-RO 2009; the shape over s is empirical",
    needs=("yaw_rate_radps", "speed_mps"),
    confused_with=("copper_loss",),
)
