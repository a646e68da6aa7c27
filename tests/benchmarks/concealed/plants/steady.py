"""A drive made by hand, at one speed on an even slope, so that what it consumes is a formula."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from benchmarks.concealed.plants.chain import Work, rollout
from benchmarks.concealed.plants.effects import EFFECTS
from benchmarks.concealed.plants.motion import Motion
from benchmarks.concealed.plants.vehicles import SCOUT, Plant

ROBOT = SCOUT.robot
DT_S = 0.1


def motion(speed_mps: float = 1.0, seconds: float = 60.0, **changes: Any) -> Motion:
    """Numbers that are given hold throughout; arrays of shape (n,) are taken as they are."""
    n = round(seconds / DT_S)
    time_s, held = np.arange(n) * DT_S, {
        "accel_mps2": 0.0, "grade_rad": 0.0, "yaw_rate_radps": 0.0, "heading_rad": 0.0, "direction": 1.0,
        "elevation_m": 0.0, "base_distance_m": 5.0, "sensing_hz": 0.0, "temperature_c": 20.0, "speed_mps": speed_mps,
    }  # fmt: skip
    numbers = {name: changes.pop(name) for name in list(changes) if name in held}
    arrays = {
        name: np.broadcast_to(np.asarray(value, float), (n,)).copy()
        for name, value in (held | numbers).items()
    }
    distance_m = np.concatenate([[0.0], np.cumsum(arrays["speed_mps"][:-1] * DT_S)])
    kept = {
        "time_s": time_s,
        "distance_m": distance_m,
        "place_m": distance_m,
        "day_s": 0.0,
        "index": 0,
    }
    return Motion(**kept | arrays | changes)  # type: ignore[arg-type]


def drawn(
    effect: str, run: Motion, *, vehicle: Plant = SCOUT, seed: int = 0, runs: int = 1, **more: Any
) -> Work:
    """What a drive with one effect, of the catalogue of plants, comes to."""
    rng = np.random.default_rng(seed)
    return rollout(
        vehicle, run, [EFFECTS[effect](vehicle, rng, runs)], np.random.default_rng(1), **more
    )


def plain(run: Motion, vehicle: Plant = SCOUT, **more: Any) -> Work:
    """The same without."""
    return rollout(vehicle, run, [], np.random.default_rng(1), **more)


def later(run: Motion, index: int) -> Motion:
    return dataclasses.replace(run, index=index)
