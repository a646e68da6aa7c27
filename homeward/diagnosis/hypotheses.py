"""What a hypothesis is: what one effect would add to each window of these recordings, and what it takes to see it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from homeward.diagnosis.instruments import INSTRUMENTS, Instrument
from homeward.diagnosis.parameters import Parameters, WithEffects
from homeward.diagnosis.replay import Runs
from homeward.diagnosis.schedules import Axis, Schedule
from homeward.diagnosis.signals import Array
from homeward.physics.effects import EFFECTS, Effect

CATALOGUE: Mapping[str, Effect | Instrument] = {
    **{one.id: one for one in EFFECTS},
    **{one.id: one for one in INSTRUMENTS},
}
"""Everything that can be named, by id."""

PHYSICS = frozenset(one.id for one in EFFECTS)
"""Ids of the effects of the robot and its surroundings; the others are faults of instruments."""

STANDS_MPS = 0.05
"""A robot slower than this stands."""

STORM_MPS = 40.0
"""No wind is stronger."""

TINY = 1e-6
"""Of the largest size of an effect: its response is linear there."""

_ALWAYS_GIVEN = ("time_s", "power_w", "distance_m")

OF_CURRENT = ("inertia", "viscous", "wind", "surface", "payload", "hidden_grade", "slip", "turning", "clock_lag")
"""What shows in motor current: forces at the wheels. Of the rest, a torque sensor sees nothing."""


@dataclass(frozen=True)
class Term:
    """One hypothesis about one effect: what a unit of its size adds, shape (windows, sizes), and bounds of the sizes.

    `hidden` counts what was searched for beside the sizes, for the comparison of models of different freedom.
    """

    effect: str
    columns: Array
    low: Array  # (sizes,)
    high: Array
    hidden: int = 0
    shape: Mapping[str, float] = field(default_factory=dict)
    axis: Axis | Literal["steady"] = "steady"  # what the size depends on
    schedule: Schedule | None = None
    spread: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # interval of what the schedule shows
    fixed: bool = False  # whether its columns are no response of the kernel
    natural: bool = True  # whether the size changes as the sizes of this effect do
    of_rolling_kg: float | None = None  # C_rr m that its sizes are shares of, where they are: before the joint fit
    load: Array | None = None  # what a unit adds where it is at work, (windows,), where that is not everywhere
    at_work: Array | None = None  # how much of each size is at work, (windows, sizes)

    @property
    def linear(self) -> bool:
        """Whether its columns say all, so that no replay with other sizes is needed."""
        return self.axis != "steady" or self.fixed or self.effect not in PHYSICS | {"clock_lag"}


@dataclass(frozen=True)
class Setting:
    """What hypotheses are made from: the runs, the refit's parameters, what is already in the model, what is left."""

    runs: Runs
    parameters: Parameters
    theta: Array
    present: WithEffects  # effects that are already in the model
    predicted: Array  # (windows,)
    residual: Array  # (windows,)

    def response(self, effect: str, size: float, shape: Mapping[str, float], base: WithEffects | None = None) -> Array:
        """What an effect of this size adds, per unit of its size, shape (windows,)."""
        start = base or self.present
        name = CATALOGUE[effect].parameters[0].name
        added = WithEffects({**start.effects, effect: {**shape, name: size}}, start.headwind_mps, start.lag_s)
        without = self.predicted if base is None else self.parameters.predict(self.runs, self.theta, base)
        return (self.parameters.predict(self.runs, self.theta, added) - without) / size


def what_can_be_shown(absorbed: Mapping[str, float]) -> dict[str, float | None]:
    """For every effect the share that the refit would absorb, None where a channel lacks or nothing excites it."""
    return {effect: absorbed.get(effect) for effect in CATALOGUE}


def missing_channels(effect: str, runs: Runs) -> tuple[str, ...]:
    """Channels that an effect needs to be seen and that no run has."""
    given = {*runs.context, *_ALWAYS_GIVEN}
    if runs.unit == "W":
        given |= {"voltage_v", "current_a"}
    if "wheel_difference_mps" in given:
        given.add("yaw_rate_radps")
    needed = {"ageing": (), "rate_capacity": (), "odometry_scale": ("base_distance_m",)}
    return tuple(name for name in needed.get(effect, CATALOGUE[effect].needs) if name not in given)


def look_alike(one: str, other: str, runs: Runs) -> bool:
    """Whether two effects are known to look alike and no channel of these runs shows the difference."""
    known = other in CATALOGUE[one].confused_with or one in CATALOGUE[other].confused_with
    return known and bool({*CATALOGUE[one].needs, *CATALOGUE[other].needs} - {*runs.context, *_ALWAYS_GIVEN})
