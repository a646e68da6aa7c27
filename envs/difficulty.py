"""What differs from the robot's file on the day, drawn per mission and hidden from the robot."""

from __future__ import annotations

from typing import Any

import numpy as np

from homeward.physics.effects import EFFECTS
from homeward.physics.jit import inline

DIFFICULTIES = ("known", "uncertain", "harsh")
KNOWN, UNCERTAIN, HARSH = range(3)

_BIT = {effect.id: np.uint64(1 << index) for index, effect in enumerate(EFFECTS)}
_WIND, _PAYLOAD, _SURFACE = _BIT["wind"], _BIT["payload"], _BIT["surface"]


@inline
def draw(rng: Any, p: Any, base: Any, m: Any, shared: Any) -> None:
    """Draw the true robot of a mission around a base, as a rule that of the file; `known` draws nothing.

    The same numbers are taken from the generator at every difficulty, so that a seed means the same day.
    """
    health, rolling, payload, surface, bias = rng.random(), rng.random(), rng.random(), rng.random(), rng.random()
    m.capacity_j = shared.full_j
    m.gauge_bias = 0.0
    p.effects = base.effects
    if shared.difficulty >= UNCERTAIN:
        # Battery health: *U(0.8, 1.0); the gauge shows the share that is left, not the joules.
        m.capacity_j *= 0.8 + 0.2 * health
        # Rolling resistance: *U(0.8, 1.3).
        p.rolling_resistance = base.rolling_resistance * (0.8 + 0.5 * rolling)
        # Payload: +U(0, 0.2) of the robot's mass.
        p.payload_mass_kg = base.payload_mass_kg + 0.2 * payload * base.mass_kg
        # The day's wind is felt.
        p.wind_exposure = max(base.wind_exposure, 1.0)
        p.effects |= _WIND | _PAYLOAD
    if shared.difficulty >= HARSH:
        # Rough patches roll up to U(0.2, 1.0) harder.
        p.surface_gain = max(base.surface_gain, 0.2 + 0.8 * surface)
        p.effects |= _SURFACE
        # Fuel gauge: misreads what was used by U(-0.15, 0.15).
        m.gauge_bias = 0.3 * bias - 0.15
    m.energy_j = m.capacity_j
