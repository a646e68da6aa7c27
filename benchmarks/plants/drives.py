"""Journeys of the plants: how speed, turning, slope, sensing rate and weather go in the runs of each kind of robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from homeward.physics import Robot

Array = NDArray[np.float64]
Range = tuple[float, float]


@dataclass(frozen=True)
class Drive:
    """What a robot truly did in one run; arrays of shape (n,)."""

    number: int  # of the run, from 0
    start_s: float  # on a clock that runs on through all runs
    step_s: float
    speed_mps: Array
    yaw_radps: Array
    heading_rad: Array
    grade_rad: Array  # known ground; a hidden slope is an effect
    distance_m: Array
    place_m: Array  # along the route from the base, falling on the way back
    outward: Array  # 1 on the way out, -1 on the way back
    base_m: Array  # as the crow flies
    sensing_hz: Array
    temperature_c: Array

    @property
    def time_s(self) -> Array:
        """Time since the start of the run, s."""
        return np.asarray(np.arange(self.speed_mps.size) * self.step_s, dtype=np.float64)

    @property
    def acceleration_mps2(self) -> Array:
        """Change of the speed, m/s^2."""
        return np.asarray(np.gradient(self.speed_mps, self.step_s))


@dataclass(frozen=True)
class Profile:
    """A kind of journey; ranges are drawn from uniformly, speeds and rates are shares of the robot's highest."""

    speeds: tuple[float, ...] = (0.0, 0.3, 0.5, 0.75, 1.0)
    dwell_s: Range = (8.0, 25.0)
    acceleration_mps2: float = 0.4
    turns_per_minute: float = 3.0
    turn_radps: Range = (0.2, 0.8)
    slope_rad: float = 0.0
    sharpness: int = 1  # above 1, long flats and short steep hills
    wave_s: Range = (15.0, 60.0)  # length of a hill over the top speed
    sensing: tuple[float, ...] = (0.2, 1.0)
    sensing_dwell_s: Range = (20.0, 60.0)
    duration_s: Range = (150.0, 280.0)
    runs: tuple[int, int] = (4, 6)
    temperature_c: Range = (12.0, 24.0)  # at the start of a run
    warming_c: Range = (-3.0, 3.0)  # by its end


PROFILES: dict[str, Profile] = {
    "patrol": Profile(slope_rad=0.03),
    "hills": Profile(slope_rad=0.1, speeds=(0.0, 0.25, 0.4, 0.7, 1.0), turns_per_minute=1.5),
    "survey": Profile(slope_rad=0.02, sensing=(0.0, 0.15, 0.4, 1.0), sensing_dwell_s=(10.0, 35.0),
                      speeds=(0.0, 0.0, 0.3, 0.6, 1.0)),
    "expedition": Profile(speeds=(0.0, 0.7, 1.0), turns_per_minute=0.4, slope_rad=0.03, duration_s=(200.0, 300.0)),
    "indoor": Profile(speeds=(0.0, 0.0, 0.4, 0.8, 1.0), dwell_s=(5.0, 15.0), acceleration_mps2=0.6,
                      turns_per_minute=6.0, sensing=(0.5, 1.0), temperature_c=(20.0, 23.0), warming_c=(-0.5, 0.5)),
    "shuttle": Profile(speeds=(0.0, 0.6, 0.0, 1.0), dwell_s=(5.0, 9.0), acceleration_mps2=0.9, turns_per_minute=2.0,
                       slope_rad=0.015),
    "creep": Profile(speeds=(0.0, 0.0, 0.0, 0.05, 0.08, 0.12, 1.0), dwell_s=(6.0, 18.0), acceleration_mps2=0.8,
                     slope_rad=0.05),
    "corners": Profile(turns_per_minute=9.0, turn_radps=(0.3, 1.4), slope_rad=0.02),
    "urban": Profile(speeds=(0.0, 0.35, 0.55, 0.8, 1.0), dwell_s=(15.0, 50.0), acceleration_mps2=0.7,
                     turns_per_minute=1.5, turn_radps=(0.1, 0.4), slope_rad=0.025, wave_s=(20.0, 80.0),
                     duration_s=(350.0, 550.0), sensing=(0.3, 1.0)),
    "avenue": Profile(speeds=(0.45, 0.55, 0.65, 0.8), dwell_s=(40.0, 100.0), acceleration_mps2=0.6,
                      turns_per_minute=1.0, turn_radps=(0.1, 0.3), slope_rad=0.02, wave_s=(20.0, 80.0),
                      duration_s=(400.0, 600.0), sensing=(0.3, 1.0)),
    "upland": Profile(speeds=(0.3, 0.5, 0.7, 1.0), dwell_s=(25.0, 60.0), acceleration_mps2=0.25,
                      turns_per_minute=1.0, turn_radps=(0.05, 0.2), slope_rad=0.06, wave_s=(30.0, 90.0),
                      duration_s=(350.0, 550.0)),
    "passes": Profile(speeds=(0.0, 0.25, 0.5, 0.75, 1.0), acceleration_mps2=0.6, turns_per_minute=1.5,
                      turn_radps=(0.1, 0.3), slope_rad=0.06, sharpness=2, wave_s=(10.0, 40.0),
                      duration_s=(300.0, 450.0), sensing=(0.0, 1.0)),
    "depot": Profile(speeds=(0.0, 0.4, 0.7, 1.0), slope_rad=0.02, duration_s=(300.0, 420.0), runs=(5, 6)),
    "climate": Profile(slope_rad=0.03, temperature_c=(-18.0, 22.0), warming_c=(-8.0, 8.0), runs=(5, 6)),
    "winter": Profile(slope_rad=0.02, temperature_c=(-8.0, 14.0), warming_c=(-12.0, 12.0)),
    "frost": Profile(speeds=(0.0, 0.4, 0.7, 1.0), dwell_s=(15.0, 50.0), acceleration_mps2=0.5, turns_per_minute=1.5,
                     turn_radps=(0.1, 0.4), slope_rad=0.02, wave_s=(20.0, 80.0), duration_s=(350.0, 550.0),
                     temperature_c=(-12.0, 10.0), warming_c=(-8.0, 12.0)),
}  # fmt: skip


def coloured(n: int, memory_s: float, step_s: float, rng: np.random.Generator) -> Array:
    """First-order autoregressive noise of unit variance, from its stationary distribution; array of shape (n,)."""
    keep = np.exp(-step_s / memory_s)
    start = rng.standard_normal()
    return np.asarray(
        lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(n), zi=np.array([keep * start]))[0]
    )


def lagged(signal: Array, memory_s: float, step_s: float) -> Array:
    """First-order lag of a signal, from its first value on; array of its shape."""
    keep = np.exp(-step_s / memory_s)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], signal, zi=np.array([keep * signal[0]]))[0])


def journeys(robot: Robot, profile: Profile, rng: np.random.Generator, step_s: float = 0.1) -> tuple[Drive, ...]:
    """All runs of one recording session: out from the base and back along a road that is the same in every run.

    Args:
        robot: Sets top speed and highest sensing rate.
        profile: Kind of journey.
        rng: Where chance comes from.
        step_s: Sampling interval, s.
    """
    waves = rng.uniform(*profile.wave_s, 3) * robot.max_speed_mps, rng.uniform(0.0, 2 * np.pi, 3)
    drives, start_s = [], 0.0
    for number in range(rng.integers(profile.runs[0], profile.runs[1] + 1)):
        drives.append(_journey(robot, profile, waves, rng, step_s, number, start_s))
        start_s += drives[-1].time_s[-1] + rng.uniform(60.0, 900.0)
    return tuple(drives)


def _journey(
    robot: Robot, profile: Profile, waves: tuple[Array, Array], rng: np.random.Generator, step_s: float, number: int,
    start_s: float,
) -> Drive:  # fmt: skip
    n = round(rng.uniform(*profile.duration_s) / step_s)
    outward = _outward(n, step_s)
    speed = _speed(n, robot, profile, rng, step_s)
    distance = np.cumsum(speed) * step_s
    place = np.abs(np.cumsum(speed * outward) * step_s)
    yaw = _yaw(speed, profile, rng, step_s)
    heading = rng.uniform(-np.pi, np.pi) + np.cumsum(yaw) * step_s
    base = place * (0.93 + 0.03 * np.sin(place / (30.0 * robot.max_speed_mps)))  # the road winds a little
    waviness = sum(np.sin(2 * np.pi * place / length + phase) for length, phase in zip(*waves, strict=True)) / 2.0
    slope = np.sign(waviness) * np.abs(waviness) ** profile.sharpness
    temperature = rng.uniform(*profile.temperature_c) + np.linspace(0.0, rng.uniform(*profile.warming_c), n)
    return Drive(
        number=number, start_s=start_s, step_s=step_s, speed_mps=speed, yaw_radps=yaw, heading_rad=heading,
        grade_rad=profile.slope_rad * outward * slope, distance_m=distance, place_m=place,
        outward=outward, base_m=base,
        sensing_hz=robot.max_sensing_hz * _held(n, profile.sensing, profile.sensing_dwell_s, rng, step_s),
        temperature_c=temperature + 0.2 * coloured(n, 20.0, step_s, rng),
    )  # fmt: skip


def _outward(n: int, step_s: float) -> Array:
    """1 on the way out and -1 on the way back, and in between for the four seconds that the half turn takes; (n,)."""
    return np.clip((0.5 * n - np.arange(n)) * step_s / 2.0, -1.0, 1.0)


def _held(n: int, levels: tuple[float, ...], dwell_s: Range, rng: np.random.Generator, step_s: float) -> Array:
    """Levels in random order, each held for a while and never twice in a row unless listed twice; (n,)."""
    held: list[Array] = []
    last = -1
    while sum(part.size for part in held) < n:
        last = int(rng.choice([index for index in range(len(levels)) if index != last]))
        held.append(np.full(round(rng.uniform(*dwell_s) / step_s), levels[last]))
    return np.concatenate(held)[:n]


def _speed(n: int, robot: Robot, profile: Profile, rng: np.random.Generator, step_s: float) -> Array:
    target = robot.max_speed_mps * _held(n, profile.speeds, profile.dwell_s, rng, step_s)
    most = profile.acceleration_mps2 * step_s
    speed = np.empty(n)
    now = 0.0
    for index, wanted in enumerate(target):
        now += min(max(wanted - now, -1.3 * most), most)
        speed[index] = now
    wobble = 1.0 + 0.01 * lagged(coloured(n, 8.0, step_s, rng), 2.0, step_s)
    return np.minimum(lagged(speed, 0.3, step_s) * wobble, robot.max_speed_mps) * (speed > 1e-3)


def _yaw(speed: Array, profile: Profile, rng: np.random.Generator, step_s: float) -> Array:
    """Corners at random moments, and the way back begun with half a turn; slower where the robot is fast; (n,)."""
    n = speed.size
    yaw = np.zeros(n)
    moments = rng.uniform(0.0, n, rng.poisson(profile.turns_per_minute * n * step_s / 60.0)).astype(int)
    for moment, angle in [*((at, rng.choice((-1, 1)) * rng.uniform(0.4, 2.2)) for at in moments), (n // 2, np.pi)]:
        fastest = min(rng.uniform(*profile.turn_radps), 2.5 / max(speed[min(moment + 10, n - 1)], 0.1))
        length = max(int(abs(angle) * np.pi / 2 / fastest / step_s), 2)  # half a sine has 2 / pi of its peak on average
        stretch = slice(moment, min(moment + length, n))
        yaw[stretch] += np.sign(angle) * fastest * np.sin(np.pi * np.arange(length) / length)[: stretch.stop - moment]
    return yaw
