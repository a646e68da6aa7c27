"""From what happened to what a logger wrote: noise with memory, drift, quantisation, clocks, and which channels."""

from __future__ import annotations

import dataclasses

import numpy as np

from benchmarks.plants import base
from benchmarks.plants.case import Noise, Run
from benchmarks.plants.drives import Array, Drive, coloured
from benchmarks.plants.rollout import Rollout

NOISE: dict[Noise, float] = {"low": 0.005, "middle": 0.02, "high": 0.05}
"""Noise of the observed quantity over its mean, RMS."""

WINDOW_S = 0.5


def noisy(n: int, sigma: float, step_s: float, rng: np.random.Generator) -> Array:
    """Noise of a power meter: a part with memory, a white part and a slow drift, sigma in all; array of shape (n,)."""
    period_s = rng.uniform(0.7, 1.5) * n * step_s
    drift = np.sqrt(2.0) * np.sin(2 * np.pi * (np.arange(n) * step_s / period_s + rng.uniform()))
    white = rng.standard_normal(n)
    return np.asarray(sigma * (0.8 * coloured(n, 1.2, step_s, rng) + 0.57 * white + 0.2 * drift))


def rounded(signal: Array, mean: float) -> Array:
    """Signal in steps of a power of ten, about a thousandth of its mean; array of its shape."""
    quantum = 10.0 ** np.floor(np.log10(0.002 * mean))
    return np.asarray(np.round(signal / quantum) * quantum)


def window_rms(error: Array, step_s: float) -> float:
    """RMS of an error averaged over windows of half a second."""
    width = max(round(WINDOW_S / step_s), 1)
    means = error[: error.size // width * width].reshape(-1, width).mean(axis=1)
    return float(np.sqrt(np.mean(means**2)))


def observe(rollout: Rollout, noise: Noise, seed: int, exact: bool, outdoors: bool) -> tuple[tuple[Run, ...], float]:
    """Recordings of a rollout, and the RMS of the noise in them.

    Motion is free of noise where the control is to be exact; else its errors count as noise of what the base model
    makes of it, for no model can tell them apart.

    Args:
        rollout: What happened.
        noise: Level of all noise.
        seed: Of the noise.
        exact: Motion is recorded without error.
        outdoors: Heading, and distance from the base, are known.
    """
    rng = np.random.default_rng([seed, 99])
    mean = float(np.mean(np.abs(np.concatenate(rollout.clean))))
    wheels = rollout.robot.name in ("husky", "jackal") and bool(rng.integers(2))
    quantity = base.current if rollout.torque else base.drawn
    runs, errors = [], []
    for drive, clean, affected in zip(rollout.recorded, rollout.clean, rollout.affected, strict=True):
        observed = clean + noisy(clean.size, NOISE[noise] * mean, drive.step_s, rng)
        if rollout.effects:  # clocks that are set by hand; the controls' agree
            observed = np.interp(drive.time_s - rng.uniform(0.0, 0.01), drive.time_s, observed)
        seen = drive if exact else _seen(drive, NOISE[noise], rng)
        channels, observed = _electrical(rollout, observed, mean, drive, rng)
        missed = [quantity(rollout.robot, d, base.force(rollout.robot, d)) for d in (drive, seen)]
        errors.append(observed - clean + missed[0] - missed[1])
        motion = _motion(rollout, seen, wheels, outdoors)
        runs.append(Run({"time_s": drive.time_s, **motion, **channels}, affected))
    return tuple(runs), window_rms(np.concatenate(errors), rollout.drives[0].step_s)


def _seen(drive: Drive, level: float, rng: np.random.Generator) -> Drive:
    """The drive as encoders, gyroscope, inclinometer and position fix of a noise level have it."""
    n, step_s = drive.speed_mps.size, drive.step_s
    top = float(drive.speed_mps.max())
    moving = drive.speed_mps > 0.0
    speed = drive.speed_mps + moving * (0.1 * level * top * coloured(n, 0.4, step_s, rng))
    grade = drive.grade_rad + 0.03 * level * coloured(n, 4.0, step_s, rng)
    return dataclasses.replace(
        drive,
        speed_mps=np.maximum(np.round(speed / (5e-4 * top)) * 5e-4 * top, 0.0),
        yaw_radps=drive.yaw_radps + 0.1 * level * coloured(n, 0.2, step_s, rng),
        grade_rad=np.round(grade, 4),
        heading_rad=drive.heading_rad + 0.3 * level * coloured(n, 20.0, step_s, rng),
        base_m=np.abs(drive.base_m + 5.0 * level * coloured(n, 30.0, step_s, rng)),
        temperature_c=np.round(drive.temperature_c, 1),
    )


def _motion(rollout: Rollout, seen: Drive, wheels: bool, outdoors: bool) -> dict[str, Array]:
    half_m = 0.5 * rollout.nominal.track_m * seen.yaw_radps
    if wheels:
        channels = {"wheel_left_mps": seen.speed_mps - half_m, "wheel_right_mps": seen.speed_mps + half_m}
    else:
        channels = {"speed_mps": seen.speed_mps}
    channels["yaw_rate_radps"] = seen.yaw_radps
    if not rollout.flat:
        channels["grade_rad"] = seen.grade_rad
    if outdoors:
        channels["heading_rad"] = np.angle(np.exp(1j * seen.heading_rad))
        channels["base_distance_m"] = seen.base_m
    return channels | {
        "distance_m": seen.distance_m,
        "sensing_hz": seen.sensing_hz,
        "temperature_c": seen.temperature_c,
    }


def _electrical(
    rollout: Rollout, observed: Array, mean: float, drive: Drive, rng: np.random.Generator
) -> tuple[dict[str, Array], Array]:
    """Channels of the observed quantity, and what they amount to after quantisation."""
    if rollout.torque:  # skid steering loads the outer side more; the sum is what drives
        tilt = 0.5 + 0.1 * np.tanh(2.0 * drive.yaw_radps)
        left, right = (rounded(np.abs(part * observed), mean) for part in (1.0 - tilt, tilt))
        return {"motor_left_a": left, "motor_right_a": right}, left + right
    if rollout.in_watts or rollout.robot.name not in ("van", "courier"):
        power = rounded(observed, mean)
        return {"power_w": power}, power
    nominal = rollout.robot.nominal_voltage_v
    voltage = np.round(nominal * (1.02 + 0.002 * coloured(observed.size, 30.0, drive.step_s, rng)), 1)
    current = rounded(observed / voltage, mean / nominal)
    return {"voltage_v": voltage, "current_a": current}, voltage * current
