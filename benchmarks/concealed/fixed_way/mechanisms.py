"""What a drive's motion or the time makes of hidden parts, as series of the drive."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from benchmarks.concealed.fixed_way.drive import Drive
from benchmarks.concealed.fixed_way.noise import Array

CHATTER_MPS = (0.39, 0.56)  # chosen: a drive chatters between these speeds
CHATTER_EDGE_MPS = 0.02  # chosen: where it begins and ends gradually

WARMING_S = 180.0  # chosen: in which a gearbox warms up while it drives
COOLING_S = 1200.0  # chosen: in which it cools while it stands

SHORTEST_S = 12.0  # chosen: for which a device stays as it is

SWITCH_ON_C = 26.0  # chosen: inside a box of electronics
SWITCH_OFF_C = 22.0  # chosen
INSIDE_C = (22.5, 25.5)  # chosen: inside at the start
RUNNING_AT_START = 0.4  # chosen: probability
HEATED_BY_K = 3.0  # chosen: inside above the air, without cooling
COOLED_BY_K = 22.0  # chosen: less with it
BOX_S = 300.0  # chosen: time constant of the box


def chatter_share(speed_mps: Array, most_share: float) -> Array:
    """Additional power of a drive that chatters in a band of speeds, as a share, shape (n,)."""
    low_mps, high_mps = CHATTER_MPS
    begun = np.clip((speed_mps - low_mps) / CHATTER_EDGE_MPS, 0, 1)
    not_ended = np.clip((high_mps - speed_mps) / CHATTER_EDGE_MPS, 0, 1)
    return np.asarray(most_share * begun * not_ended, dtype=np.float64)


def warmth(drive: Drive) -> Array:
    """How warm a gearbox is, from 0 at the start of a drive towards 1, shape (n,)."""
    level = 0.0
    levels = np.empty(len(drive.speed_mps))
    for index, speed_mps in enumerate(drive.speed_mps):
        change_per_s = -level / COOLING_S
        if speed_mps > 0:
            change_per_s = (1 - level) / WARMING_S
        level += change_per_s * drive.dt_s
        levels[index] = level
    return levels


def switched(rng: Generator, time_s: Array, on_s: float, off_s: float) -> Array:
    """1 while a device is on and 0 while it is off, for exponentially distributed times, shape
    (n,).

    Args:
        rng: Random numbers.
        time_s: Times, s, shape (n,).
        on_s: Mean time for which it is on, s.
        off_s: Mean time for which it is off, s.
    """
    is_on = rng.random() < on_s / (on_s + off_s)
    since_s = 0.0
    series = np.zeros(len(time_s))
    while since_s < time_s[-1]:
        mean_s = on_s if is_on else off_s
        until_s = since_s + (SHORTEST_S + rng.exponential(mean_s - SHORTEST_S))
        series[(time_s >= since_s) & (time_s < until_s)] = is_on
        since_s = until_s
        is_on = not is_on
    return series


def thermostat(rng: Generator, drive: Drive, air_c: float) -> Array:
    """1 while a compressor cools a box of electronics and 0 while it does not, shape (n,).

    Args:
        rng: Random numbers.
        drive: The drive.
        air_c: Temperature of the air, °C.
    """
    inside_c = rng.uniform(*INSIDE_C)
    runs = rng.random() < RUNNING_AT_START
    series = np.empty(len(drive.time_s))
    for index in range(len(series)):
        settled_c = air_c + HEATED_BY_K - COOLED_BY_K * runs
        inside_c += (settled_c - inside_c) / BOX_S * drive.dt_s
        runs = inside_c > SWITCH_ON_C or (runs and inside_c > SWITCH_OFF_C)
        series[index] = runs
    return series


def taken_up(drive: Drive, at_m: float, after_s: float) -> Array:
    """0 until something is taken up at a stop, and 1 from then on, shape (n,).

    Args:
        drive: The drive.
        at_m: Where the stop is, m driven since the start.
        after_s: Time since the start of the stop, s.
    """
    near_m = 0.05  # chosen: a stop ends the way a step early or late
    is_stop = (drive.driven_m >= at_m - near_m) & (drive.speed_mps == 0)
    first = int(np.flatnonzero(is_stop)[0])
    series = np.zeros(len(drive.time_s))
    series[first + int(after_s / drive.dt_s) :] = 1.0
    return series
