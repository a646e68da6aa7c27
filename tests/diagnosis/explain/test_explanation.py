"""What is named gives way to a channel that explains more, and to none that only stands for time."""

import dataclasses
from collections.abc import Callable

import numpy as np

from homeward import Robot
from homeward.diagnosis import Recording, diagnose


def test_a_loss_that_remembers_the_fastest_speed_is_no_load_that_switches(
    drive: Callable[..., list[Recording]], husky: Robot
) -> None:
    runs = []
    for run in drive(husky, runs=4, minutes=4.0):
        time_s, speed_mps = run.channels["time_s"], np.abs(run.channels["speed_mps"])
        since = np.searchsorted(time_s, time_s - 30.0)
        fastest_mps = np.array([speed_mps[first : now + 1].max() for now, first in enumerate(since)])
        power_w = run.channels["power_w"] + 80.0 * fastest_mps**2 * speed_mps
        runs.append(dataclasses.replace(run, channels={**run.channels, "power_w": power_w}))
    assert diagnose(runs, husky).verdict == "unknown_physics"
