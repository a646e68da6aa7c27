"""Motion accounts for a load that it switches, and not for one that a clock switches."""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Recording
from homeward.diagnosis.explain.motion import largest_by_motion
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.fit.usable import usable_runs
from tests.diagnosis.made_up import over_hills

On = Callable[[int, Mapping[str, np.ndarray]], np.ndarray]


@pytest.mark.parametrize(
    ("on", "by_motion"),
    [
        (lambda run, of: np.full(len(of["time_s"]), run >= 2), False),
        (lambda run, of: (run == 1) & (of["time_s"] > 60.0) | (run > 1), False),
        (lambda run, of: of["time_s"] > 60.0, False),
        (lambda run, of: of["speed_mps"] > 0.5, True),
    ],
    ids=["from a run on", "from a moment on", "at the same time in each run", "at speed"],
)
def test_motion_accounts_for_a_load_that_it_switches(
    on: On, by_motion: bool, short_drive: Callable[..., list[Recording]], husky: Robot
) -> None:
    """Boosted trees know the minute of a run by the history of its motion, and nothing of another
    run's."""
    recordings = []
    for number, run in enumerate(short_drive(husky)):
        power_w = run.channels["power_w"] + 40.0 * on(number, run.channels)
        recordings.append(dataclasses.replace(run, channels={**run.channels, "power_w": power_w}))
    runs = average(usable_runs(recordings, husky)[0])
    gained = largest_by_motion(
        refit(runs, husky), runs, cut_blocks(runs.run), rng=np.random.default_rng(0)
    )
    assert gained.in_time > 1.0 if by_motion else gained.in_time == 0.0


def test_motion_does_not_account_for_a_load_by_telling_the_time(husky: Robot) -> None:
    """The history of the motion, which starts with each run, tells the time about as well as a
    clock does; a schedule that explains nearly all of the load leaves less than half as much."""
    recordings = []
    for seed, since_s in enumerate((200.0, 300.0, 400.0)):
        run = over_hills(husky, seed)
        is_loaded = run.channels["time_s"] >= since_s
        power_w = run.channels["power_w"] + 40.0 * run.channels["speed_mps"] * is_loaded
        recordings.append(dataclasses.replace(run, channels={**run.channels, "power_w": power_w}))
    runs = average(usable_runs(recordings, husky)[0])
    gained = largest_by_motion(
        refit(runs, husky), runs, cut_blocks(runs.run), rng=np.random.default_rng(0)
    )
    assert gained.in_time < 0.75
