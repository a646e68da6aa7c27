"""Hidden faults of instruments: they change what is recorded, not what happens."""

from __future__ import annotations

import dataclasses

import numpy as np

from benchmarks.plants.drives import Array, Drive, coloured

Recorded = tuple[list[Array], list[Drive]]


def sensor_offset(power: list[Array], drives: list[Drive], share: float, rng: np.random.Generator) -> Recorded:
    """The zero of the current sensor jumps at an event and creeps on, or drifts through the whole session."""
    jumps, run, moment = bool(rng.integers(2)), int(rng.integers(1, len(drives) - 1)), rng.uniform(0.3, 0.7)
    whole_s = drives[-1].start_s + drives[-1].time_s[-1]
    sign = rng.choice((-1.0, 1.0))

    def offset(drive: Drive) -> Array:
        after = np.linspace(0.0, 1.0, drive.speed_mps.size) + drive.number - run - moment
        clock = (drive.start_s + drive.time_s) / whole_s
        jump = (after > 0.0) * (1.0 + 0.06 * np.maximum(after, 0.0))
        drift = clock**1.4 + 0.05 * coloured(clock.size, 120.0, drive.step_s, rng)
        return np.asarray(jump if jumps else drift)

    offsets = [offset(drive) for drive in drives]
    level = sign * share * float(np.mean(np.concatenate(power)) / np.mean(np.abs(np.concatenate(offsets))))
    return [p + level * o for p, o in zip(power, offsets, strict=True)], drives


def sensor_gain(power: list[Array], drives: list[Drive], share: float, rng: np.random.Generator) -> Recorded:
    """Another gain of the current sensor from some moment on, after its range was switched."""
    run, moment = len(drives) // 2, rng.uniform(0.1, 0.5)
    after = [np.linspace(0.0, 1.0, d.speed_mps.size) + d.number - run - moment > 0.0 for d in drives]
    seen = sum(np.abs(p[late]).sum() for p, late in zip(power, after, strict=True))
    gain = 1.0 + rng.choice((-1.0, 1.0)) * share * np.abs(np.concatenate(power)).sum() / seen
    return [np.where(late, gain * p, p) for p, late in zip(power, after, strict=True)], drives


def clock_lag(power: list[Array], drives: list[Drive], share: float, rng: np.random.Generator) -> Recorded:
    """Power is stamped late: its clock lags that of the motion, by nearly the same time in every run."""
    lag_s = 0.3 + 1.2 * min(share / 0.25, 1.0)

    def late(signal: Array, drive: Drive) -> Array:
        return np.interp(drive.time_s - lag_s * rng.uniform(0.97, 1.03), drive.time_s, signal)

    return [late(p, d) for p, d in zip(power, drives, strict=True)], drives


def odometry_scale(power: list[Array], drives: list[Drive], share: float, rng: np.random.Generator) -> Recorded:
    """Odometry that overrates speed after worn wheels were fitted, which a position fix does not share."""
    fitted = len(drives) // 2
    factor = 1.06 + 1.4 * share
    return power, [
        dataclasses.replace(d, speed_mps=d.speed_mps * (factor * (1.0 + 0.01 * i) if i >= fitted else 1.0))
        for i, d in enumerate(drives)
    ]
