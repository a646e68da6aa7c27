"""Difficulties: the distributions of hidden variables, from which missions are drawn and agents
have their priors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from homeward.physics.effects import EFFECTS
from homeward.physics.jit import inline

_BIT = {effect.id: np.uint64(1 << index) for index, effect in enumerate(EFFECTS)}
_WIND, _PAYLOAD, _SURFACE = _BIT["wind"], _BIT["payload"], _BIT["surface"]


@dataclass(frozen=True)
class Uniform:
    """A uniform distribution between two limits.

    >>> round(Uniform(0.8, 1.0).deviation, 4)
    0.0577
    """

    low: float
    high: float

    @property
    def mean(self) -> float:
        """Its mean."""
        return 0.5 * (self.low + self.high)

    @property
    def deviation(self) -> float:
        """Its standard deviation."""
        return (self.high - self.low) / float(np.sqrt(12.0))


@dataclass(frozen=True)
class Difficulty:
    """Which variables are hidden from a robot, and their ranges.

    Attributes:
        instruments: Its instruments, unless `Options.instruments` says otherwise.
        health: Capacity of the battery over the file's.
        rolling: Rolling resistance over the file's.
        payload: Payload over the robot's mass.
        surface: Additional rolling resistance of the roughest ground, as a share, beyond an effect
            in the robot's file.
        route_is_known: Whether the whole route and the wind are known, or two places ahead and a
            forecast.
        weather_changes: Whether wind and temperature change during the mission
            (`homeward.envs.conditions.weather`).
    """

    instruments: str
    health: Uniform
    rolling: Uniform
    payload: Uniform
    surface: Uniform
    route_is_known: bool
    weather_changes: bool


# The paper gives no ranges; these are chosen. Health: electric vehicles' batteries are retired at
# 80 % of their capacity (USABC, Electric vehicle battery test procedures manual, 1996). Rolling
# resistance and payload: differences between paths and loads of one robot. Rough ground: at most
# twice the rolling resistance.
DIFFICULTY: dict[str, Difficulty] = {
    "known": Difficulty(
        instruments="exact",
        health=Uniform(1.0, 1.0),
        rolling=Uniform(1.0, 1.0),
        payload=Uniform(0.0, 0.0),
        surface=Uniform(0.0, 0.0),
        route_is_known=True,
        weather_changes=False,
    ),
    "uncertain": Difficulty(
        instruments="meter",
        health=Uniform(0.8, 1.0),
        rolling=Uniform(0.8, 1.3),
        payload=Uniform(0.0, 0.2),
        surface=Uniform(0.0, 0.0),
        route_is_known=False,
        weather_changes=True,
    ),
}
DIFFICULTY["harsh"] = replace(
    DIFFICULTY["uncertain"], instruments="any_gauge", surface=Uniform(0.2, 1.0)
)
"""Difficulties by name."""

DIFFICULTIES = tuple(DIFFICULTY)

DRAWN = ("health", "rolling", "payload", "surface")
"""Hidden numbers that are drawn for each mission."""


@inline
def draw(rng: Any, p: Any, base: Any, mission: Any, hidden: Any) -> None:
    """Draw the true robot of a mission around a base, by default the robot of the file.

    At every difficulty the same random numbers are drawn, so that a seed gives the same conditions.
    """
    drawn = hidden.drawn
    health, rolling, payload, surface = rng.random(), rng.random(), rng.random(), rng.random()
    mission.capacity_j = hidden.full_j * (drawn.health.low + drawn.health.span * health)
    mission.energy_j = mission.capacity_j
    p.effects = base.effects
    p.rolling_resistance = base.rolling_resistance * (
        drawn.rolling.low + drawn.rolling.span * rolling
    )
    p.payload_mass_kg = (
        base.payload_mass_kg + (drawn.payload.low + drawn.payload.span * payload) * base.mass_kg
    )
    if hidden.forecast_errs:
        p.wind_exposure = max(base.wind_exposure, 1.0)
        p.effects |= _WIND | _PAYLOAD
    if drawn.surface.low > 0.0:
        p.surface_gain = max(base.surface_gain, drawn.surface.low + drawn.surface.span * surface)
        p.effects |= _SURFACE
