"""Dependences of a residual: where there are none, p-values are no smaller than chance makes
them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from homeward.diagnosis import Recording
from homeward.diagnosis.explain.residual_test import Dependence, dependences, independent_blocks
from homeward.diagnosis.fit.folds import cut_folds
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.physics import ancillary_power, load_robot, replay

IDLE_W = ancillary_power(load_robot("husky"), 0.0)


def nominal_drive(seed: int) -> Recording:
    """Changes of speed, slope and direction; the noise has a correlation of 0.9 from sample to
    sample."""
    robot, rng = load_robot("husky"), np.random.default_rng(seed)
    time_s = np.arange(0.0, 400.0, 0.5)
    speed = np.repeat(rng.choice([0.0, 0.3, 0.6, 0.9], size=80), 10)
    grade = np.repeat(rng.uniform(-0.05, 0.08, size=20), 40)
    yaw = np.repeat(rng.choice([0.0, 0.0, 0.4, -0.4], size=160), 5)
    noise_w = 3.0 * lfilter([1.0], [1.0, -0.9], rng.normal(size=len(time_s)))
    power = replay(robot, time_s, speed, grade_rad=grade).power_w + noise_w
    channels = {
        "time_s": time_s,
        "speed_mps": speed,
        "grade_rad": grade,
        "yaw_rate_radps": yaw,
        "power_w": power,
    }
    return Recording(f"drive {seed}", str(seed), channels)


def dependences_of(*recordings: Recording) -> list[Dependence]:
    """On channels and on time, as in the diagnosis."""
    robot = load_robot("husky")
    runs = average(usable_runs(recordings, robot)[0])
    fit = refit(runs, robot)
    blocks = independent_blocks(fit, runs)
    fold, _ = cut_folds(runs, blocks.channels)
    return dependences(fit, runs, blocks, fold, np.random.default_rng(0))


def test_p_values_are_no_smaller_than_chance_makes_them() -> None:
    """Exactly nominal robots under noise with memory: at one in ten, ten of forty are 0.5 %
    likely."""
    smallest = np.array(
        [min(one.p_value for one in dependences_of(nominal_drive(seed))) for seed in range(40)]
    )
    assert (smallest <= 0.1).sum() < 10
    assert (smallest < 1.0).any()


@pytest.mark.parametrize(
    ("channel", "higher"),
    [("heading_rad", 1.5), ("temperature_c", 20.0), ("payload_kg", 10.0), ("soc", 0.5)],
)
def test_drives_that_draw_a_share_more_by_a_channel_are_found_as_such(
    channel: str, higher: float
) -> None:
    """A fifth more in every other drive, at any speed and slope, and nothing more at rest."""
    robot, drives = load_robot("husky"), []
    for seed, value in enumerate((0.0, higher, 0.0, higher)):
        drive = nominal_drive(seed)
        power_w = drive.channels["power_w"]
        loaded_kg = value if channel == "payload_kg" else 0.0  # what a payload itself adds is known
        more = 1.2 * (1.0 + loaded_kg / robot.mass_kg) - 1.0 if value else 0.0
        changed = {
            channel: np.full(len(power_w), value),
            "power_w": power_w + more * (power_w - IDLE_W),
        }
        drives.append(replace(drive, channels={**drive.channels, **changed}))
    first = dependences_of(*drives)[0]
    assert (first.channel.name, first.scaled, first.found) == (channel, True, True)
