"""The motion of one drive along a way, out and back."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from benchmarks.concealed.fixed_way.noise import Array, drift
from benchmarks.concealed.fixed_way.way import PLACES_PER_M, TURN_M, Way

LONGEST_S = 2200.0  # chosen: longer than any drive takes
TOP_SPEED_MPS = 1.0  # Clearpath Husky A200 User Manual: maximum speed
ACCELERATION_MPS2 = 0.3  # chosen: gentle, so that inertia is negligible
BRAKING_MPS2 = 0.5  # chosen: the most that a driver brakes
PLANNED_BRAKING_MPS2 = 0.35  # chosen: with which a stop is approached
APPROACH_MPS = 0.06  # chosen: at which a stop is reached
CREEP_MPS = 0.03  # chosen: slowest speed that is not a stop
TURN_MPS = 0.4  # chosen: round the turn at the far end
ARRIVED_M = 0.02  # chosen: from the base
FINAL_WAIT_S = 10.0  # chosen: the log goes on after the arrival

WANDER_SHARE = 0.03  # chosen: by how much a driver misses the pace
WANDER_S = 8.0  # chosen: for how long
BENT_PER_M = 0.12  # chosen: curvature from which bends are driven slowest
SLOWER_IN_BENDS_SHARE = 0.12  # chosen

STOP_S = (8.0, 28.0)  # chosen: length of a stop at a random place
STOP_PLACES = (0.04, 0.96)  # chosen: where such stops are, as shares of the drive
SPELL_M = (9.0, 18.0)  # chosen: length of a stretch that is driven slower
SPELL_PLACES = (0.05, 0.9)  # chosen: where such stretches begin
DODGE_M = 3.0  # chosen: within which the robot evades something, to one side and back
DODGE_RADPS = (0.2, 0.4)  # chosen: largest yaw rate while it does
DODGE_PLACES = (0.05, 0.92)  # chosen: where it does

PlaceFactor = Callable[[Array, int], Array]
"""Factor of the pace by place, shape (n,), from places in m and 1 outwards or -1 homewards."""


@dataclass(frozen=True)
class Stop:
    """A stop on the way."""

    driven_m: float  # since the start of the drive
    seconds: float


@dataclass(frozen=True)
class Spell:
    """A stretch that one drive passes at another pace."""

    start_m: float  # driven since the start
    end_m: float
    factor: float  # of the pace


@dataclass(frozen=True)
class NewPace:
    """Another pace for the rest of a drive."""

    driven_m: float  # since the start
    pace_mps: float


@dataclass(frozen=True)
class Dodge:
    """An evasion to one side and back."""

    driven_m: float  # since the start
    yaw_rate_radps: float


def even(place_m: Array, direction: int) -> Array:
    """The same pace at every place, shape (n,)."""
    return np.ones_like(place_m)


@dataclass(frozen=True)
class Plan:
    """What is planned of a drive; the rest is drawn. All default values are chosen."""

    pace_mps: float
    dt_s: float = 0.1
    wait_s: float = 10.0  # before the start
    far_stop_s: float = 8.0  # at the far end, after the turn
    random_stops: int = 3
    stops: tuple[Stop, ...] = ()  # beside the random ones
    random_spells: int = 2
    spell_factor: tuple[float, float] = (0.6, 0.85)  # least and largest of a random spell
    spells: tuple[Spell, ...] | None = None  # in place of random ones
    dodges: int = 4
    new_pace: NewPace | None = None
    place_factor: PlaceFactor = even


@dataclass(frozen=True)
class Drive:
    """True motion of one drive, shape (n,) each."""

    dt_s: float
    time_s: Array
    driven_m: Array
    place_m: Array  # along the way, so that the way home passes the same places
    speed_mps: Array
    direction: Array  # 1 outwards, 0 in the turn, -1 homewards
    yaw_rate_radps: Array
    heading_rad: Array
    grade_rad: Array  # as it is driven


def drive(way: Way, plan: Plan, rng: Generator) -> Drive:
    """Drive out, round the turn at the far end, and back.

    Args:
        way: The way.
        plan: What is planned; all else is drawn.
        rng: Random numbers.
    """
    count = int(LONGEST_S / plan.dt_s)
    wander = 1 + drift(rng, count, plan.dt_s, WANDER_S, WANDER_SHARE)
    stops = _stops(way, plan, rng)
    spells = _random_spells(way, plan, rng) if plan.spells is None else plan.spells
    dodges = _random_dodges(way, plan, rng)
    driven_m, speed_mps = _follow(_Pace(way, plan, spells), stops, wander)
    turn_side = rng.choice([-1, 1])
    return _motion(way, plan.dt_s, driven_m, speed_mps, dodges, turn_side)


def slower_uphill(way: Way, slower_share: float = 0.12, steep_rad: float = 0.04) -> PlaceFactor:
    """What is ordinary: the steeper it goes up, the slower, up to a share at a slope, both
    chosen."""

    def factor(place_m: Array, direction: int) -> Array:
        uphill_rad = direction * way.at(way.grade_rad, place_m)
        return np.asarray(1 - slower_share * np.clip(uphill_rad / steep_rad, 0, 1))

    return factor


def _stops(way: Way, plan: Plan, rng: Generator) -> list[Stop]:
    """All stops in their order, the last at the end of the drive."""
    stops = []
    for driven_share in rng.uniform(*STOP_PLACES, plan.random_stops):
        stops.append(Stop(driven_share * way.round_trip_m, rng.uniform(*STOP_S)))
    stops += plan.stops
    stops.append(Stop(way.length_m + TURN_M, plan.far_stop_s))
    stops.sort(key=lambda stop: stop.driven_m)
    return [*stops, Stop(way.round_trip_m, 0.0)]


def _random_spells(way: Way, plan: Plan, rng: Generator) -> tuple[Spell, ...]:
    spells = []
    for _ in range(plan.random_spells):
        start_m = rng.uniform(*SPELL_PLACES) * way.round_trip_m
        end_m = start_m + rng.uniform(*SPELL_M)
        spells.append(Spell(start_m, end_m, rng.uniform(*plan.spell_factor)))
    return tuple(spells)


def _random_dodges(way: Way, plan: Plan, rng: Generator) -> list[Dodge]:
    dodges = []
    for driven_share in rng.uniform(*DODGE_PLACES, plan.dodges):
        side = rng.choice([-1, 1])
        dodges.append(Dodge(driven_share * way.round_trip_m, side * rng.uniform(*DODGE_RADPS)))
    return dodges


class _Pace:
    """The speed that is wanted, by the way driven since the start."""

    def __init__(self, way: Way, plan: Plan, spells: Sequence[Spell]) -> None:
        bent = np.minimum(np.abs(way.curvature_per_m) / BENT_PER_M, 1)
        in_bends = 1 - SLOWER_IN_BENDS_SHARE * bent
        self.way = way
        self.plan = plan
        self.spells = spells
        self.outwards = plan.place_factor(way.place_m, 1) * in_bends
        self.homewards = plan.place_factor(way.place_m, -1) * in_bends

    def wanted_mps(self, driven_m: float, wander: float) -> float:
        """Speed that is wanted where no stop is near, m/s."""
        pace_mps = self.plan.pace_mps
        new_pace = self.plan.new_pace
        if new_pace is not None and driven_m >= new_pace.driven_m:
            pace_mps = new_pace.pace_mps
        wanted_mps = pace_mps * self._factor(driven_m, pace_mps) * wander
        for spell in self.spells:
            if spell.start_m <= driven_m < spell.end_m:
                wanted_mps *= spell.factor
        return wanted_mps

    def _factor(self, driven_m: float, pace_mps: float) -> float:
        if driven_m < self.way.length_m:
            return _by_place(self.outwards, driven_m)
        if driven_m < self.way.length_m + TURN_M:
            return TURN_MPS / pace_mps
        return _by_place(self.homewards, self.way.round_trip_m - driven_m)


def _by_place(factors: Array, place_m: float) -> float:
    index = int(place_m * PLACES_PER_M)
    return float(factors[max(min(index, len(factors) - 1), 0)])


def _follow(pace: _Pace, stops: Sequence[Stop], wander: Array) -> tuple[Array, Array]:
    """Way driven, m, and speed, m/s, shape (n,) each, until the log ends at the base."""
    dt_s = pace.plan.dt_s
    driven_m = 0.0
    speed_mps = 0.0
    standing_s = pace.plan.wait_s
    stops_made = 0
    all_driven_m = []
    all_speed_mps = []
    for wander_factor in wander:
        all_driven_m.append(driven_m)
        all_speed_mps.append(speed_mps)
        if standing_s > 0:
            standing_s -= dt_s
            speed_mps = 0.0
        elif driven_m < pace.way.round_trip_m - ARRIVED_M:
            stop = stops[stops_made]
            wanted_mps = pace.wanted_mps(driven_m, wander_factor)
            speed_mps = _next_speed_mps(speed_mps, wanted_mps, stop.driven_m - driven_m, dt_s)
            driven_m += speed_mps * dt_s
            if driven_m >= stop.driven_m:
                standing_s = stop.seconds
                stops_made += 1
        elif speed_mps > 0:
            speed_mps = 0.0
            standing_s = FINAL_WAIT_S
        else:
            break
    return np.array(all_driven_m), np.array(all_speed_mps)


def _next_speed_mps(speed_mps: float, wanted_mps: float, left_m: float, dt_s: float) -> float:
    """Speed after a step, m/s: towards the wanted one, as far as the next stop allows."""
    to_stop_mps = math.sqrt(2 * PLANNED_BRAKING_MPS2 * max(left_m, 0.0)) + APPROACH_MPS
    target_mps = min(wanted_mps, to_stop_mps, TOP_SPEED_MPS)
    change_mps = min(max(target_mps - speed_mps, -BRAKING_MPS2 * dt_s), ACCELERATION_MPS2 * dt_s)
    return max(speed_mps + change_mps, CREEP_MPS)


def _motion(
    way: Way,
    dt_s: float,
    driven_m: Array,
    speed_mps: Array,
    dodges: Sequence[Dodge],
    turn_side: int,
) -> Drive:
    """All of a motion that follows from the way driven and the speed."""
    is_outwards = driven_m < way.length_m
    is_turning = (driven_m >= way.length_m) & (driven_m < way.length_m + TURN_M)
    back_m = np.clip(way.round_trip_m - driven_m, 0, way.length_m)
    place_m = np.where(is_outwards, driven_m, np.where(is_turning, way.length_m, back_m))
    direction = np.where(is_outwards, 1.0, np.where(is_turning, 0.0, -1.0))

    along_way_per_m = direction * way.at(way.curvature_per_m, place_m)
    curvature_per_m = np.where(is_turning, turn_side * np.pi / TURN_M, along_way_per_m)
    dodging_radps = np.zeros_like(driven_m)
    for dodge in dodges:
        progress = (driven_m - dodge.driven_m) / DODGE_M
        is_dodging = (progress > 0) & (progress < 1)
        yaw_rate_radps = dodge.yaw_rate_radps * np.sin(2 * np.pi * progress) * (speed_mps > 0)
        dodging_radps += np.where(is_dodging, yaw_rate_radps, 0.0)

    outwards_rad = way.at(way.heading_rad, place_m)
    heading_rad = np.where(is_outwards, outwards_rad, outwards_rad + turn_side * np.pi)
    turned_rad = turn_side * np.pi * (driven_m - way.length_m) / TURN_M
    heading_rad = np.where(is_turning, way.heading_rad[-1] + turned_rad, heading_rad)
    return Drive(
        dt_s=dt_s,
        time_s=np.asarray(np.arange(len(driven_m)) * dt_s, dtype=np.float64),
        driven_m=driven_m,
        place_m=place_m,
        speed_mps=speed_mps,
        direction=direction,
        yaw_rate_radps=curvature_per_m * speed_mps + dodging_radps,
        heading_rad=heading_rad + np.cumsum(dodging_radps) * dt_s,
        grade_rad=direction * way.at(way.grade_rad, place_m),
    )
