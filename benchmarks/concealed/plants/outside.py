"""Mechanisms outside the catalogue, and the effects, if any, that would be an acceptable
description of each."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from benchmarks.concealed.plants.chain import Change, Mechanism, Stage, Work
from benchmarks.concealed.plants.effects import (
    first_order,
    ornstein_uhlenbeck,
    since,
    since_start_m,
)
from benchmarks.concealed.plants.vehicles import Plant, rolling_power_w, typical_power_w

Fair = frozenset[str]
DrawOutside = Callable[[Plant, Generator, int], tuple[Stage, Change, Fair]]


def furrows(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """Ploughed ground: more rolling resistance across the furrows than along them, the same there
    and back."""
    along_rad = rng.uniform(0.0, np.pi)
    gain = rng.uniform(0.4, 1.0)

    def change(work: Work, _: Generator) -> None:
        work.rolling *= 1.0 + gain * np.sin(work.run.heading_rad - along_rad) ** 2

    return "ground", change, frozenset()


def squealing_bearing(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """A bearing that runs dry above a temperature, and recovers only well below it."""
    rise_s = rng.uniform(60.0, 150.0)
    gain = rng.uniform(0.4, 0.9)
    trip = rng.uniform(0.55, 0.7)

    def change(work: Work, _: Generator) -> None:
        heat = first_order(work.run.speed_mps / vehicle.robot.max_speed_mps, work.run.dt_s, rise_s)
        dry = False
        for i, level in enumerate(heat / max(float(heat.max()), 1e-9)):
            limit = trip - 0.15 if dry else trip
            dry = level > limit
            if dry:
                work.rolling[i] *= 1.0 + gain

    return "ground", change, frozenset()


def speed_coupled_pump(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """A spray pump with a fixed stroke, whose rate follows the speed: pulses occur per distance
    driven."""
    size_w = typical_power_w(vehicle) * rng.uniform(0.3, 0.6)
    stroke_m = vehicle.leg_m * rng.uniform(0.15, 0.3)

    def change(work: Work, _: Generator) -> None:
        moving = work.run.speed_mps > 0.0
        work.ancillary_w += size_w * (np.mod(work.run.distance_m / stroke_m, 1.0) < 0.4) * moving

    return "load", change, frozenset({"intermittent_load"})


def hiccup_converter(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """A converter that leaves its efficient mode above a load, for some seconds at least."""
    limit = rng.uniform(0.9, 1.3)
    loss = rng.uniform(0.15, 0.3)

    def change(work: Work, _: Generator) -> None:
        over = (work.drive_w + work.ancillary_w > limit * typical_power_w(vehicle)).astype(
            np.float64
        )
        in_mode = first_order(over, work.run.dt_s, 8.0) > 0.3
        work.ancillary_w += loss * in_mode * (work.drive_w + work.ancillary_w)

    return "load", change, frozenset()


def cold_tyres(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """Tyres with more rolling resistance until warm; they cool while standing (SAE J2452: half an
    hour)."""
    gain = rng.uniform(0.5, 1.0)
    warm_s = rng.uniform(100.0, 250.0)

    def change(work: Work, _: Generator) -> None:
        warm = first_order((work.run.speed_mps > 0.0).astype(np.float64), work.run.dt_s, warm_s)
        work.rolling *= 1.0 + gain * (1.0 - warm)

    return "ground", change, frozenset()


def clinging_mud(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """Mud that accumulates with distance and falls off whenever the vehicle stands."""
    gain = rng.uniform(0.6, 1.2)
    way_m = vehicle.robot.max_speed_mps * rng.uniform(15.0, 35.0)

    def change(work: Work, _: Generator) -> None:
        work.rolling *= 1.0 + gain * (1.0 - np.exp(-since_start_m(work.run) / way_m))

    return "ground", change, frozenset()


def slow_puncture(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """A tyre that leaks in one drive; rolling resistance varies as pressure^-0.4 (Clark, Mechanics
    of Tires)."""
    drive = int(rng.integers(0, runs))
    leak_s = rng.uniform(60.0, 120.0)

    def change(work: Work, _: Generator) -> None:
        leaking = since(work.run, drive, 0.2).astype(np.float64) * work.run.dt_s
        gone_s = np.cumsum(leaking) + (1e4 if work.run.index > drive else 0.0)
        work.rolling *= (0.12 + 0.88 * np.exp(-gone_s / leak_s)) ** -0.4

    return "ground", change, frozenset({"surface"})


def sticking_brake(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """A brake that releases slowly after a stop longer than some seconds, but not after a short
    one."""
    gain = rng.uniform(1.5, 3.0)
    free_s = rng.uniform(6.0, 15.0)

    def change(work: Work, _: Generator) -> None:
        stood_s = 0.0
        driven_s = 0.0
        grip = 0.0
        for i, speed in enumerate(work.run.speed_mps):
            if speed == 0.0:
                stood_s = stood_s + work.run.dt_s
                driven_s = 0.0
                grip = 1.0 if stood_s > 10.0 else grip
            else:
                stood_s = 0.0
                driven_s = driven_s + work.run.dt_s
                work.rolling[i] *= 1.0 + gain * grip * np.exp(-driven_s / free_s)

    return "ground", change, frozenset({"breakaway"})


def solar_panel(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """A solar panel under passing clouds feeds the bus (cloud shadows last some minutes)."""
    size_w = typical_power_w(vehicle) * rng.uniform(0.2, 0.4)
    minutes_s = rng.uniform(60.0, 150.0)

    def change(work: Work, clouds: Generator) -> None:
        sky = ornstein_uhlenbeck(clouds, work.run.time_s.size, work.run.dt_s, 1.0, minutes_s)
        work.ancillary_w -= size_w / (1.0 + np.exp(-3.0 * sky))

    return "load", change, frozenset()


def washboard(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """Corrugated ground shakes the suspension at one speed: a resonance (Wong, ch. 7)."""
    resonance = rng.uniform(0.4, 0.75)
    width = rng.uniform(0.06, 0.1)
    gain = rng.uniform(0.8, 1.6)

    def change(work: Work, _: Generator) -> None:
        detuning = (work.run.speed_mps / vehicle.robot.max_speed_mps - resonance) / width
        work.rolling *= 1.0 + gain / (1.0 + detuning**2)

    return "ground", change, frozenset()


def damaged_steering(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """A bent linkage that consumes power while turning left, but not while turning right."""
    gain = rng.uniform(0.8, 1.6)

    def change(work: Work, _: Generator) -> None:
        leftward = np.tanh(
            np.maximum(work.run.yaw_rate_radps, 0.0) / (0.1 * vehicle.max_turn_radps)
        )
        work.drive_w += gain * rolling_power_w(vehicle) * leftward

    return "motor", change, frozenset({"turning"})


def cooling_fan(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """A fan that switches on when the motor is hot and off when it is cool."""
    size_w = typical_power_w(vehicle) * rng.uniform(0.25, 0.5)
    heat_s = rng.uniform(40.0, 100.0)

    def change(work: Work, _: Generator) -> None:
        heat = first_order(work.drive_w / rolling_power_w(vehicle), work.run.dt_s, heat_s)
        high = float(np.quantile(heat, 0.6))
        on = False
        for i, level in enumerate(heat):
            limit = 0.7 * high if on else high
            on = level > limit
            if on:
                work.ancillary_w[i] += size_w

    return "load", change, frozenset({"intermittent_load"})


def hill_descent(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """Hill descent control holds the vehicle back with the motors against each other: descents cost
    power."""
    gain = rng.uniform(0.5, 1.0)

    def change(work: Work, _: Generator) -> None:
        steep = np.clip((-work.run.grade_rad - 0.01) / (0.5 * vehicle.steepest_grade_rad), 0.0, 1.0)
        work.drive_w += gain * rolling_power_w(vehicle) * steep * (work.run.speed_mps > 0.0)

    return "motor", change, frozenset()


def altitude_switch(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """An instrument that works only above a height of the route, as one with a line of sight to a
    mast does."""
    size_w = typical_power_w(vehicle) * rng.uniform(0.25, 0.5)
    share = rng.uniform(0.45, 0.6)

    def change(work: Work, _: Generator) -> None:
        height = work.run.elevation_m
        work.ancillary_w += size_w * (height > np.quantile(height, share))

    return "load", change, frozenset()


def growing_bursts(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """A gripper that jams a little more each time it closes; it closes at random times."""
    size_w = typical_power_w(vehicle) * rng.uniform(0.2, 0.3)
    every_s = rng.uniform(25.0, 50.0)

    def change(work: Work, jitter: Generator) -> None:
        at_s = float(jitter.exponential(every_s))
        times = 0
        while at_s < work.run.time_s[-1]:
            burst = (work.run.time_s >= at_s) & (work.run.time_s < at_s + jitter.uniform(3.0, 12.0))
            work.ancillary_w += size_w * (1.0 + 0.3 * times) * burst
            at_s = at_s + float(jitter.exponential(every_s)) + 5.0
            times = times + 1

    return "load", change, frozenset({"intermittent_load"})


def shower(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """Rain wets the ground in one drive, and the ground dries; wipers or a blower run while it
    lasts."""
    drive = int(rng.integers(0, runs))
    start = rng.uniform(0.2, 0.4)
    gain = rng.uniform(0.5, 1.0)

    def change(work: Work, _: Generator) -> None:
        if work.run.index == drive:
            share = work.run.time_s / work.run.time_s[-1]
            raining = ((share > start) & (share < start + 0.35)).astype(np.float64)
            work.rolling *= 1.0 + gain * first_order(raining, work.run.dt_s, 30.0)

    return "ground", change, frozenset({"surface"})


def speed_memory(vehicle: Plant, rng: Generator, runs: int) -> tuple[Stage, Change, Fair]:
    """A gearbox that heats its oil into foam after fast driving: losses follow the fastest speed of
    the last minute."""
    gain = rng.uniform(0.5, 1.0)
    minute_s = rng.uniform(40.0, 80.0)

    def change(work: Work, _: Generator) -> None:
        memory = 0.0
        forget = float(np.exp(-work.run.dt_s / minute_s))
        for i, speed in enumerate(work.run.speed_mps / vehicle.robot.max_speed_mps):
            memory = max(speed, memory * forget)
            work.rolling[i] *= 1.0 + gain * memory**3

    return "ground", change, frozenset()


OUTSIDE: dict[str, DrawOutside] = {
    draw.__name__: draw
    for draw in (
        furrows, squealing_bearing, speed_coupled_pump, hiccup_converter, cold_tyres, clinging_mud, slow_puncture,
        sticking_brake, solar_panel, washboard, damaged_steering, cooling_fan, hill_descent, altitude_switch,
        growing_bursts, shower, speed_memory,
    )
}  # fmt: skip
"""Every mechanism outside the catalogue, with the function that draws it."""


def make_outside(name: str, vehicle: Plant, rng: Generator, runs: int) -> tuple[Mechanism, Fair]:
    """Draw a mechanism by name, and the effects that would be an acceptable description."""
    stage, change, fair = OUTSIDE[name](vehicle, rng, runs)
    return Mechanism(name, stage, change), fair
