"""Wheels that turn further than the robot travels."""

from typing import Any

import numpy as np

from homeward.physics.effects.base import Effect, Parameter
from homeward.physics.effects.payload import moved_mass
from homeward.physics.jit import inline
from homeward.physics.model import GRAVITY_MPS2


@inline
def slip(p: Any, s: Any, x: Any, load: Any) -> Any:
    # Positive when braking, too: a wheel that slips backwards absorbs less work from the motion.
    pull = np.abs(load)
    return pull * np.minimum(p.slip_per_load * pull / (moved_mass(p) * GRAVITY_MPS2), 1.0)


EFFECT = Effect(
    id="slip",
    kind="force",
    function=slip,
    parameters=(Parameter("per_load", "1", 0.0, 5.0, "slip per traction over weight"),),
    sentence="The wheels slip in proportion to their force, so part of their work is lost.",
    equation="F = |F| min(per_load |F| / ((m + dm) g), 1), dm the payload",
    source="linear slip-traction relation at small slip (Wong, Theory of Ground Vehicles)",
    needs=("speed_mps", "grade_rad"),
    confused_with=("copper_loss",),
)
