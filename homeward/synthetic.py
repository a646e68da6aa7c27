"""Synthetic recordings: a robot that drives by the project's own kernel, measured with noise.

`python -m homeward.synthetic FILE` writes the recording that ships with the project,
`shipped_recording` of `homeward.datasets`.
"""

import dataclasses
import gzip
import sys

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from homeward.files import write_whole
from homeward.physics import Robot, load_robot, replay

Array = NDArray[np.float64]

STEP_S = 0.1
"""Time between samples, s. Chosen: robots are logged at about 10 Hz."""
SAMPLES = 4800
"""Eight minutes. Chosen: each level of speed, grade and sensing comes several times."""
RESOLUTION = {
    "time_s": 1,
    "speed_mps": 3,
    "yaw_rate_radps": 3,
    "grade_rad": 3,
    "sensing_hz": 0,
    "power_w": 1,
}
"""Decimals that the sensors give. Chosen: finer than their noise."""


def record(robot: Robot, seed: int = 20) -> pd.DataFrame:
    """Drive a robot for eight minutes over hilly ground with stops and turns, and measure with
    noise.

    The noise is drawn apart from the physics: a slow drift of the load, a ripple of the current,
    and the noise and resolution of the sensors. The seed determines drive and noise.
    """
    rng = np.random.default_rng(seed)
    time_s: Array = STEP_S * np.arange(SAMPLES, dtype=np.float64)
    speed = _levels(rng, (0.0, 0.3, 0.5, 0.7, 0.9), 6.0, 20.0)
    speed = uniform_filter1d(speed, 15, mode="nearest")
    speed[speed < 0.02] = 0.0
    yaw_rate = _levels(rng, (0.0, 0.0, 0.0, 0.3, -0.3, 0.6, -0.6), 3.0, 9.0)
    yaw_rate = uniform_filter1d(yaw_rate, 9, mode="nearest")
    yaw_rate = yaw_rate * (speed > 0.0)  # a standing robot does not turn
    grade = _levels(rng, (-0.06, 0.0, 0.0, 0.06, 0.1), 15.0, 40.0)
    grade = uniform_filter1d(grade, 40, mode="nearest")
    sensing_hz = _levels(rng, (0.0, 10.0, 25.0), 30.0, 60.0)
    power_w = replay(
        robot, time_s, speed, grade_rad=grade, yaw_rate_radps=yaw_rate, accel_mps2=np.gradient(speed, time_s),
        sensing_hz=sensing_hz,
    ).power_w  # fmt: skip
    # First-order autoregression with a variance of 1.
    drift = lfilter([np.sqrt(1.0 - 0.98**2)], [1.0, -0.98], rng.standard_normal(SAMPLES))
    ripple_w = 3.0 * rng.standard_normal(SAMPLES)
    power_w = power_w * (1.0 + 0.02 * drift) + ripple_w
    columns = {
        "time_s": time_s,
        "speed_mps": speed + 0.003 * rng.standard_normal(SAMPLES) * (speed > 0.0),
        "yaw_rate_radps": yaw_rate + 0.005 * rng.standard_normal(SAMPLES),
        "grade_rad": grade + 0.002 * rng.standard_normal(SAMPLES),
        "sensing_hz": sensing_hz,
        "power_w": power_w,
    }
    return pd.DataFrame(
        {name: np.round(values, RESOLUTION[name]) for name, values in columns.items()}
    )


def _levels(
    rng: np.random.Generator, choices: tuple[float, ...], shortest_s: float, longest_s: float
) -> Array:
    """Levels held for random times, shape (SAMPLES,)."""
    values = np.empty(SAMPLES)
    start = 0
    while start < SAMPLES:
        length = int(rng.uniform(shortest_s, longest_s) / STEP_S)
        values[start : start + length] = rng.choice(choices)
        start += length
    return values


def scrubbing_husky() -> bytes:
    """The recording that ships, as a gzip file that is the same every time it is made.

    A Husky that differs from the preset `husky`: its rolling resistance is 15 % higher, and its
    wheels scrub in turns, which the preset omits.
    """
    husky = load_robot("husky")
    rolling = 1.15 * husky.rolling_resistance
    true = dataclasses.replace(
        husky, rolling_resistance=rolling, effects={"turning": {"scrub": 0.3}}
    )
    return gzip.compress(record(true).to_csv(index=False).encode(), mtime=0)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("python -m homeward.synthetic FILE: give the file to write")
    write_whole(sys.argv[1], scrubbing_husky())
