"""Hidden loads beside the drive, and three that no catalogue names, each in a form of its own making.

A comment or docstring names the behaviour that is meant; amplitudes are shapes only, scaled to a share of the energy.
"""

from __future__ import annotations

import numpy as np

from benchmarks.plants.drives import Array, Drive, coloured, lagged
from benchmarks.plants.forces import Effort, World


def standby(world: World) -> list[Effort]:
    """A device switched on part-way in one run and left on, which takes a few seconds to come up."""
    rng = world.rng
    switched, moment = int(rng.integers(1, len(world.drives) - 1)), rng.uniform(0.25, 0.7)

    def power(drive: Drive) -> Array:
        n = drive.speed_mps.size
        on_s = (np.arange(n) - (moment * n if drive.number == switched else 0)) * drive.step_s
        level = 1.0 - np.exp(-np.maximum(on_s, 0.0) / 5.0) if drive.number == switched else np.ones(n)
        return np.asarray((drive.number >= switched) * level * (1.0 + 0.04 * coloured(n, 3.0, drive.step_s, rng)))

    return world.adding(power=power)


def compute(world: World) -> list[Effort]:
    """Mapping that works while the robot moves: the load saturates with the sensing rate and follows a little late."""
    bend = world.rng.uniform(1.5, 3.0)

    def power(drive: Drive) -> Array:
        busy = lagged((drive.speed_mps > 0.0).astype(np.float64), 1.5, drive.step_s)
        rate = drive.sensing_hz / world.robot.max_sensing_hz
        return np.asarray((1.0 - np.exp(-bend * rate)) * (0.06 + 0.94 * busy))

    return world.adding(power=power)


def radio(world: World) -> list[Effort]:
    """Transmit power that rises with a power of the distance, or by steps as the link falls back to slower rates."""
    farthest = max(float(drive.base_m.max()) for drive in world.drives)
    power_of, stepped = world.rng.uniform(2.0, 3.3), bool(world.rng.integers(2))
    falls_back = np.array([0.25, 0.45, 0.65, 0.85])
    airtime = np.array([0.0, 0.1, 0.3, 0.6, 1.0])

    def power(drive: Drive) -> Array:
        away = drive.base_m / farthest
        return np.asarray(airtime[np.searchsorted(falls_back, away)] if stepped else away**power_of)

    return world.adding(power=power)


def heater(world: World) -> list[Effort]:
    """Below a temperature, with hysteresis: a bimetal switch, or an element that draws more the colder it is."""
    rng = world.rng
    coldest = min(float(drive.temperature_c.min()) for drive in world.drives)
    warmest = max(float(drive.temperature_c.max()) for drive in world.drives)
    below_c = coldest + rng.uniform(0.4, 0.6) * (warmest - coldest)
    switched = bool(rng.integers(2))

    def power(drive: Drive) -> Array:
        on = False
        level = np.zeros(drive.speed_mps.size)
        for index, air_c in enumerate(drive.temperature_c):
            on = air_c < below_c + 1.5 if on else air_c < below_c
            level[index] = on * (1.0 if switched else 0.35 + np.tanh((below_c + 1.5 - air_c) / 8.0))
        return lagged(level, 2.0, drive.step_s)

    return world.adding(power=power)


def intermittent_load(world: World) -> list[Effort]:
    """A camera light: on and off for irregular times, or at a nearly regular beat; it starts with an inrush."""
    rng = world.rng
    regular, beat_s, duty = bool(rng.integers(2)), rng.uniform(18.0, 40.0), rng.uniform(0.3, 0.5)

    def power(drive: Drive) -> Array:
        level = np.zeros(drive.speed_mps.size)
        now_s, end_s = rng.uniform(0.0, beat_s), level.size * drive.step_s
        while now_s < end_s:
            spread = 0.04 if regular else 0.6
            on_s, off_s = beat_s * np.array([duty, 1.0 - duty]) * rng.gamma(spread**-2, spread**2, 2)
            begin = int(now_s / drive.step_s)
            level[begin : begin + int(on_s / drive.step_s)] = 1.0
            level[begin : begin + 3] *= 1.3
            now_s += on_s + off_s
        return level

    return world.adding(power=power)


def sector_and_hour(world: World) -> list[Effort]:
    """Outside the catalogue: a sun shade's motor that works in one sector of the heading at some hours."""
    middle, period_s = world.rng.uniform(-np.pi, np.pi), world.rng.uniform(500.0, 900.0)

    def power(drive: Drive) -> Array:
        hour = np.maximum(np.sin(2 * np.pi * (drive.start_s + drive.time_s) / period_s), 0.0)
        return np.asarray((np.cos(drive.heading_rad - middle) > 0.3) * (0.4 + hour))

    return world.adding(power=power)


def levelling_pump(world: World) -> list[Effort]:
    """Outside the catalogue: a pump that levels the platform, its work the product of pitch either way and speed."""
    return world.adding(
        power=lambda drive: lagged(np.abs(np.sin(drive.grade_rad)) ** 1.3 * drive.speed_mps**1.5, 0.8, drive.step_s)
    )


def beating_drag(world: World) -> list[Effort]:
    """Outside the catalogue: a fairing that flutters with a slow beat, with the fourth power of speed."""
    beat_s = world.rng.uniform(35.0, 60.0)

    def power(drive: Drive) -> Array:
        flutter = np.maximum(np.sin(2 * np.pi * (drive.start_s + drive.time_s) / beat_s), 0.0)
        return np.asarray((drive.speed_mps / world.robot.max_speed_mps) ** 4 * flutter)

    return world.adding(power=power)


OUTSIDE = {
    "power with the heading's sector and the hour": sector_and_hour,
    "pump with |pitch| times speed": levelling_pump,
    "slow beat times the fourth power of speed": beating_drag,
}
