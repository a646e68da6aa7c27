"""Commands of the rover's drives: cruises, stop and go, tours with bends, turns on the spot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.plants.motion import Array

TICKS_PER_S = 50  # of commands; chosen
YAW_RADPS2 = 0.3  # most change of the yaw rate
Command = tuple[Array, Array]
"""Speed, m/s, and yaw rate, rad/s, of shape (n,) at 50 Hz."""


@dataclass(frozen=True)
class Leg:
    """A speed and a yaw rate, constant or alternating between its two signs with a period."""

    seconds: float
    speed_mps: float
    yaw_radps: float = 0.0
    weave_s: float = np.inf


def command(legs: list[Leg], seconds: float, acceleration_mps2: float) -> Command:
    """Legs in sequence, the last until the end, with limited acceleration and yaw acceleration."""
    speed = []
    yaw = []
    for leg in [*legs, Leg(seconds, legs[-1].speed_mps)]:
        time_s = np.arange(round(leg.seconds * TICKS_PER_S)) / TICKS_PER_S
        speed.append(np.full(time_s.size, leg.speed_mps))
        yaw.append(leg.yaw_radps * (np.sin(2 * np.pi * time_s / leg.weave_s) if np.isfinite(leg.weave_s) else 1.0)
                   * np.ones(time_s.size))  # fmt: skip
    n = round(seconds * TICKS_PER_S)
    return _limited(np.concatenate(speed)[:n], acceleration_mps2), _limited(
        np.concatenate(yaw)[:n], YAW_RADPS2
    )


def cruise(speeds_mps: list[float], seconds: float, acceleration_mps2: float = 0.001) -> Command:
    """Straight on, each speed for the same time, changing so slowly that inertia is negligible."""
    return command(
        [Leg(seconds / len(speeds_mps), speed) for speed in speeds_mps], seconds, acceleration_mps2
    )


def stop_and_go(rng: np.random.Generator, seconds: float) -> Command:
    """Straight on with fast starts and stops, and some cruising in between."""
    legs: list[Leg] = []
    while sum(leg.seconds for leg in legs) < seconds:
        high = rng.uniform(0.6, 1.0)
        low = rng.choice((0.0, 0.0, 0.3))
        legs += [Leg(rng.uniform(3.0, 9.0), high), Leg(rng.uniform(2.0, 5.0), low)]
    return command([Leg(3.0, 0.0), *legs], seconds, rng.uniform(0.8, 1.2))


def tour(rng: np.random.Generator, seconds: float, speed_mps: float) -> Command:
    """At one speed: straight stretches, bends to either side, slalom and figures of eight."""
    legs: list[Leg] = []
    while sum(leg.seconds for leg in legs) < seconds:
        side = rng.choice((-1.0, 1.0))
        yaw = rng.uniform(0.1, 0.35)
        kind = rng.choice(("bend", "bend", "slalom", "eight"))
        legs.append(Leg(rng.uniform(7.0, 16.0), speed_mps))
        if kind == "bend":
            legs.append(Leg(rng.uniform(5.0, 12.0), speed_mps, side * yaw))
        elif kind == "slalom":
            period_s = rng.uniform(6.0, 10.0)
            legs.append(Leg(2 * period_s, speed_mps, side * yaw, period_s))
        else:
            legs += [Leg(2 * np.pi / 0.35, speed_mps, sign * side * 0.35) for sign in (1.0, -1.0)]
    return command(legs, seconds, 0.1)


def on_the_spot(rng: np.random.Generator, seconds: float) -> Command:
    """Turns on the spot with pauses."""
    legs = [Leg(4.0, 0.0)]
    while sum(leg.seconds for leg in legs) < seconds:
        yaw = rng.choice((-1.0, 1.0)) * rng.uniform(0.2, 0.6)
        legs += [Leg(rng.uniform(4.0, 9.0), 0.0, yaw), Leg(rng.uniform(3.0, 7.0), 0.0)]
    return command(legs, seconds, 0.1)


def _limited(wanted: Array, most_per_s: float) -> Array:
    """A series that changes no faster than a limit."""
    limited = np.empty(wanted.size)
    level = wanted[0]
    largest_step = most_per_s / TICKS_PER_S
    for tick, value in enumerate(wanted):
        level += min(max(value - level, -largest_step), largest_step)
        limited[tick] = level
    return limited
