"""Scenarios of the rover: drives, ground, load, concealed physics and recorded channels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.concealed.plants.motion import Array
from benchmarks.concealed.plants.rover_drives import (
    Command,
    Leg,
    command,
    cruise,
    on_the_spot,
    stop_and_go,
    tour,
)
from benchmarks.concealed.plants.rover_engine import Brake, Ground, Rover, Trip, World

RUN_S = 120.0  # of most drives; chosen
BRAKE_NM = 2.0  # of a wheel that brakes in left bends; chosen: 12 N at its rim
# speeds at the rim between which wheels chatter; chosen: within what is driven
CHATTER_MPS = (0.46, 0.54)
CHATTER_NM = 0.6  # of each wheel then; chosen: 15 N at the rims of all four
CONTROL_MPS = 0.02  # change of speed in a run that hides nothing, not even inertia

_HILLS = (
    (6.0, 0.0),
    (12.0, 1.0),
    (22.0, 1.0),
    (28.0, 0.0),
    (30.0, 0.0),
    (36.0, -1.0),
    (46.0, -1.0),
    (52.0, 0.0),
)
"""Place, m, and slope over the steepest: one rise and one descent."""


@dataclass(frozen=True)
class Scenario:
    """Rover, trips, physics concealed from the nominal file, and recorded channels."""

    truth: tuple[str, ...]
    rover: Rover
    trips: tuple[Trip, ...]
    brake: Brake | None = None
    torque: bool = False  # motor currents are recorded instead of power
    wheels: bool = False  # wheel speeds are recorded instead of the body's
    slope_known: bool = False
    placed: bool = False  # heading and distance from the base are recorded

    @property
    def ground(self) -> Ground:
        """Ground of the calibration of the robot file."""
        return self.trips[0].world.ground


Build = Callable[[np.random.Generator], Scenario]


def turning(rng: np.random.Generator) -> Scenario:
    """Bends, slalom, figures of eight and turns on the spot."""
    world = World(_hard(rng))
    drives = [tour(rng, RUN_S, speed) for speed in rng.uniform(0.4, 0.85, 2)]
    drives += [on_the_spot(rng, 90.0), tour(rng, RUN_S, rng.uniform(0.4, 0.7)), _steady(rng)]
    return Scenario(("turning",), _rover(rng), _trips(world, drives))


def inertia(rng: np.random.Generator) -> Scenario:
    """A heavy rover with fast starts and stops, and one steady drive."""
    world = World(replace(_hard(rng), sliding=0.85))
    drives = [stop_and_go(rng, RUN_S) for _ in range(3)] + [_steady(rng)]
    return Scenario(("inertia",), replace(_rover(rng), mass_kg=62.0), _trips(world, drives))


def slip(rng: np.random.Generator) -> Scenario:
    """Steep hills on loose ground, the slope known: the wheels turn faster than the rover goes."""
    world = World(Ground(0.28, 0.08), slope=_hills(rng.uniform(0.14, 0.16)))
    trips = _there_and_back(world, [_steady(rng, 0.45) for _ in range(4)])
    return Scenario(("slip",), _rover(rng), trips, slope_known=True)


def surface(rng: np.random.Generator) -> Scenario:
    """Straight over soft stretches, out and back to distinguish them from slopes, and once on soft
    ground alone."""
    hard = _hard(rng)
    soft = Ground(0.9 * hard.sliding, rng.uniform(1.6, 2.6) * hard.rolling)
    edges = np.cumsum(rng.uniform(6.0, 13.0, 4))
    world = World(hard, ((edges[0], edges[1], soft), (edges[2], edges[3], soft)))
    trips = _there_and_back(world, [_steady(rng) for _ in range(3)])
    alone = _trips(World(hard, ((-99.0, 999.0, soft),)), [_steady(rng)])
    return Scenario(("surface",), _rover(rng), trips + alone, placed=True)


def payload(rng: np.random.Generator) -> Scenario:
    """Sacks loaded and unloaded between runs, and during one."""
    world = World(_hard(rng))
    loads = rng.uniform(12.0, 28.0, 2)
    slow = _steady(rng, 0.3, 0.5)
    fast = _steady(rng, 0.6, 0.8)
    any_speed = _steady(rng)
    trips = _loaded(
        _trips(world, [slow, slow, fast, fast, any_speed]), (0.0, loads[0], 0.0, loads[1], 0.0)
    )
    ticks = trips[4].speed_mps.size
    from_half_on_kg = np.where(np.arange(ticks) < ticks // 2, 0.0, loads[0])
    return Scenario(
        ("payload",), _rover(rng), (*trips[:4], replace(trips[4], payload_kg=from_half_on_kg))
    )


def payload_on_hills(rng: np.random.Generator) -> Scenario:
    """The same on known hills, which distinguish weight from soft ground."""
    plain = payload(rng)
    hills = _hills(rng.uniform(0.02, 0.03))
    trips = tuple(replace(trip, world=replace(trip.world, slope=hills)) for trip in plain.trips)
    return replace(plain, trips=trips, wheels=True, slope_known=True)


def hidden_grade(rng: np.random.Generator) -> Scenario:
    """Out over a hill and back, without a recorded slope."""
    world = World(_hard(rng), slope=_hills(rng.uniform(0.025, 0.04)))
    trips = _there_and_back(world, [_steady(rng, 0.45) for _ in range(4)])
    return Scenario(("hidden_grade",), _rover(rng), trips, placed=True)


def regeneration(rng: np.random.Generator) -> Scenario:
    """Known hills steep enough for braking, which charges the battery."""
    world = World(_hard(rng), slope=_hills(rng.uniform(0.11, 0.14)))
    trips = _there_and_back(world, [_steady(rng, 0.45) for _ in range(4)])
    rover = replace(_rover(rng), recovery=rng.uniform(0.5, 0.8))
    return Scenario(("regeneration",), rover, trips, wheels=True, slope_known=True)


def turning_and_surface(rng: np.random.Generator) -> Scenario:
    """Tours, some of them over soft ground."""
    hard = _hard(rng)
    drives = [tour(rng, RUN_S, speed) for speed in rng.uniform(0.45, 0.8, 4)]
    soft = World(hard, ((-999.0, 999.0, replace(hard, rolling=2.2 * hard.rolling)),))
    edge = World(hard, ((10.0, 999.0, replace(hard, rolling=2.2 * hard.rolling)),))
    trips = (
        _trips(World(hard), drives[:1])
        + _trips(soft, drives[1:2])
        + _trips(edge, [*drives[2:], _steady(rng)])
    )
    return Scenario(("turning", "surface"), _rover(rng), trips, placed=True)


def turning_and_payload(rng: np.random.Generator) -> Scenario:
    """Tours with and without sacks."""
    drives = [tour(rng, RUN_S, speed) for speed in rng.uniform(0.45, 0.8, 3)] + [
        _steady(rng),
        _steady(rng),
    ]
    trips = _loaded(_trips(World(_hard(rng)), drives), (0.0, 25.0, 18.0, 0.0, 25.0))
    return Scenario(("turning", "payload"), _rover(rng), trips)


def turning_and_inertia(rng: np.random.Generator) -> Scenario:
    """Tours, and straight drives with fast starts and stops."""
    drives = [tour(rng, RUN_S, speed) for speed in rng.uniform(0.45, 0.8, 2)]
    drives += [stop_and_go(rng, RUN_S), stop_and_go(rng, RUN_S)]
    return Scenario(("turning", "inertia"), _rover(rng), _trips(World(_hard(rng)), drives))


def turning_and_hidden_grade(rng: np.random.Generator) -> Scenario:
    """Out and back over a hill, and tours on level ground, without a recorded slope."""
    ground = _hard(rng)
    trips = _there_and_back(
        World(ground, slope=_hills(0.035)), [_steady(rng, 0.45) for _ in range(3)]
    )
    tours = [tour(rng, RUN_S, rng.uniform(0.45, 0.8)) for _ in range(2)]
    return Scenario(
        ("turning", "hidden_grade"), _rover(rng), trips + _trips(World(ground), tours), placed=True
    )


def surface_and_payload(rng: np.random.Generator) -> Scenario:
    """Straight over soft stretches, with and without sacks."""
    plain = surface(rng)
    return replace(
        plain, truth=("surface", "payload"), trips=_loaded(plain.trips, (0.0, 25.0, 15.0, 0.0))
    )


def inertia_and_payload(rng: np.random.Generator) -> Scenario:
    """Fast starts and stops, and one steady drive, with and without sacks."""
    drives = [*(stop_and_go(rng, RUN_S) for _ in range(3)), _steady(rng), _steady(rng)]
    trips = _loaded(
        _trips(World(replace(_hard(rng), sliding=0.85)), drives), (0.0, 25.0, 0.0, 20.0, 0.0)
    )
    return Scenario(("inertia", "payload"), _rover(rng), trips)


def inertia_and_regeneration(rng: np.random.Generator) -> Scenario:
    """Fast starts and stops of a rover with regeneration."""
    plain = inertia(rng)
    return replace(
        plain,
        truth=("inertia", "regeneration"),
        rover=replace(plain.rover, recovery=rng.uniform(0.6, 0.8)),
    )


def stuck_brake(rng: np.random.Generator) -> Scenario:
    """Bends so wide that scrub is negligible; in left bends a brake drags."""
    drives = []
    for speed in rng.uniform(0.4, 0.8, 4):
        sides = rng.permutation((1.0, 0.0, -1.0, 1.0, -1.0, 0.0))
        drives.append(
            command([Leg(RUN_S / 6, speed, side * speed / 60.0) for side in sides], RUN_S, 0.1)
        )

    def brake(wheels_mps: Array, yaw_radps: float) -> Array:
        return np.array([BRAKE_NM * (yaw_radps > 0.004), 0.0, 0.0, 0.0])

    return Scenario(("stuck_brake",), _rover(rng), _trips(World(_hard(rng)), drives), brake)


def chatter(rng: np.random.Generator) -> Scenario:
    """Straight on, slowly through a band of speeds in which all wheels chatter."""
    ends = ((0.35, 0.62), (0.68, 0.4), (0.42, 0.7), (0.8, 0.55))
    drives = [command([Leg(5.0, a), Leg(70.0, b), Leg(45.0, a)], RUN_S, 0.004) for a, b in ends]

    def brake(wheels_mps: Array, yaw_radps: float) -> Array:
        return np.asarray(
            CHATTER_NM * ((wheels_mps > CHATTER_MPS[0]) & (wheels_mps < CHATTER_MPS[1]))
        )

    return Scenario(("chatter",), _rover(rng), _trips(World(_hard(rng)), drives), brake)


def constant_payload(rng: np.random.Generator) -> Scenario:
    """The same sacks in all drives, which is equivalent to a wrong mass in the file."""
    plain = level(rng)
    return replace(plain, truth=("payload",), trips=_loaded(plain.trips, (18.0,) * 4))


def constant_surface(rng: np.random.Generator) -> Scenario:
    """Soft ground in all drives, which is equivalent to a wrong rolling resistance in the file."""
    plain = level(rng)
    ground = _hard(rng)
    world = World(ground, ((-99.0, 999.0, replace(ground, rolling=1.7 * ground.rolling)),))
    trips = tuple(replace(trip, world=world) for trip in plain.trips)
    return replace(plain, truth=("surface",), trips=trips)


def level(rng: np.random.Generator) -> Scenario:
    """Nothing hidden: straight on over level ground."""
    return Scenario(
        (),
        _rover(rng),
        _trips(World(_hard(rng)), [_steady(rng, change_mps=CONTROL_MPS) for _ in range(4)]),
    )


def hilly(rng: np.random.Generator) -> Scenario:
    """Nothing hidden: straight out and back over a known hill."""
    world = World(_hard(rng), slope=_hills(rng.uniform(0.02, 0.03)))
    trips = _there_and_back(world, [_steady(rng, 0.45, change_mps=0.0) for _ in range(4)])
    return Scenario((), _rover(rng), trips, wheels=True, slope_known=True, placed=True)


def _rover(rng: np.random.Generator) -> Rover:
    return Rover(rng.uniform(45.0, 58.0), rng.uniform(0.62, 0.8), rng.uniform(35.0, 65.0))


def _hard(rng: np.random.Generator) -> Ground:
    return Ground(rng.uniform(0.6, 0.85), rng.uniform(0.045, 0.075))


def _hills(steepness_rad: float) -> tuple[tuple[float, float], ...]:
    return tuple((place_m, steepness_rad * share) for place_m, share in _HILLS)


def _steady(
    rng: np.random.Generator, least_mps: float = 0.3, most_mps: float = 0.9, change_mps: float = 0.1
) -> Command:
    """One speed, or a change to another within a minute, so slow that inertia is negligible."""
    start = rng.uniform(least_mps, most_mps)
    end = np.clip(start + rng.choice((-change_mps, 0.0, change_mps)), 0.3, 0.9)
    return cruise([start, end], RUN_S, acceleration_mps2=change_mps / 60.0)


def _trips(world: World, drives: list[Command]) -> tuple[Trip, ...]:
    return tuple(Trip(speed, yaw, np.zeros(speed.size), world) for speed, yaw in drives)


def _there_and_back(world: World, drives: list[Command]) -> tuple[Trip, ...]:
    """Every other trip back from the far end; the turns are not recorded."""
    trips = _trips(world, drives)
    return tuple(
        replace(t, start_m=56.0, heading_rad=np.pi) if i % 2 else t for i, t in enumerate(trips)
    )


def _loaded(trips: tuple[Trip, ...], loads_kg: tuple[float, ...]) -> tuple[Trip, ...]:
    loads = zip(trips, loads_kg, strict=True)
    return tuple(
        replace(trip, payload_kg=np.full(trip.speed_mps.size, load)) for trip, load in loads
    )
