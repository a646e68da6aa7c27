"""Force that accelerates the robot."""

from typing import Any

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.effects.payload import moved_mass
from homeward.physics.jit import inline


@inline
def inertia(p: Any, s: Any, x: Any, load: Any) -> Any:
    return p.inertia_mass_factor * moved_mass(p) * x.accel_mps2 * (x.speed_mps > 0.0)


_MOST = 10.0
"""Accelerated over moving mass: a rotor behind a gear of 79 to 1, as of a Husky, may weigh some
times the robot, and noise of slopes lowers the mass that is fitted beside it. Chosen."""

EFFECT = Effect(
    id="inertia",
    kind="force",
    function=inertia,
    parameters=(
        Parameter(
            "mass_factor",
            "1",
            0.0,
            _MOST,
            "accelerated over moving mass; above 1 for rotating parts",
        ),
    ),
    sentence="Accelerating consumes energy, which the robot uses when it slows down.",
    equation="F = mass_factor (m + dm) dv/dt while moving, dm the payload",
    source="Newton's second law; the paper neglects it",
    needs=("speed_mps",),
    confused_with=("breakaway",),
)
