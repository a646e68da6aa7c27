"""Motion accounts for a load that it switches, and not for one that a clock switches."""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
import pytest

from homeward import Robot
from homeward.diagnosis import Recording, thresholds
from homeward.diagnosis.explain.motion import largest_by_motion, motion_gain
from homeward.diagnosis.fit.folds import cut_blocks, cut_folds
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


def test_motion_must_explain_nearly_as_much_as_the_ground_to_account_for_it(husky: Robot) -> None:
    """Slopes tell the place: trees on the motion explain much of what rougher ground consumes."""
    recordings = []
    for seed in range(3):
        run = over_hills(husky, seed)
        way_m = np.cumsum(run.channels["speed_mps"])
        is_rough = way_m > 150.0
        power_w = run.channels["power_w"] + 40.0 * run.channels["speed_mps"] * is_rough
        recordings.append(dataclasses.replace(run, channels={**run.channels, "power_w": power_w}))
    runs = average(usable_runs(recordings, husky)[0])
    fit = refit(runs, husky)
    block = cut_blocks(runs.run)
    fold, held_out_by = cut_folds(runs, block)
    assert held_out_by == "run"
    gained = largest_by_motion(fit, runs, block, rng=np.random.default_rng(0))
    explained = motion_gain(fit, runs, fold, rng=np.random.default_rng(0))
    assert gained.by_place == pytest.approx(explained / thresholds.NEARLY_ALL)
