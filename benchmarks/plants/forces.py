"""Hidden effects of the drive, each in a form of its own making: what it adds in force at the wheels and in power.

None follows a formula of the effect catalogue on purpose; a comment names the behaviour that is meant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks.plants import base
from benchmarks.plants.drives import Array, Drive, coloured, lagged
from homeward.physics import Robot


class Effort(NamedTuple):
    """What an effect adds in one run: force at the wheels, N, and power at the battery, W; arrays of shape (n,)."""

    force_n: Array
    power_w: Array


@dataclass(frozen=True)
class World:
    """What an effect may depend on; `forces_n` are those at the wheels with the effects that came before it."""

    robot: Robot
    drives: tuple[Drive, ...]
    forces_n: tuple[Array, ...]
    rng: np.random.Generator

    def adding(self, force: Callable[[Drive], Array] | None = None, power: Callable[[Drive], Array] | None = None
               ) -> list[Effort]:  # fmt: skip
        """One effort per run, from a function of its drive."""
        return [
            Effort(force(d) if force else np.zeros(d.speed_mps.size), power(d) if power else np.zeros(d.speed_mps.size))
            for d in self.drives
        ]


def wind(world: World) -> list[Effort]:
    """Gusts that veer; drag grows a little slower than with the square, and a flank shows more area than the front."""
    rng = world.rng
    strength, veer = rng.uniform(5.0, 9.0), rng.uniform(-np.pi, np.pi)

    def force(drive: Drive) -> Array:
        n = drive.speed_mps.size
        gust = np.maximum(strength * (1.0 + 0.3 * coloured(n, 12.0, drive.step_s, rng)), 0.0)
        towards = veer + 0.35 * coloured(n, 100.0, drive.step_s, rng) - drive.heading_rad
        along, across = drive.speed_mps + gust * np.cos(towards), gust * np.sin(towards)
        relative = np.hypot(along, across) + 1e-9
        pressure = relative**0.85 * along * (1.0 + 0.35 * (across / relative) ** 2)
        return np.asarray(world.robot.drag_ns2_per_m2 * (pressure - drive.speed_mps**1.85))

    return world.adding(force)


def hidden_grade(world: World) -> list[Effort]:
    """An undulating road that no channel shows: the same ground out and back."""
    length = world.rng.uniform(12.0, 50.0, 3) * world.robot.max_speed_mps
    phase, height = world.rng.uniform(0.0, 2 * np.pi, 3), world.rng.uniform(0.2, 1.0, 3)
    weight = world.robot.mass_kg * base.GRAVITY_MPS2

    def force(drive: Drive) -> Array:
        ground = sum(
            h * np.sin(2 * np.pi * drive.place_m / w + p) for w, p, h in zip(length, phase, height, strict=True)
        )
        return np.asarray(0.02 * weight * drive.outward * ground)

    return world.adding(force)


def regeneration(world: World) -> list[Effort]:
    """Braking and rolling downhill charge the battery: little at low speed, and no more than the charger takes."""
    robot = world.robot
    most_w = 3.0 * robot.rolling_resistance * robot.mass_kg * base.GRAVITY_MPS2 * robot.max_speed_mps
    share, knee = world.rng.uniform(0.5, 0.7), 0.12 * robot.max_speed_mps

    def charged(drive: Drive, force_n: Array) -> Array:
        speed = drive.speed_mps
        braking_w = np.maximum(-force_n, 0.0) * speed * share * speed**2 / (speed**2 + knee**2)
        return np.asarray(-most_w * np.tanh(braking_w / most_w))

    return [Effort(np.zeros(f.size), charged(d, f)) for d, f in zip(world.drives, world.forces_n, strict=True)]


def copper_loss(world: World) -> list[Effort]:
    """Heat of the windings, a little more than quadratic in the torque as iron saturates, at any speed above zero."""
    reference_n = world.robot.rolling_resistance * world.robot.mass_kg * base.GRAVITY_MPS2
    steep = world.rng.uniform(2.0, 2.3)

    def heat(drive: Drive, force_n: Array) -> Array:
        return np.asarray((np.maximum(force_n, 0.0) / reference_n) ** steep * (drive.speed_mps > 0.0))

    return [Effort(np.zeros(f.size), heat(d, f)) for d, f in zip(world.drives, world.forces_n, strict=True)]


def no_load(world: World) -> list[Effort]:
    """Brushes, seals and magnetisation: drawn as soon as the wheels turn and hardly more when they turn fast."""
    return world.adding(power=lambda drive: (drive.speed_mps / world.robot.max_speed_mps) ** 0.22)


def viscous(world: World) -> list[Effort]:
    """Drag with a power of speed near one: of cold gear oil that warms as it is churned, or of a flooded stretch."""
    top, power, rng = world.robot.max_speed_mps, world.rng.uniform(0.9, 1.25), world.rng
    longest = max(float(drive.place_m.max()) for drive in world.drives)
    flooded, warming_s = np.sort(rng.uniform(0.1, 0.9, 2)) * longest, rng.uniform(35.0, 60.0)
    cold = bool(rng.integers(2)) or flooded[1] - flooded[0] < 0.25 * longest

    def force(drive: Drive) -> Array:
        churned_s = np.cumsum(drive.speed_mps / top) * drive.step_s
        thick = np.exp(-churned_s / warming_s) if cold else 1.0 * (
            (drive.place_m > flooded[0]) & (drive.place_m < flooded[1])
        )  # fmt: skip
        return np.asarray(thick * (drive.speed_mps / top) ** power)

    return world.adding(force)


def breakaway(world: World) -> list[Effort]:
    """Sticking after a rest, the more the longer it was, worn off over the first decimetres of the way."""
    reach_m = 0.35 * world.robot.max_speed_mps

    def force(drive: Drive) -> Array:
        stuck = np.zeros(drive.speed_mps.size)
        rested_s, rolled_m, peak = 5.0, 0.0, 1.0
        for index, speed in enumerate(drive.speed_mps):
            if speed < 1e-3:
                rested_s, rolled_m = rested_s + drive.step_s, 0.0
                peak = 1.0 + 0.3 * np.log1p(rested_s)
            else:
                rested_s, rolled_m = 0.0, rolled_m + speed * drive.step_s
                stuck[index] = peak * np.exp(-((rolled_m / reach_m) ** 0.8))
        return stuck

    return world.adding(force)


def motor_heating(world: World) -> list[Effort]:
    """Winding and housing as two heat stores; loss grows with the winding's warmth, and hot restarts begin warm."""
    robot, rng = world.robot, world.rng
    reference_n = robot.rolling_resistance * robot.mass_kg * base.GRAVITY_MPS2

    def loss(drive: Drive, force_n: Array) -> Array:
        pulling_n = np.maximum(force_n, 0.0) * (drive.speed_mps > 0.0)
        winding = housing = rng.choice((0.0, 0.0, 0.5))
        warmth = np.empty(force_n.size)
        for index, heat in enumerate((pulling_n / reference_n) ** 2):
            passed = (winding - housing) / 25.0
            winding += drive.step_s * (heat / 30.0 - passed)
            housing += drive.step_s * (passed / 3.0 - housing / 400.0)
            warmth[index] = winding
        return np.asarray(pulling_n * drive.speed_mps * warmth**1.1)

    return [Effort(np.zeros(f.size), loss(d, f)) for d, f in zip(world.drives, world.forces_n, strict=True)]


def payload(world: World) -> list[Effort]:
    """A load taken up part-way in some runs and set down in others; tyres under it roll a little worse."""
    robot, rng, count = world.robot, world.rng, len(world.drives)
    loaded = rng.permutation(["up", "whole", "none", "down", "none", "up"][:count])

    def force(drive: Drive) -> Array:
        carries = {"up": (rng.uniform(0.3, 0.6), 1.1), "down": (-0.1, rng.uniform(0.3, 0.6))}
        begin, end = carries.get(loaded[drive.number], (-0.1, 1.1) if loaded[drive.number] == "whole" else (2.0, 2.0))
        passed = np.linspace(0.0, 1.0, drive.speed_mps.size)
        slope = 1.12 * robot.rolling_resistance * np.cos(drive.grade_rad) + np.sin(drive.grade_rad)
        return np.asarray(base.GRAVITY_MPS2 * slope * ((passed > begin) & (passed < end)))

    return world.adding(force)


def surface(world: World) -> list[Effort]:
    """Patches of softer ground along the route with blurred edges, in which rolling gets harder with speed."""
    rng = world.rng
    longest = max(float(drive.place_m.max()) for drive in world.drives)
    middles, widths = rng.uniform(0.15, 0.9, 3) * longest, rng.uniform(0.05, 0.13, 3) * longest
    depths = rng.uniform(0.5, 1.5, 3)

    def force(drive: Drive) -> Array:
        soft = sum(
            depth / (1.0 + np.abs((drive.place_m - middle) / width) ** 12)
            for depth, middle, width in zip(depths, middles, widths, strict=True)
        )
        return np.asarray(soft * np.cos(drive.grade_rad) * (0.9 + 0.2 * drive.speed_mps / world.robot.max_speed_mps))

    return world.adding(force)


def turning(world: World) -> list[Effort]:
    """Scrub of the tyres: its moment saturates with the yaw rate and is smaller in wide bends."""
    width_m = world.robot.track_m or 0.2

    def power(drive: Drive) -> Array:
        yaw = np.abs(drive.yaw_radps)
        moment = (1.0 - np.exp(-yaw / 0.25)) / (1.0 + 0.15 * drive.speed_mps / (np.maximum(yaw, 1e-3) * width_m))
        return np.asarray(moment * yaw)

    return world.adding(power=power)


def inertia(world: World) -> list[Effort]:
    """Mass and turning parts pushed through a slightly soft drive line."""
    heavy = world.robot.mass_kg * world.rng.uniform(1.05, 1.25)
    return world.adding(lambda drive: heavy * lagged(drive.acceleration_mps2, 0.12, drive.step_s))
